"""Python, the packages and the build options of OpenCV."""

from __future__ import annotations

import os
import platform
import re
import sys
from collections.abc import Collection, Iterator
from importlib import metadata

from app.doctor.finding import Finding, Section
from observer.version import COMPLETE, installed_version

_SECTION = Section("Software")
_NEEDED_PYTHON = (3, 11)
# Reported with their versions; the others only need to be present.
_SHOWN = ("numpy", "scipy", "opencv-python-headless", "fastapi", "uvicorn", "viser", "sqlalchemy")
_OPENCV = ("opencv-python-headless", "opencv-python", "opencv-contrib-python",
           "opencv-contrib-python-headless")  # fmt: skip


def program_version() -> str:
    """Return the installed version, or ``unknown`` if the program runs without installation."""
    return installed_version(COMPLETE) or "unknown"


def examine_software() -> Iterator[Finding]:
    """Check Python, packages, OpenCV's video support and cores."""
    yield _python()
    yield from _packages(metadata.requires(COMPLETE) or [] if installed_version(COMPLETE) else [])
    yield from _video_support(_video_backends())
    yield _cores(_usable_cores())


def _python() -> Finding:
    found = f"Python {platform.python_version()} on {platform.system()} ({platform.machine()})"
    if sys.version_info[:2] < _NEEDED_PYTHON:
        return _SECTION.problem(f"{found}; Python 3.11 or newer is needed")
    return _SECTION.ok(found)


def _packages(requirements: Collection[str]) -> Iterator[Finding]:
    """Check that the required packages are installed; ``requirements`` as in the metadata."""
    if not requirements:
        yield _SECTION.warning(
            f"{COMPLETE} is not installed as a package, so its dependencies were not checked; "
            "make setup installs it"
        )
        return
    needed = [_name(each) for each in requirements if "extra ==" not in each]
    missing = [name for name in needed if installed_version(name) is None]
    if missing:
        yield _SECTION.problem(
            f"packages are missing: {', '.join(missing)}; make setup installs them"
        )
    versions = [f"{name} {installed_version(name)}" for name in _SHOWN if installed_version(name)]
    yield _SECTION.ok(f"packages: {', '.join(versions)}")
    several = [name for name in _OPENCV if installed_version(name)]
    if len(several) > 1:
        yield _SECTION.warning(
            f"{' and '.join(several)} are installed side by side and overwrite each other's files; "
            "uninstall all of them, then run make setup"
        )


def _name(requirement: str) -> str:
    match = re.match(r"[A-Za-z0-9._-]+", requirement)
    return match.group(0) if match else requirement


def _video_backends() -> frozenset[str]:
    import cv2

    registry = cv2.videoio_registry
    return frozenset(
        registry.getBackendName(each)
        for each in registry.getBackends()
        if registry.hasBackend(each)
    )


def _video_support(backends: Collection[str]) -> Iterator[Finding]:
    """Report what OpenCV can read with these backends."""
    needs = [("FFMPEG", "video files and network cameras")]
    if sys.platform == "linux":
        needs.insert(0, ("V4L2", "cameras on USB"))
    for backend, what in needs:
        if backend in backends:
            yield _SECTION.ok(f"OpenCV reads {what} ({backend})")
        else:
            yield _SECTION.warning(
                f"this build of OpenCV cannot read {what} (no {backend}); the package "
                f"opencv-python-headless has it, make setup installs that"
            )


def _usable_cores() -> int:
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _cores(number: int) -> Finding:
    if number < 2:
        return _SECTION.warning(
            "only one processor core; the method and the web page share it and frames will be "
            "dropped: two or more are recommended"
        )
    return _SECTION.ok(f"{number} processor cores")
