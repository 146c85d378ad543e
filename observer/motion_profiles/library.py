"""The motion profiles that come with the project, and the reader of a user's own.

The built-in ones are the YAML files in the folder ``library`` next to this file.
"""

from __future__ import annotations

from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path

from observer.errors import InputError
from observer.motion_profiles.profile import MotionProfile
from observer.motion_profiles.profile_file import profile_from_text
from observer.text_files import read_text


def profile_names() -> tuple[str, ...]:
    """Return the names of the built-in motion profiles, sorted."""
    files = (entry.name for entry in _folder().iterdir())
    return tuple(sorted(name.removesuffix(".yaml") for name in files if name.endswith(".yaml")))


def load_profile(name: str) -> MotionProfile:
    """Load a built-in motion profile by its name, never by a path.

    Raises:
        InputError: there is none of this name; the sentence lists the existing ones.
    """
    return profile_from_text(library_text(name), name)


def library_text(name: str) -> str:
    """Return the YAML text of a built-in motion profile.

    Raises:
        InputError: there is none of this name; the sentence lists the existing ones.
    """
    if name not in (names := profile_names()):
        raise InputError(f"there is no programme {name[:60]!r}; available are {', '.join(names)}")
    return _folder().joinpath(f"{name}.yaml").read_text(encoding="utf-8")


def read_profile(path: Path) -> MotionProfile:
    """Read a motion profile from a YAML file.

    Raises:
        InputError: the file is missing, cannot be read or is not a motion profile.
    """
    if not path.exists():
        raise InputError(f"there is no programme file {path}")
    return profile_from_text(read_text(path, "a programme"), path.stem)


def _folder() -> Traversable:
    return resources.files("observer.motion_profiles") / "library"
