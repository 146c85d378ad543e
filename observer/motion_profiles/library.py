"""The programmes that come with the project, and reading those of a user.

The built-in ones are the YAML files of the folder ``library`` beside this file.
"""

from __future__ import annotations

from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path

from observer.errors import InputError
from observer.motion_profiles.profile import Programme
from observer.motion_profiles.profile_file import programme_from_text
from observer.text_files import read_text


def programme_names() -> tuple[str, ...]:
    """Names of the built-in programmes, in order."""
    return tuple(
        sorted(
            entry.name.removesuffix(".yaml")
            for entry in _folder().iterdir()
            if entry.name.endswith(".yaml")
        )
    )


def load_programme(name: str) -> Programme:
    """A built-in programme; nothing but its name is taken, never a path.

    Raises:
        InputError: there is none of this name; the sentence lists those that are.
    """
    return programme_from_text(library_text(name), name)


def library_text(name: str) -> str:
    """The YAML of a built-in programme, as it is written.

    Raises:
        InputError: there is none of this name; the sentence lists those that are.
    """
    names = programme_names()
    if name not in names:
        raise InputError(f"there is no programme {name[:60]!r}; there are {', '.join(names)}")
    return _folder().joinpath(f"{name}.yaml").read_text(encoding="utf-8")


def read_programme(path: Path) -> Programme:
    """The programme of a YAML file.

    Raises:
        InputError: the file cannot be read, or one sentence on what is wrong in it.
    """
    if not path.exists():
        raise InputError(f"there is no programme file {path}")
    return programme_from_text(read_text(path, "a programme"), path.stem)


def _folder() -> Traversable:
    return resources.files("observer.motion_profiles") / "library"
