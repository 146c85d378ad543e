"""Library of programmes: the project's own, and the user's as files."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from pathlib import Path

from app.server.data_files import write_whole
from app.server.errors import Conflict, FieldError, NotThere
from observer.errors import InputError
from observer.motion_profiles.library import load_profile, profile_names, read_profile
from observer.motion_profiles.profile import MotionProfile
from observer.motion_profiles.profile_file import profile_from_text

_SUFFIX = ".yaml"
# More than any user needs; a listing reads every file.
_MOST_OWN = 200


@dataclass(frozen=True)
class KeptProfile:
    """Motion profile, marked if the user uploaded it."""

    profile: MotionProfile
    own: bool


class ProfileLibrary:
    """Reader and writer of the programme files; call it in a thread.

    Args:
        folder: folder of the user's programmes; None: only the project's.
    """

    def __init__(self, folder: Path | None) -> None:
        self._folder = folder

    def all(self) -> list[KeptProfile]:
        """Return the project's programmes, then the user's own, both by name.

        Files that are not (or no longer) valid programmes are left out.
        """
        names = profile_names()
        built_in = [KeptProfile(load_profile(name), False) for name in names]
        own = [self._own(name) for name in self._own_names() if name not in names]
        return built_in + [each for each in own if each is not None]

    def find(self, name: str) -> KeptProfile:
        """Return a programme by name.

        Raises:
            NotThere: there is no programme of this name.
        """
        if name in profile_names():
            return KeptProfile(load_profile(name), False)
        # Only names from a listing of the folder may become paths.
        own = self._own(name) if name in self._own_names() else None
        if own is not None:
            return own
        raise NotThere(f"there is no programme {name[:80]!r}; it may have been deleted")

    def save(self, text: str) -> KeptProfile:
        """Save a programme under its own name; replace the user's older version.

        Raises:
            FieldError: the text is not a programme, or it cannot be written. Conflict: the name
                belongs to a programme of the project, or there are too many. StorageFull: the disk
                is full.
        """
        try:
            profile = profile_from_text(text)
        except InputError as error:
            raise FieldError(("body", "text"), str(error)) from error
        name = profile.name
        if name in profile_names():
            raise Conflict(f"the programme {name} is built in; choose another name")
        names = self._own_names()
        if name not in names and len(names) >= _MOST_OWN:
            raise Conflict(f"there are {_MOST_OWN} programmes of your own; delete one first")
        if self._folder is None:
            raise Conflict("this server stores no programmes")
        write_whole(self._file(name), text)
        return KeptProfile(profile, True)

    def delete(self, name: str) -> None:
        """Delete one of the user's own programmes.

        Raises:
            NotThere: there is no such programme. Conflict: it belongs to the project.
        """
        if name in profile_names():
            raise Conflict(f"the programme {name} is built in and cannot be deleted")
        if name not in self._own_names():
            raise NotThere(f"there is no programme {name[:80]!r}; it may have been deleted")
        self._file(name).unlink(missing_ok=True)

    def _own(self, name: str) -> KeptProfile | None:
        """Read a file; return None if it is not a valid programme of that name."""
        with contextlib.suppress(InputError):
            profile = read_profile(self._file(name))
            if profile.name == name:
                return KeptProfile(profile, True)
        return None

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
