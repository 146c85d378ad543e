"""Supported motion capture formats, declared once for errors, help texts, page and documentation.

Every help text of the command line imports it, so it must not import anything slow.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

CaptureKind = Literal["vicon csv", "motive csv", "c3d", "plain csv", "tum"]
# Meaning of Vicon's three angles.
AngleReading = Literal["helical", "euler_xyz"]


@dataclass(frozen=True)
class KnownFormat:
    """A format of motion capture files.

    Attributes:
        name: the name that people look for.
        files: which of its files are supported.
        kind: the reader for them.
    """

    name: str
    files: str
    kind: CaptureKind


FORMATS = (
    KnownFormat("Vicon Tracker", "CSV of Objects or Segments", "vicon csv"),
    KnownFormat("Nexus", "CSV of Trajectories", "vicon csv"),
    KnownFormat("OptiTrack Motive", "CSV of rigid bodies", "motive csv"),
    KnownFormat("C3D", "markers", "c3d"),
    KnownFormat("EuRoC", "ground truth as CSV", "plain csv"),
    KnownFormat("TUM", "t tx ty tz qx qy qz qw", "tum"),
    KnownFormat(
        "plain CSV", "header t,x,y,z or t,x,y,z,qx,qy,qz,qw, seconds and metres", "plain csv"
    ),
)


def names_in_words() -> str:
    """Return the formats as a list for people, such as ``Vicon Tracker, TUM or plain CSV``."""
    *others, last = (each.name for each in FORMATS)
    return f"{', '.join(others)} or {last}"


def understood_in_words() -> str:
    """Return the end of an error message: which formats are supported."""
    return f"supported are {formats_in_words()}"


def formats_in_words() -> str:
    """Return every format with its files, such as ``Nexus (CSV of Trajectories)``."""
    return ", ".join(f"{each.name} ({each.files})" for each in FORMATS)
