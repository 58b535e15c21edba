"""Deferred signals, also in nested blocks."""

import signal

import pytest

from omnimirror.base import interrupts


@pytest.fixture(autouse=True)
def handler():
    """Handler of Python for Ctrl-C, which jobs in the background ignore."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def test_postponed_signal_is_raised_after_the_block():
    reached = []

    @interrupts.postponed()
    def block():
        signal.raise_signal(signal.SIGINT)
        reached.append("end")

    with pytest.raises(KeyboardInterrupt):
        block()
    assert reached == ["end"]


def test_inner_block_leaves_signals_to_the_outer_block():
    with interrupts.deferred():
        with interrupts.postponed():
            signal.raise_signal(signal.SIGINT)
        assert interrupts.is_pending()
        assert interrupts.exit_code() == 130
    assert not interrupts.is_pending()


def test_handlers_are_restored():
    before = [signal.getsignal(number) for number in interrupts.STOP_SIGNALS]
    with interrupts.deferred(), interrupts.deferred():
        pass
    assert [signal.getsignal(number) for number in interrupts.STOP_SIGNALS] == before
