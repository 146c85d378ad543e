"""Ring buffer of the last half minute, saved when something has happened."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from pathlib import Path

from observer.recording.container import Container
from observer.recording.encoder import Encoded
from observer.recording.errors import RecordingError
from observer.whole_files import whole_file


class Ring:
    """Keeps the newest messages and writes them as a recording of its own.

    Filled by a ``RecordingWriter``. Used by one thread, except that ``messages`` may be handed
    to another one.

    Args:
        seconds: how far it reaches back. max_bytes: limit of its size, which may shorten that.
    """

    def __init__(self, seconds: float = 30.0, max_bytes: int = 256 << 20) -> None:
        self._reach_ns = round(seconds * 1e9)
        self._max_bytes = max_bytes
        self._messages: deque[Encoded] = deque()
        self._latched: dict[str, Encoded] = {}
        self._bytes = 0

    @property
    def seconds_held(self) -> float:
        """Time that it reaches back, seconds."""
        if not self._messages:
            return 0.0
        return (self._messages[-1].log_time_ns - self._messages[0].log_time_ns) * 1e-9

    def keep(self, messages: Sequence[Encoded]) -> None:
        """Add messages and drop the oldest; those of one instant are dropped together."""
        self._messages.extend(messages)
        self._bytes += sum(len(message.data) for message in messages)
        while self._messages and self._is_too_much():
            oldest = self._messages[0].log_time_ns
            while self._messages and self._messages[0].log_time_ns == oldest:
                gone = self._messages.popleft()
                self._bytes -= len(gone.data)
                if gone.topic.latched:
                    self._latched[gone.topic.name] = gone

    def _is_too_much(self) -> bool:
        reach = self._messages[-1].log_time_ns - self._messages[0].log_time_ns
        return reach > self._reach_ns or self._bytes > self._max_bytes

    def messages(self) -> list[Encoded]:
        """Return all messages that a recording saved now needs, in order."""
        kept = list(self._messages)
        begin = kept[0].log_time_ns if kept else 0
        return [old._replace(log_time_ns=begin) for old in self._latched.values()] + kept

    def save(self, path: Path) -> None:
        """Write the current content as a recording, completely or not at all.

        Raises:
            RecordingError: it cannot be written.
        """
        try:
            with whole_file(path) as part, part.open("wb", buffering=0) as file:
                container = Container(file, path.name)
                for message in self.messages():
                    container.add(*message)
                    container.write_large()
                container.finish()
        except OSError as error:
            raise RecordingError.of(error, path.name) from None
