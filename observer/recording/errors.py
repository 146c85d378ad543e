"""Error in writing a recording; errors in reading one are ``SourceError``."""

from __future__ import annotations

from observer.errors import DynamicObserverError
from observer.whole_files import NO_SPACE


class RecordingError(DynamicObserverError):
    """A recording ended prematurely; everything written until then stays readable.

    Attributes:
        full: whether the disk has no space left for it.
    """

    def __init__(self, message: str, *, full: bool) -> None:
        self.full = full
        super().__init__(message)

    @staticmethod
    def of(error: OSError, name: str) -> RecordingError:
        """Return the error as one sentence.

        Args:
            name: of the file that was written.
        """
        full = error.errno in NO_SPACE
        why = "the disk is full" if full else f"it cannot be written: {error.strerror or error}"
        help_ = "free some space and start a new one" if full else "start a new one elsewhere"
        return RecordingError(
            f"the recording {name} ended because {why}; everything written until then can be "
            f"read; {help_}",
            full=full,
        )
