"""ROS ``ost.txt``, as camera_calibration prints it and camera_calibration_parsers reads it (INI).

Each camera begins with ``[image]``, followed by its name in brackets and its matrices, each a title
and rows of numbers. A pair is two such files, or both cameras in one.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from observer.calibration.formats.plain_data import NamedData
from observer.calibration.formats.ros_file import ROS_MODELS, ros_draft
from observer.calibration.formats.understanding import Draft
from observer.errors import CalibrationError
from observer.text_files import PlainData

# The keys in camera_info for a camera's titles.
_KEYS = {
    "width": "image_width",
    "height": "image_height",
    "camera matrix": "camera_matrix",
    "distortion": "distortion_coefficients",
    "rectification": "rectification_matrix",
    "projection": "projection_matrix",
}
_SINGLE = ("width", "height")
_SECTION = re.compile(r"\s*\[([^\]]*)\]\s*")
_NUMBERS = re.compile(r"\s*([-+.\d]|nan\b|inf\b)", re.IGNORECASE)


@dataclass
class _Camera:
    """The contents of one camera's part.

    Attributes:
        source: what messages call it. title: its name in brackets. numbers: by title.
    """

    source: str
    title: str = ""
    numbers: dict[str, list[PlainData]] = field(default_factory=dict)

    def camera_info(self) -> NamedData:
        """Return its name for messages, and the mapping that camera_info's YAML would hold.

        Raises:
            CalibrationError: a part is missing or the lens model is unknown.
        """
        source = f"{self.source} [{self.title}]" if self.title else self.source
        for title in _KEYS:
            if not self.numbers.get(title):
                raise CalibrationError(
                    f"{source}: {title} is missing; an ost.txt contains {', '.join(_KEYS)} for "
                    "each camera"
                )
        count = len(self.numbers["distortion"])
        if count not in ROS_MODELS:
            raise CalibrationError(
                f"{source}: distortion must contain 5 or 8 numbers, not {count}; ost.txt supports "
                "no other lens models; use left.yaml and right.yaml from camera_calibration"
            )
        data: dict[str, PlainData] = {
            key: self.numbers[title][0]
            if title in _SINGLE and len(self.numbers[title]) == 1
            else self.numbers[title]
            for title, key in _KEYS.items()
        }
        return source, data | {"distortion_model": ROS_MODELS[count], "camera_name": self.title}


def ost_draft(files: Sequence[tuple[str, str]]) -> Draft:
    """The calibration of two cameras in one ``ost.txt``, or of one in each of two files.

    The baseline in the projections tells which camera is right, as in ``ros_draft``; T in metres.

    Args:
        files: name and text of one file or two.

    Raises:
        CalibrationError: there are not two cameras, or one is incomplete.
        InputError: a number is malformed.
    """
    cameras = [camera for name, text in files for camera in _cameras(name, text)]
    source = " and ".join(name for name, _ in files)
    if len(cameras) != 2:
        holds = "one camera" if len(cameras) == 1 else f"{len(cameras)} cameras"
        raise CalibrationError(
            f"{source}: a ROS ost.txt of a stereo pair contains two cameras, but this one contains "
            f"{holds}; supply the files of the left and the right camera"
        )
    draft = ros_draft(*(camera.camera_info() for camera in cameras))
    return replace(draft, format="ROS ost.txt of two cameras")


def _cameras(name: str, text: str) -> list[_Camera]:
    """Return the cameras of a file."""
    cameras: list[_Camera] = []
    title = ""
    for line in text.splitlines():
        if not line.strip() or line.lstrip().startswith(("#", ";")):
            continue
        if found := _SECTION.fullmatch(line):
            section, title = found[1].strip()[:60], ""
            if section.lower() == "image" or not cameras:
                cameras.append(_Camera(name))
            if section.lower() != "image":
                cameras[-1].title = section
            continue
        if not cameras:
            cameras.append(_Camera(name))
        numbers = cameras[-1].numbers
        if _NUMBERS.match(line):
            numbers.setdefault(title, []).extend(line.split())
            continue
        title = " ".join(line.lower().split())
        if numbers.get(title):
            raise CalibrationError(
                f"{name}: {title[:60]} appears twice for one camera; each camera must begin with "
                "[image]"
            )
    return cameras
