"""The door to what is compiled: what the environment chooses, what is said of what is missing, threads."""

from __future__ import annotations

import logging
import os
import subprocess
import sys
from types import SimpleNamespace

import pytest

from omnimirror import native
from omnimirror.errors import InvalidParameter
from omnimirror.native import INTERFACE, Backend, backend, usable_cores

NAME = "from omnimirror.native import backend; print(backend.name)"


def name_told(choice: str) -> tuple[str, str]:
    environment = {**os.environ, "OMNIMIRROR_NATIVE": choice}
    run = subprocess.run([sys.executable, "-c", NAME], env=environment, capture_output=True, text=True, check=True)
    return run.stdout.strip(), run.stderr


@pytest.mark.skipif(not backend.is_compiled, reason="nothing is compiled here")
def test_the_environment_chooses():
    assert name_told("0") == ("opencv", "")
    assert name_told("plain") == ("plain", "")
    assert name_told("") == (backend.name, "")


@pytest.mark.skipif(not backend.is_compiled, reason="nothing is compiled here")
def test_instructions_that_there_are_not_are_refused(monkeypatch):
    monkeypatch.setenv("OMNIMIRROR_NATIVE", "mmx")
    with pytest.raises(InvalidParameter, match="'mmx' names no instructions of this machine"):
        _ = Backend().name


def test_what_is_missing_is_said_once(monkeypatch, caplog):
    monkeypatch.setitem(sys.modules, "omnimirror._native", None)
    monkeypatch.delattr("omnimirror._native", raising=False)
    monkeypatch.delenv("OMNIMIRROR_NATIVE", raising=False)
    missing = Backend()
    with caplog.at_level(logging.WARNING, "omnimirror"):
        assert missing.name == missing.name == "opencv"
        assert not missing.is_compiled
        missing.set_threads(missing.threads)
    assert [r.levelname for r in caplog.records] == ["WARNING"]
    assert "OpenCV, several times slower" in caplog.text
    with pytest.raises(RuntimeError, match=r"ask backend\.is_compiled first"):
        _ = missing.kernels


def test_kernels_of_another_version_are_left_alone(monkeypatch, caplog):
    monkeypatch.setitem(sys.modules, "omnimirror._native", SimpleNamespace(INTERFACE=INTERFACE - 1))
    monkeypatch.delenv("OMNIMIRROR_NATIVE", raising=False)
    with caplog.at_level(logging.WARNING, "omnimirror"):
        assert not Backend().is_compiled
    assert "another version" in caplog.text


def test_the_number_of_threads_is_checked():
    for count in (0, -1, 1025):
        with pytest.raises(InvalidParameter, match=f"{count} threads are not valid; valid are 1 to 1024"):
            backend.set_threads(count)


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="processes cannot be kept to some cores here")
def test_as_many_threads_as_the_process_may_use_cores():
    """Kept to one core, as by taskset, a process starts no second thread that would wait for the first."""
    script = (
        "import os; os.sched_setaffinity(0, {min(os.sched_getaffinity(0))}); "
        "from omnimirror.native import backend, usable_cores; print(usable_cores(), backend.threads)"
    )
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert run.stdout.split() == ["1", "1"]


@pytest.mark.parametrize(
    ("said", "least"),
    [("max 100000\n", 10**6), ("150000 100000\n", 2), ("20000 100000\n", 1), ("", 10**6), ("0 0", 10**6)],
)
def test_no_more_than_the_container_may_use(monkeypatch, tmp_path, said, least):
    monkeypatch.setattr(native, "QUOTA", tmp_path / "cpu.max")
    without = usable_cores()  # there is no such file
    (tmp_path / "cpu.max").write_text(said, encoding="ascii")
    assert usable_cores() == max(1, min(without, least))
