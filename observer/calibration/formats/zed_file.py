"""Stereolabs' factory calibrations, ``SN12345.conf``: all resolutions of a ZED camera, millimetres.

Directions as Stereolabs' own calibration tool (zed-stereo-calibration) writes them from OpenCV's
R and T: Baseline = -T[0], TY = T[1], TZ = T[2]; RX, CV and RZ are the rotation vector of R.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from observer.calibration.formats.numbers import at_key, shaped
from observer.calibration.formats.understanding import Choice, Draft, Size, Wanted, size_words
from observer.camera import DistortionModel
from observer.errors import CalibrationError
from observer.geometry import Float64Array, rotation_matrix

# Sections by what Stereolabs calls the resolution; the files do not tell the sizes.
_SIZES: Mapping[str, Size] = MappingProxyType(
    {
        "hd": (1280, 720),
        "fhd": (1920, 1080),
        "2k": (2208, 1242),
        "vga": (672, 376),
        "fhd1200": (1920, 1200),
        "svga": (960, 600),
        "qhdplus": (3200, 1800),
        "4k": (3840, 2160),
    }
)
_SECTION = re.compile(r"^\s*\[\s*([^\]]*?)\s*\]\s*$")
# Absent ones are zero: older files have no tangential coefficients.
_RADTAN = ("k1", "k2", "p1", "p2", "k3")
_RATIONAL = ("k4", "k5", "k6")
_Section = Mapping[str, str]


def is_zed(text: str) -> bool:
    """Return whether a text has a section such as ``[LEFT_CAM_HD]``."""
    return re.search(r"^\s*\[\s*(LEFT|RIGHT)_CAM_\w+\s*\]", text, re.I | re.M) is not None


def zed_draft(name: str, text: str, wanted: Wanted) -> Draft:
    """The calibration of one resolution: the wanted one, or HD, or the first there is.

    Raises:
        CalibrationError: one sentence naming the file, the key and the reason.
    """
    sections = _sections(name, text)
    there = [
        resolution
        for resolution in _SIZES
        if f"left_cam_{resolution}" in sections or f"right_cam_{resolution}" in sections
    ]
    if not there:
        raise CalibrationError(
            f"{name}: its sections are of no known resolution; known are "
            f"{', '.join(f'LEFT_CAM_{each.upper()}' for each in _SIZES)}"
        )
    resolution = _resolution(name, there, wanted.size)
    size = _SIZES[resolution]
    left, right = f"left_cam_{resolution}", f"right_cam_{resolution}"
    K1, D1, model = _camera(name, sections, left, "left_disto")
    K2, D2, right_model = _camera(name, sections, right, "right_disto")
    if model != right_model:
        raise CalibrationError(
            f"{name}: [{right.upper()}] has coefficients of another lens model than "
            f"[{left.upper()}]; a pair must have one model"
        )
    if "stereo" not in sections:
        raise CalibrationError(f"{name}: the section [STEREO] is missing")
    stereo = sections["stereo"]
    rotvec = np.array([
        _number(name, stereo, "stereo", f"{key}_{resolution}", key, default=None)
        for key in ("rx", "cv", "rz")
    ])  # fmt: skip
    baseline = _number(name, stereo, "stereo", "baseline", default=None)
    if baseline < 0:
        raise CalibrationError(
            f"{name}: STEREO.Baseline is {baseline:g}, but a ZED's is positive, in millimetres"
        )
    aside = [
        _number(name, stereo, "stereo", f"{key}_{resolution}", key, default=0.0)
        for key in ("ty", "tz")
    ]
    notes = [
        f"section {resolution.upper()} is used: {size_words(size)} images",
        "rotation given as rotation vector RX, CV, RZ",
    ]
    if model == "equidistant":
        notes.append("fisheye lenses (k1 to k4 only)")
    choices = (
        (Choice("size", tuple(size_words(_SIZES[each]) for each in there), size_words(size)),)
        if len(there) > 1
        else ()
    )
    return Draft(
        source=name,
        format="Stereolabs ZED calibration (.conf)",
        size=size,
        K1=K1,
        D1=D1,
        K2=K2,
        D2=D2,
        R=rotation_matrix(rotvec),
        T=np.array([-baseline, *aside]),
        unit="mm",
        distortion_model=model,
        keys={
            "K1": f"[{left.upper()}]",
            "D1": f"[{left.upper()}]",
            "K2": f"[{right.upper()}]",
            "D2": f"[{right.upper()}]",
            "R": f"[STEREO] RX, CV and RZ of {resolution.upper()}",
            "T": "[STEREO] Baseline",
        },
        notes=tuple(notes),
        choices=choices,
    )


def _sections(name: str, text: str) -> dict[str, dict[str, str]]:
    sections: dict[str, dict[str, str]] = {}
    current: dict[str, str] = {}
    for line in text.splitlines():
        if found := _SECTION.match(line):
            title = found.group(1).lower()
            if title in sections:
                raise CalibrationError(f"{name}: the section [{title.upper()[:40]}] stands twice")
            current = sections.setdefault(title, {})
            continue
        key, equal, value = line.partition("=")
        if equal and not key.lstrip().startswith(("#", ";")):
            current[key.strip().lower()] = value
    return sections


def _resolution(name: str, there: list[str], wanted: Size | None) -> str:
    if wanted is None:
        return there[0]
    for resolution in there:
        if _SIZES[resolution] == wanted:
            return resolution
    sizes = ", ".join(f"{size_words(_SIZES[each])} ({each.upper()})" for each in there)
    raise CalibrationError(
        f"{name}: no section is for images of {size_words(wanted)} pixels; the file has {sizes}"
    )


def _camera(
    name: str, sections: Mapping[str, _Section], section: str, lens: str
) -> tuple[Float64Array, Float64Array, DistortionModel]:
    """Camera matrix and coefficients; newer files keep the latter in a section of their own."""
    if section not in sections:
        raise CalibrationError(f"{name}: the section [{section.upper()}] is missing")
    camera = sections[section]
    fx, fy, cx, cy = (
        _number(name, camera, section, key, default=None) for key in ("fx", "fy", "cx", "cy")
    )
    K = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    if "k1" not in camera and lens in sections:
        camera, section = sections[lens], lens
        if "p1" not in camera and "p2" not in camera:
            fisheye = [
                _number(name, camera, section, k, default=None) for k in ("k1", "k2", "k3", "k4")
            ]
            return K, np.array(fisheye), "equidistant"
    keys = _RADTAN + (_RATIONAL if any(key in camera for key in _RATIONAL) else ())
    D = [_number(name, camera, section, key, default=None if key == "k1" else 0.0) for key in keys]
    return K, np.array(D), "radtan"


def _number(name: str, section: _Section, title: str, *keys: str, default: float | None) -> float:
    """The number of the first of these keys that is there; the later ones are of older files."""
    for key in keys:
        if key in section:
            label = f"[{title.upper()}] {key}"
            return at_key(section, key, lambda text: float(shaped(text, 1)[0]), name, label)
    if default is not None:
        return default
    raise CalibrationError(f"{name}: [{title.upper()}] {keys[0]} is missing")
