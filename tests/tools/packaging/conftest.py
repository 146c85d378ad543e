from __future__ import annotations

import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def clone_into(repository: Path) -> Callable[[Path], None]:
    """Copies the versioned files as they are now, without what set-ups made."""
    if not (repository / ".git").exists():
        pytest.skip(f"{repository} is not a git clone, so its own files cannot be told")

    def copy(target: Path) -> None:
        listed = subprocess.run(
            ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
            cwd=repository,
            check=True,
            capture_output=True,
            text=True,
        ).stdout
        for name in filter(None, listed.split("\0")):
            source = repository / name
            if source.is_file():
                (target / name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copy(source, target / name)

    return copy


@pytest.fixture
def clone(clone_into: Callable[[Path], None], tmp_path: Path) -> Path:
    """A fresh clone for one test."""
    target = tmp_path / "fresh clone"
    clone_into(target)
    return target
