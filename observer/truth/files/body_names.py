"""Unique names of bodies, however often a file repeats one."""

from __future__ import annotations

from observer.errors import TruthError

MOST_BODIES = 2000
_MOST_CHARACTERS = 100


class BodyNames:
    """Gives each body a unique name: a repeated one becomes ``name (2)``.

    Args:
        file: its name, for messages.
    """

    def __init__(self, file: str) -> None:
        self._file = file
        self._taken: set[str] = set()
        self._next: dict[str, int] = {}

    def of(self, written: str) -> str:
        """Return the name for a body that the file calls ``written``; ``unnamed`` if it is empty.

        Raises:
            TruthError: the file has too many bodies.
        """
        if len(self._taken) == MOST_BODIES:
            raise TruthError(
                f"{self._file}: there are more than {MOST_BODIES} bodies or markers; export fewer"
            )
        plain = " ".join(written.split())[:_MOST_CHARACTERS] or "unnamed"
        name = plain
        while name in self._taken:
            number = self._next.get(plain, 2)
            self._next[plain] = number + 1
            name = f"{plain} ({number})"
        self._taken.add(name)
        return name
