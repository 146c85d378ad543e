"""Command and environment of our processes that keep native libraries quiet and frugal."""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from pathlib import Path

# Set before the libraries are imported; values already set by the user take precedence.
NATIVE_ENVIRONMENT: Mapping[str, str] = {
    # The method's matrices are small. OpenBLAS's threads spin while they wait, which doubles the
    # time per frame on two busy cores. OpenBLAS reads this while numpy is imported.
    "OPENBLAS_NUM_THREADS": "1",
    # A faulty image or video is reported once, in our words, not a second time in theirs.
    "OPENCV_LOG_LEVEL": "SILENT",
    "OPENCV_FFMPEG_LOGLEVEL": "-8",
    # A small file may decode to gigabytes; no camera here has a hundred megapixels.
    "OPENCV_IO_MAX_IMAGE_PIXELS": str(100_000_000),
}


def module_command(module: str) -> tuple[str, ...]:
    """Return the command that runs one of our modules, like ``python -m``."""
    # -P: do not import modules from the folder in which the server is started.
    return (sys.executable, "-P", "-m", module)


def program_environment() -> dict[str, str]:
    """Return the environment of every process that we start: our packages, quiet libraries."""
    packages = str(Path(__file__).resolve().parents[2])
    paths = [packages, os.environ.get("PYTHONPATH", "")]
    return {
        **NATIVE_ENVIRONMENT,
        **os.environ,
        "PYTHONPATH": os.pathsep.join(filter(None, paths)),
    }
