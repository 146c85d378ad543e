"""Reader of calibration files of any known format, recognised by content, not by name."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePath
from typing import Literal

from observer.calibration.formats.euroc_file import euroc_draft
from observer.calibration.formats.kalibr_file import kalibr_draft
from observer.calibration.formats.kitti_file import kitti_odometry_draft, kitti_raw_draft
from observer.calibration.formats.known import FORMATS, FileKind, formats_in_words
from observer.calibration.formats.matlab_file import is_matlab, matlab_draft
from observer.calibration.formats.middlebury_file import middlebury_draft
from observer.calibration.formats.numpy_file import is_numpy, numpy_data
from observer.calibration.formats.oak_file import is_oak, oak_draft
from observer.calibration.formats.opencv_file import is_opencv, opencv_draft
from observer.calibration.formats.ost_file import ost_draft
from observer.calibration.formats.plain_data import (
    CALIBRATION,
    NamedData,
    calibration_errors,
    parse_plain_data,
)
from observer.calibration.formats.ros_file import named_as_in_files, ros_draft
from observer.calibration.formats.understanding import (
    Cameras,
    Draft,
    NamedFile,
    Size,
    UnderstoodCalibration,
    Wanted,
    understood,
)
from observer.calibration.formats.units import LengthUnit
from observer.calibration.formats.zed_file import zed_draft
from observer.errors import CalibrationError, InputError
from observer.text_files import CONTROL_CHARACTER, PlainData, check_length, decoded, read_bytes

_Kind = FileKind | Literal["one camera"]
# intrinsics.yml and extrinsics.yml, or one file for each camera.
_MOST_FILES = 2
_CHAIN = ("cam0", "cam1")
# Formats other than YAML, XML and JSON, recognised by a line that each has.
_LINES: Mapping[FileKind, str] = {
    "zed": r"(?i)^\s*\[\s*(LEFT|RIGHT)_CAM_\w+\s*\]",
    "middlebury": r"^\s*cam0\s*=\s*\[",
    "kitti raw": r"^(S|K|D|R|T|S_rect|R_rect|P_rect)_0[0-3]:[ \t]*[-+.\d]",
    "kitti odometry": r"^P[0-3]:[ \t]*[-+.\d]",
    "ost": r"(?i)^#[ \t]*oST version|^[ \t]*camera matrix[ \t]*$",
}
# What people choose instead of a calibration, by how its text begins, and what to do about it.
_OTHER_FILES: Sequence[tuple[str, str]] = (
    (
        r"(#[^\n]*\n|\s)*\d+[ \t]+[A-Z][A-Z_]+[ \t]+\d+[ \t]+\d+[ \t]+[-+.\d]",
        "this is COLMAP's list of cameras, which lacks the extrinsics between them; calibrate the "
        "pair with images of a board",
    ),
    (
        r"version https://git-lfs\.",
        "this is a Git LFS pointer instead of the file itself; run git lfs pull",
    ),
    (r"(?i)\s*<(!doctype html|html)\b", "this is a web page; download the file itself"),
)


@dataclass(frozen=True, eq=False)
class _Recognised:
    """A file, its kind, and its text or mapping, whichever its kind needs."""

    file: NamedFile
    kind: _Kind
    text: str = ""
    data: dict[str, PlainData] | None = None

    @property
    def mapping(self) -> NamedData:
        return self.file.name, self.data or {}


# The readers of formats with both cameras in one file.
_OF_ONE_FILE: Mapping[FileKind, Callable[[_Recognised, Wanted], Draft]] = {
    "kalibr": lambda one, _: kalibr_draft(*one.mapping),
    "oak": lambda one, _: oak_draft(*one.mapping),
    "matlab": lambda one, wanted: matlab_draft(one.file.name, one.file.content, wanted),
    "numpy": lambda one, wanted: replace(
        opencv_draft([one.mapping], wanted), format="NumPy archive"
    ),
    "middlebury": lambda one, _: middlebury_draft(one.file.name, one.text),
    "zed": lambda one, wanted: zed_draft(one.file.name, one.text, wanted),
    "kitti raw": lambda one, wanted: kitti_raw_draft(one.file.name, one.text, wanted),
    "kitti odometry": lambda one, wanted: kitti_odometry_draft(one.file.name, one.text, wanted),
}


@calibration_errors()
def named_file(path: Path | str) -> NamedFile:
    """Read a file from disk, for ``read_any``.

    Raises:
        CalibrationError: the file cannot be read or is larger than a calibration.
    """
    path = Path(path)
    return NamedFile(path.name, read_bytes(path, CALIBRATION))


@calibration_errors()
def read_any(
    files: Sequence[NamedFile],
    *,
    size: Size | None = None,
    unit: LengthUnit | None = None,
    cameras: Cameras | None = None,
    expected_size: Size | None = None,
) -> UnderstoodCalibration:
    """Return the calibration in one file, or in two that belong together.

    Args:
        files: one file; or a pair: ROS's left.yaml and right.yaml (or two ost.txt), EuRoC's two
            sensor.yaml, OpenCV's intrinsics.yml and extrinsics.yml. Their order does not matter.
        size: width and height, pixels: the images' size if a file does not state it (OpenCV,
            KITTI odometry), or which of several sizes to use (ZED, KITTI raw).
        unit: of the lengths in the files, or how many metres one unit of theirs is (the square of
            a board); None takes the format's own. Lengths are never scaled just to become more
            plausible.
        cameras: KITTI's grey or colour pair; None takes grey where it is there.
        expected_size: that of the camera's images; used for ``size`` where that is not given.

    Raises:
        CalibrationError: one sentence naming the file, the key and the reason.
    """
    if not files:
        raise CalibrationError(
            "no calibration file was given; choose one file, or two that belong together"
        )
    if len(files) > _MOST_FILES:
        raise CalibrationError(
            f"{len(files)} files were given; a calibration is one file, or two that belong "
            f"together (left and right, or intrinsics and extrinsics)"
        )
    wanted = Wanted(size=size or expected_size, unit=unit, cameras=cameras)
    draft = _draft([_recognised(file) for file in _distinctly_named(files)], wanted)
    return understood(draft, unit=unit, expected_size=expected_size or size)


def _distinctly_named(files: Sequence[NamedFile]) -> list[NamedFile]:
    """Return the files under distinct names: EuRoC calls both of its files sensor.yaml."""
    if len({file.name for file in files}) == len(files):
        return list(files)
    return [
        NamedFile(f"{file.name} ({number})", file.content)
        for number, file in enumerate(files, start=1)
    ]


def _draft(files: list[_Recognised], wanted: Wanted) -> Draft:
    first = files[0]
    kind = first.kind
    for other in files[1:]:
        if other.kind != kind:
            raise CalibrationError(
                f"{first.file.name} is {_noun(kind)}, but {other.file.name} is "
                f"{_noun(other.kind)}; choose files that belong together"
            )
    if kind == "one camera":
        raise CalibrationError(
            f"{first.file.name}: this is the calibration of a single camera; a stereo calibration "
            "also contains the extrinsics between the two cameras (K1 D1 K2 D2 R T)"
        )
    if kind == "opencv":
        return opencv_draft([file.mapping for file in files], wanted)
    if kind == "ost":
        return ost_draft([(file.file.name, file.text) for file in files])
    if kind in ("ros", "euroc"):
        if len(files) != 2:
            pair = "left.yaml and right.yaml" if kind == "ros" else "those of cam0 and cam1"
            raise CalibrationError(
                f"{first.file.name}: {_noun(kind)} contains one camera; supply both files "
                f"together, {pair}"
            )
        compose = ros_draft if kind == "ros" else euroc_draft
        return compose(files[0].mapping, files[1].mapping)
    if len(files) != 1:
        raise CalibrationError(
            f"{first.file.name}: {_noun(kind)} is a single file for both cameras, but {len(files)} "
            "were given; choose one"
        )
    return _OF_ONE_FILE[kind](first, wanted)


def _recognised(file: NamedFile) -> _Recognised:
    name, content = file.name, file.content
    check_length(content, name, CALIBRATION)
    if is_matlab(content):
        return _Recognised(file, "matlab")
    if is_numpy(content):
        return _Recognised(file, "numpy", data=numpy_data(name, content))
    if content.startswith(b"\x1f\x8b"):
        raise CalibrationError(f"{name}: this is a compressed file; decompress it with gunzip")
    if content.startswith(b"PK\x03\x04"):
        raise CalibrationError(
            f"{name}: this is a ZIP archive; unpack it and choose the files inside"
        )
    text = _text(name, content)
    for beginning, advice in _OTHER_FILES:
        if re.match(beginning, text):
            raise CalibrationError(f"{name}: {advice}")
    for kind, line in _LINES.items():
        if re.search(line, text, re.MULTILINE):
            return _Recognised(file, kind, text=text)
    form = f"in a supported format: {formats_in_words()}"
    data = named_as_in_files(parse_plain_data(text, name=name, form=form))
    return _Recognised(file, _kind_of_mapping(name, data), data=data)


def _text(name: str, content: bytes) -> str:
    """Return the content as text.

    Raises:
        CalibrationError: it is none.
    """
    try:
        text = decoded(content, name=name)
    except InputError:
        text = "\0"
    if not CONTROL_CHARACTER.search(text):
        return text
    suffix = PurePath(name).suffix.lower()
    what = "a MATLAB file" if suffix == ".mat" else "a text file"
    raise CalibrationError(
        f"{name} is not {what}, and no other supported format: {formats_in_words()}"
    )


def _kind_of_mapping(name: str, data: dict[str, PlainData]) -> _Kind:
    if any(isinstance(data.get(key), dict) for key in _CHAIN):
        return "kalibr"
    if is_oak(data):
        return "oak"
    if "T_BS" in data or ("intrinsics" in data and "resolution" in data):
        return "euroc"
    if "camera_matrix" in data:
        ros_keys = ("projection_matrix", "rectification_matrix", "distortion_model")
        return "ros" if any(key in data for key in ros_keys) else "one camera"
    if is_opencv(data):
        return "opencv"
    keys = ", ".join(list(data)[:4])[:80] or "none"
    raise CalibrationError(
        f"{name}: not a known calibration format (its keys: {keys}); supported are "
        f"{formats_in_words()}"
    )


def _noun(kind: _Kind) -> str:
    return "the calibration of one camera" if kind == "one camera" else FORMATS[kind].noun
