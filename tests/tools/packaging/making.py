"""``make`` in a clone, in an environment separate from the make that runs the tests."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Mapping
from pathlib import Path


def make(
    clone: Path, *arguments: str, path: str | None = None, timeout: float = 60
) -> subprocess.CompletedProcess[str]:
    environment: Mapping[str, str] = {
        name: value for name, value in os.environ.items() if not name.startswith("MAKE")
    }
    # Compiling modules that are never imported is half of pip's time ("no" means --no-compile).
    environment = {**environment, "PIP_NO_COMPILE": "no"}
    if path is not None:
        environment = {**environment, "PATH": path}
    return subprocess.run(
        ["make", *arguments],
        cwd=clone,
        env=environment,
        capture_output=True,
        text=True,
        timeout=timeout,
        check=False,
    )
