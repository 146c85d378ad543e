"""Programmes a person may choose: those that come with the project, and their own as files."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from pathlib import Path

from app.server.errors import Conflict, FieldError, NotThere
from app.server.whole_files import write_whole
from observer.errors import InputError
from observer.motion_profiles import (
    MotionProfile,
    load_profile,
    profile_from_text,
    profile_names,
    read_profile,
)

FOLDER_NAME = "programmes"
_SUFFIX = ".yaml"
# More than anybody keeps; a listing reads each of them.
_MOST_OWN = 200


@dataclass(frozen=True)
class KeptProfile:
    """A motion profile, and whether a person brought it."""

    profile: MotionProfile
    own: bool


class ProfileLibrary:
    """Reads and writes files: call it in a thread.

    Args:
        folder: of a person's own; None: there are only those that come with the project.
    """

    def __init__(self, folder: Path | None) -> None:
        self._folder = folder

    def all(self) -> list[KeptProfile]:
        """Those that come with the project, then a person's own, both by name.

        Files that are no programme (any more) are left out.
        """
        kept = [KeptProfile(load_profile(name), False) for name in profile_names()]
        built_in = {each.profile.name for each in kept}
        for name in self._own_names():
            with contextlib.suppress(InputError):
                own = read_profile(self._file(name))
                if own.name == name and name not in built_in:
                    kept.append(KeptProfile(own, True))
        return kept

    def find(self, name: str) -> KeptProfile:
        """One of them.

        Raises:
            NotThere: there is none of this name.
        """
        if name in profile_names():
            return KeptProfile(load_profile(name), False)
        # Only names that a listing of the folder gave lead to a file.
        if name in self._own_names():
            with contextlib.suppress(InputError):
                own = read_profile(self._file(name))
                if own.name == name:
                    return KeptProfile(own, True)
        raise NotThere(f"there is no programme {name[:80]!r}; GET /api/programmes lists them")

    def save(self, text: str) -> KeptProfile:
        """Keep a programme under the name it gives itself; its own older version is replaced.

        Raises:
            FieldError: the text is none, or it cannot be written. Conflict: the name is taken by
                one that comes with the project, or there are too many. StorageFull.
        """
        try:
            profile = profile_from_text(text)
        except InputError as error:
            raise FieldError(("body", "text"), str(error)) from error
        name = profile.name
        if name in profile_names():
            raise Conflict(f"the programme {name} comes with the project; choose another name")
        names = self._own_names()
        if name not in names and len(names) >= _MOST_OWN:
            raise Conflict(f"there are {_MOST_OWN} programmes of your own; delete one first")
        if self._folder is None:
            raise Conflict("this server keeps no programmes")
        write_whole(self._file(name), text)
        return KeptProfile(profile, True)

    def delete(self, name: str) -> None:
        """Forget one of a person's own.

        Raises:
            NotThere: there is none. Conflict: it comes with the project.
        """
        if name in profile_names():
            raise Conflict(f"the programme {name} comes with the project and stays")
        if name not in self._own_names():
            raise NotThere(f"there is no programme {name[:80]!r}; GET /api/programmes lists them")
        self._file(name).unlink(missing_ok=True)

    def _file(self, name: str) -> Path:
        assert self._folder is not None
        return self._folder / f"{name}{_SUFFIX}"

    def _own_names(self) -> list[str]:
        if self._folder is None:
            return []
        try:
            entries = list(self._folder.iterdir())
        except OSError:
            return []
        return sorted(
            entry.name.removesuffix(_SUFFIX)
            for entry in entries
            if entry.name.endswith(_SUFFIX) and not entry.name.startswith(".") and entry.is_file()
        )
