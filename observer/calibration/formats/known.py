"""Calibration formats that are read, declared once: for refusals, help, page and documentation.

The command line's help imports this module, so it imports nothing that is slow to load.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

FileKind = Literal["opencv", "ros", "kalibr", "euroc", "kitti raw", "kitti odometry", "middlebury",
                   "zed", "matlab", "oak", "ost", "numpy"]  # fmt: skip


@dataclass(frozen=True)
class KnownFormat:
    """A format of calibration files.

    Attributes:
        tool: whose format it is, the name that people search for.
        files: which of its files are read.
        noun: one of them with its article, for messages.
    """

    tool: str
    files: str
    noun: str


FORMATS: Mapping[FileKind, KnownFormat] = {
    "opencv": KnownFormat(
        "OpenCV",
        "YAML, XML or JSON; one file, or two",
        "an OpenCV calibration",
    ),
    "ros": KnownFormat("ROS", "camera_info of both cameras", "a ROS camera_info"),
    "ost": KnownFormat("ROS", "ost.txt", "a ROS ost.txt"),
    "numpy": KnownFormat("NumPy", ".npz", "a NumPy archive"),
    "kalibr": KnownFormat("Kalibr", "camchain", "a Kalibr camchain"),
    "kitti raw": KnownFormat("KITTI", "calib_cam_to_cam.txt", "a KITTI calib_cam_to_cam.txt"),
    "kitti odometry": KnownFormat("KITTI", "calib.txt", "a KITTI calib.txt"),
    "matlab": KnownFormat("MATLAB", "stereoParameters in .mat", "a MATLAB calibration"),
    "middlebury": KnownFormat("Middlebury", "calib.txt", "a Middlebury calib.txt"),
    "zed": KnownFormat("ZED", ".conf", "a ZED calibration"),
    "oak": KnownFormat("OAK", "DepthAI's calib.json", "an OAK calib.json"),
    "euroc": KnownFormat("EuRoC", "sensor.yaml of both cameras", "an EuRoC sensor.yaml"),
}

# How people enter the unit of the lengths in a file, if it is not the format's own.
UNIT_HELP = (
    "m, cm, mm or in, or the length of one unit in the file, for example 25mm if it counts in "
    "squares of 25 mm"
)


def tools() -> tuple[str, ...]:
    """Return the name of every tool whose files are read, once."""
    return tuple(dict.fromkeys(each.tool for each in FORMATS.values()))


def tools_in_words() -> str:
    """Return the tools as a list for people, as in ``OpenCV, ROS or EuRoC``."""
    *others, last = tools()
    return f"{', '.join(others)} or {last}"


def formats_in_words() -> str:
    """Return every tool with its files, as in ``ROS (camera_info of both cameras; ost.txt)``."""
    return ", ".join(
        f"{tool} ({'; '.join(each.files for each in FORMATS.values() if each.tool == tool)})"
        for tool in tools()
    )
