"""The server's hold of one worker: give it a job, hear how far it is, end it."""

from __future__ import annotations

import asyncio
import contextlib
import os
import sys
from collections.abc import Callable

from app.calibration_worker.messages import (
    BoardsFound,
    Fitted,
    Job,
    Progress,
    Refined,
    Refused,
    Result,
)
from app.channel.errors import ChannelError
from app.channel.pipe import encode, read_message
from app.native_environment import program_environment
from observer.errors import CalibrationError

_COMMAND = (sys.executable, "-P", "-m", "app.calibration_worker")
_GRACE_S = 2.0
# An image larger than any camera's is not decoded: a few bytes could take all memory.
_MOST_PIXELS = 60_000_000


async def work(job: Job, progress: Callable[[Progress], None]) -> Result:
    """Have a worker do a job; cancelling ends the worker.

    Args:
        progress: called in the event loop whenever there is news.

    Raises:
        CalibrationError: it cannot be done; one sentence says why.
    """
    try:
        message = encode(job)
        process = await asyncio.create_subprocess_exec(
            *_COMMAND,
            str(os.getpid()),
            stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.PIPE,
            env=program_environment() | {"OPENCV_IO_MAX_IMAGE_PIXELS": str(_MOST_PIXELS)},
            # A terminal's Ctrl-C is the server's to answer.
            start_new_session=True,
        )
    except (ChannelError, OSError) as error:
        raise CalibrationError(f"the computation cannot be started: {error}") from error
    try:
        assert process.stdin is not None
        assert process.stdout is not None
        process.stdin.write(message)
        with contextlib.suppress(ConnectionError):
            await process.stdin.drain()
            process.stdin.close()
        while (heard := await read_message(process.stdout)) is not None:
            if isinstance(heard, Progress):
                progress(heard)
            elif isinstance(heard, Refused):
                raise CalibrationError(heard.reason)
            elif isinstance(heard, Fitted | BoardsFound | Refined):
                return heard
        code = await process.wait()
        raise CalibrationError(
            f"the computation ended without a result (exit code {code}); its messages are in the "
            f"server's log"
        )
    finally:
        with contextlib.suppress(ProcessLookupError):
            process.kill()
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(_GRACE_S):
                await process.wait()
