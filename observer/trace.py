"""Traces of one ``observe``: its intermediate images and numbers, for whoever asks to see them.

``observer.observer`` has the table of their names.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any, Protocol

# What a trace kept, by name.
TraceValues = Mapping[str, Any]


class Trace(Protocol):
    """Receives every intermediate image and number of one ``observe``, by name."""

    def keep(self, name: str, value: Any) -> None: ...

    def keep_later(self, name: str, make: Callable[[], Any]) -> None: ...


class NoTrace:
    """Keeps nothing."""

    def keep(self, name: str, value: Any) -> None:
        """Drop the value."""

    def keep_later(self, name: str, make: Callable[[], Any]) -> None:
        """Never make the value."""


class FullTrace(Mapping[str, Any]):
    """Keeps everything, as a mapping from name to value."""

    def __init__(self) -> None:
        self._values: dict[str, Any] = {}
        self._later: dict[str, Callable[[], Any]] = {}

    def keep(self, name: str, value: Any) -> None:
        """Remember the value under its name."""
        self._values[name] = value

    def keep_later(self, name: str, make: Callable[[], Any]) -> None:
        """Remember how to compute the value, which is done on first access."""
        self._later[name] = make
        self._values[name] = None

    def __getitem__(self, name: str) -> Any:
        # Two threads that ask at once both compute it, which is harmless.
        make = self._later.get(name)
        if make is not None:
            self._values[name] = make()
            self._later.pop(name, None)
        return self._values[name]

    def __contains__(self, name: object) -> bool:
        # Mapping's own __contains__ would compute the value.
        return name in self._values

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def __len__(self) -> int:
        return len(self._values)
