"""Views pushed to a server that people run anyway, such as MediaMTX or go2rtc."""

from __future__ import annotations

import asyncio
import sys
from asyncio.subprocess import DEVNULL, PIPE, Process
from collections.abc import Callable
from contextlib import aclosing, suppress

from ...media.live.sources import named
from .outlets import TransportOutlet

FIRST_WAIT_S, LONGEST_WAIT_S = 0.5, 30.0
TAKEN = 100
"""Chunks after which a server is believed to take a view."""
MODULE = "omnimirror.interop.gateway.pushing"


async def publish(outlet: TransportOutlet, url: str, tell: Callable[[str], None]) -> None:
    """Push a transport stream to an address, again where nobody answers, until it is cancelled.

    It is a watcher like others, and nothing is coded for it alone; but it watches always, since it cannot see whether
    anybody does at the server.

    Parameters
    ----------
    outlet
        Whose stream.
    url
        Where to push to.
    tell
        Told in a sentence when the server is lost.
    """
    wait_s, is_lost = FIRST_WAIT_S, False
    while True:
        process = await asyncio.create_subprocess_exec(
            sys.executable, "-m", MODULE, url, stdin=PIPE, stdout=DEVNULL, stderr=PIPE, start_new_session=True
        )
        try:
            if await _feed(process, outlet):
                wait_s, is_lost = FIRST_WAIT_S, False
            reason = await _reason(process)
        finally:
            await _end(process)
        if not is_lost:
            tell(f"{named(url)} does not take the view: {reason}; trying again")
        is_lost = True
        await asyncio.sleep(wait_s)
        wait_s = min(2 * wait_s, LONGEST_WAIT_S)


async def _end(process: Process) -> None:
    """End a process and close its pipes, so that none outlives the event loop."""
    with suppress(ProcessLookupError):
        process.kill()
    if process.stdin is not None:
        process.stdin.close()
    await process.communicate()  # until standard error is closed, too


async def _feed(process: Process, outlet: TransportOutlet) -> bool:
    """Hand the stream to the process until it ends; whether that was later than at the start."""
    assert process.stdin is not None
    count = 0
    with suppress(BrokenPipeError, ConnectionResetError):
        async with aclosing(outlet.chunks()) as chunks:
            async for chunk in chunks:
                process.stdin.write(chunk)
                await process.stdin.drain()
                count += 1
    return count > TAKEN


async def _reason(process: Process) -> str:
    assert process.stderr is not None
    said = (await process.stderr.read()).decode(errors="replace").strip().splitlines()
    return said[-1] if said else "it ended"
