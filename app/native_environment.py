"""How the native libraries behave in a process of ours; to be set before they are imported."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

# What the person who starts us chose in the environment goes first.
NATIVE_ENVIRONMENT: Mapping[str, str] = {
    # The method's matrices are small. OpenBLAS's threads spin beside them, which doubles a
    # frame's time on two busy cores; it reads this while numpy is imported.
    "OPENBLAS_NUM_THREADS": "1",
    # What is wrong with an image or video is said once, in our words, not a second time in theirs.
    "OPENCV_LOG_LEVEL": "SILENT",
    "OPENCV_FFMPEG_LOGLEVEL": "-8",
}


def program_environment() -> dict[str, str]:
    """The environment of every process that we start: our packages, and calm libraries."""
    packages = str(Path(__file__).resolve().parents[1])
    paths = [packages, os.environ.get("PYTHONPATH", "")]
    return {
        **NATIVE_ENVIRONMENT,
        **os.environ,
        "PYTHONPATH": os.pathsep.join(filter(None, paths)),
    }
