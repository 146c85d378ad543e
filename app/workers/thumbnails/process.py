"""Handle through which the server uses the worker."""

from __future__ import annotations

from app.runtime.worker import Worker
from app.workers.thumbnails.messages import Picture, Pictured

# Nobody waits for a picture: everything else takes precedence.
_WORKER = Worker("app.workers.thumbnails", 19)


async def picture(spec: str) -> bytes:
    """Return a small JPEG of what a source shows; cancelling ends the worker.

    Raises:
        JobFailed: there is no picture of it; one sentence says why.
    """
    made: Pictured = await _WORKER.do(Picture(spec), lambda _: None)
    return made.jpeg
