"""Stereolabs' factory calibrations, ``SN12345.conf``: all resolutions of a ZED camera, millimetres.

Directions as Stereolabs' own calibration tool (zed-stereo-calibration) writes them from OpenCV's
R and T: Baseline = -T[0], TY = T[1], TZ = T[2]; RX, CV and RZ are the rotation vector of R.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from observer.calibration.formats.numbers import at_key, shaped
from observer.calibration.formats.understanding import (
    Choice,
    Draft,
    DraftCamera,
    Size,
    Wanted,
    size_words,
)
from observer.errors import CalibrationError
from observer.geometry import rotation_matrix

# Sections by Stereolabs' name of the resolution; the files do not contain the sizes.
_SIZES: Mapping[str, Size] = {
    "hd": (1280, 720),
    "fhd": (1920, 1080),
    "2k": (2208, 1242),
    "vga": (672, 376),
    "fhd1200": (1920, 1200),
    "svga": (960, 600),
    "qhdplus": (3200, 1800),
    "4k": (3840, 2160),
}
_SECTION = re.compile(r"^\s*\[\s*([^\]]*?)\s*\]\s*$")
# Absent ones are zero: older files have no tangential coefficients.
_RADTAN = ("k1", "k2", "p1", "p2", "k3")
_RATIONAL = ("k4", "k5", "k6")


def zed_draft(name: str, text: str, wanted: Wanted) -> Draft:
    """The calibration of one resolution: the wanted one, or HD, or the first there is."""
    sections = _sections(name, text)
    there = [
        resolution
        for resolution in _SIZES
        if f"left_cam_{resolution}" in sections or f"right_cam_{resolution}" in sections
    ]
    if not there:
        raise CalibrationError(
            f"{name}: none of its sections has a known resolution; known are "
            f"{', '.join(f'LEFT_CAM_{each.upper()}' for each in _SIZES)}"
        )
    resolution = _resolution(name, there, wanted.size)
    size, words = _SIZES[resolution], resolution.upper()
    left = _camera(name, sections, f"left_cam_{resolution}", "left_disto", size)
    right = _camera(name, sections, f"right_cam_{resolution}", "right_disto", size)
    if left.model != right.model:
        raise CalibrationError(
            f"{name}: {right.K_key} uses another lens model than {left.K_key}; both cameras must "
            "use the same model"
        )
    stereo = _section(name, sections, "stereo")
    rotvec = np.array([stereo.number(f"{key}_{resolution}", key) for key in ("rx", "cv", "rz")])
    baseline = stereo.number("baseline")
    if baseline < 0:
        raise CalibrationError(
            f"{name}: STEREO.Baseline is {baseline:g}, but it must be positive, in millimetres"
        )
    aside = [stereo.number(f"{key}_{resolution}", key, default=0.0) for key in ("ty", "tz")]
    notes = [
        f"using section {words}: {size_words(size)} images",
        "rotation given as rotation vector RX, CV, RZ",
    ]
    if left.model == "equidistant":
        notes.append("fisheye lenses (k1 to k4 only)")
    choice = Choice("size", tuple(size_words(_SIZES[each]) for each in there), size_words(size))
    return Draft(
        name,
        "Stereolabs ZED calibration (.conf)",
        left,
        right,
        rotation_matrix(rotvec),
        np.array([-baseline, *aside]),
        unit="mm",
        R_key=f"[STEREO] RX, CV and RZ of {words}",
        T_key="[STEREO] Baseline",
        notes=tuple(notes),
        choices=(choice,) if len(there) > 1 else (),
    )


@dataclass(frozen=True)
class _Section:
    """A section of the file ``name``; its texts by key in lower case."""

    name: str
    title: str
    texts: dict[str, str] = field(default_factory=dict)

    def number(self, *keys: str, default: float | None = None) -> float:
        """Return the number of the first of these keys that exists; older files use later ones."""
        key = next((each for each in keys if each in self.texts), keys[0])
        if default is not None and key not in self.texts:
            return default
        label = f"[{self.title}] {key}"
        return at_key(self.texts, key, lambda text: float(shaped(text, 1)[0]), self.name, label)


def _sections(name: str, text: str) -> dict[str, _Section]:
    """Return the sections by title in lower case."""
    sections: dict[str, _Section] = {}
    current = _Section(name, "")
    for line in text.splitlines():
        if found := _SECTION.match(line):
            title = found.group(1).lower()
            if title in sections:
                raise CalibrationError(f"{name}: the section [{title.upper()[:40]}] appears twice")
            current = sections[title] = _Section(name, title.upper())
            continue
        key, equal, value = line.partition("=")
        if equal and not key.lstrip().startswith(("#", ";")):
            current.texts[key.strip().lower()] = value
    return sections


def _section(name: str, sections: Mapping[str, _Section], title: str) -> _Section:
    if title not in sections:
        raise CalibrationError(f"{name}: the section [{title.upper()}] is missing")
    return sections[title]


def _resolution(name: str, there: list[str], wanted: Size | None) -> str:
    if wanted is None:
        return there[0]
    for resolution in there:
        if _SIZES[resolution] == wanted:
            return resolution
    sizes = ", ".join(f"{size_words(_SIZES[each])} ({each.upper()})" for each in there)
    raise CalibrationError(
        f"{name}: no section is for {size_words(wanted)} images; the file has {sizes}"
    )


def _camera(
    name: str, sections: Mapping[str, _Section], title: str, lens: str, size: Size
) -> DraftCamera:
    """Return one camera; newer files keep the coefficients in a separate section ``lens``."""
    section = _section(name, sections, title)
    key = f"[{title.upper()}]"
    fx, fy, cx, cy = map(section.number, ("fx", "fy", "cx", "cy"))
    K = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    if "k1" not in section.texts and lens in sections:
        section = sections[lens]
        if "p1" not in section.texts and "p2" not in section.texts:
            D = [section.number(k) for k in ("k1", "k2", "k3", "k4")]
            return DraftCamera(size, K, np.array(D), "equidistant", key, key)
    keys = _RADTAN + (_RATIONAL if any(k in section.texts for k in _RATIONAL) else ())
    D = [section.number(k, default=None if k == "k1" else 0.0) for k in keys]
    return DraftCamera(size, K, np.array(D), "radtan", key, key)
