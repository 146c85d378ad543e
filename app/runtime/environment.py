"""Command and environment of processes of ours, which keep native libraries calm."""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from pathlib import Path

# To be set before they are imported; what the person who starts us chose goes first.
NATIVE_ENVIRONMENT: Mapping[str, str] = {
    # The method's matrices are small. OpenBLAS's threads spin beside them, which doubles a
    # frame's time on two busy cores; it reads this while numpy is imported.
    "OPENBLAS_NUM_THREADS": "1",
    # What is wrong with an image or video is said once, in our words, not a second time in theirs.
    "OPENCV_LOG_LEVEL": "SILENT",
    "OPENCV_FFMPEG_LOGLEVEL": "-8",
}


def module_command(module: str) -> tuple[str, ...]:
    """Command that runs a module of ours, like ``python -m``."""
    # -P: the folder somebody starts the server in must not supply the modules.
    return (sys.executable, "-P", "-m", module)


def program_environment() -> dict[str, str]:
    """Environment of every process that we start: our packages, and calm libraries."""
    packages = str(Path(__file__).resolve().parents[2])
    paths = [packages, os.environ.get("PYTHONPATH", "")]
    return {
        **NATIVE_ENVIRONMENT,
        **os.environ,
        "PYTHONPATH": os.pathsep.join(filter(None, paths)),
    }
