"""Interpretation of calibration files, and the checks that all formats share.

A reader of a format turns its files into a ``Draft``: numbers as in the files, in the project's
order and directions. ``understood`` converts units, checks the whole and says in plain words what
was decided.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal

import numpy as np

from observer.calibration.formats.rational_lens import Smooth, without_pole
from observer.calibration.formats.units import (
    LengthUnit,
    UnitUnclear,
    implausible,
    metres,
    unit_words,
)
from observer.camera import DistortionModel, StereoCalibration, is_plausible_baseline
from observer.errors import CalibrationError
from observer.geometry import Float64Array

Cameras = Literal["grey", "colour"]
Size = tuple[int, int]

# A skew that moves no pixel further than this is rounding, px; rectification has no skew.
_MAX_SKEW_PX = 0.1
# Limits of the principal point for images of the right size, as a share of width and height.
_CENTRAL = (0.25, 0.75)
# A calibration's key at the start of a sentence.
_KEY = re.compile(r"(K1|D1|K2|D2|R|T)\b")


@dataclass(frozen=True)
class NamedFile:
    """A file as it was supplied: its name, for messages, and its whole content."""

    name: str
    content: bytes


@dataclass(frozen=True)
class Wanted:
    """Choices to make where files leave them open.

    Attributes:
        size: width and height of the images, pixels.
        unit: of lengths, or how many metres one unit of the file is; None takes the format's
            own.
        cameras: KITTI's grey cameras (0 and 1) or its colour ones (2 and 3).
    """

    size: Size | None = None
    unit: LengthUnit | None = None
    cameras: Cameras | None = None


@dataclass(frozen=True)
class Choice:
    """Choice that the files left open.

    Attributes:
        name: the argument of ``read_any`` that chooses: ``size`` or ``cameras``.
        options: the possible values; sizes as ``1280x720``.
        taken: which of them was used.
    """

    name: Literal["size", "cameras"]
    options: tuple[str, ...]
    taken: str


@dataclass(frozen=True, eq=False)
class UnderstoodCalibration:
    """A calibration, and how it was read.

    Attributes:
        calibration: the calibration.
        format: what kind of file it was, in words.
        notes: what was decided or converted, each in plain words.
        choices: what the files left open.
    """

    calibration: StereoCalibration
    format: str
    notes: tuple[str, ...]
    choices: tuple[Choice, ...] = ()


@dataclass(frozen=True, eq=False)
class DraftCamera:
    """One camera of a pair, as a reader took it from its file or section.

    Attributes:
        size: width and height, pixels. K, D, model: as in ``StereoCalibration``.
        K_key, D_key: what the file calls K and D; empty where it has no name for them.
    """

    size: Size
    K: Float64Array
    D: Float64Array
    model: DistortionModel = "radtan"
    K_key: str = ""
    D_key: str = ""


def check_alike(
    first: DraftCamera,
    second: DraftCamera,
    name: str,
    *,
    size: str = "resolution",
    model: str = "distortion_model",
    other: str = "the left camera's",
) -> None:
    """Check that two cameras have images of one size and lenses of one model.

    Args:
        name: the file of ``second``. size, model: what its keys are called there. other: what the
            sentence calls those of ``first``.
    """
    if first.size != second.size:
        raise CalibrationError(
            f"{name}: {size} is {second.size[0]}x{second.size[1]}, but {other} is "
            f"{first.size[0]}x{first.size[1]}; both cameras must have the same size"
        )
    if first.model != second.model:
        raise CalibrationError(
            f"{name}: {model} is {second.model}, but {other} is {first.model}; both cameras must "
            "use the same model"
        )


@dataclass(frozen=True, eq=False)
class Draft:
    """A calibration as a reader took it from its files, not yet checked as a whole.

    Attributes:
        source: the file's name, with which messages begin.
        format: what kind of file it is, in words.
        left, right: the cameras; size and model are those of the left one.
        R: as in ``StereoCalibration``. T: (3,) the same, but in ``unit``.
        unit: of T unless the user says otherwise.
        size_is_given: whether the size was given by the user, not by the file.
        R_key, T_key: what the file calls R and T.
        derived: what R or T was computed from, where the file has no such key.
        notes: what the reader decided.
        choices: what the file left open.
    """

    source: str
    format: str
    left: DraftCamera
    right: DraftCamera
    R: Float64Array
    T: Float64Array
    unit: LengthUnit = "m"
    size_is_given: bool = False
    R_key: str = "R"
    T_key: str = "T"
    derived: Mapping[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    choices: tuple[Choice, ...] = ()

    def calibration(self, unit: LengthUnit | None = None) -> StereoCalibration:
        """Return the calibration, T in metres; a lens with a pole in its image is replaced.

        The replacement's D is that of ``smooth_lenses``.

        Args:
            unit: of T, or how many metres one unit is; None takes the draft's own.

        Raises:
            CalibrationError: one sentence naming the file, the key and the reason.
        """
        used, left, right = unit or self.unit, self.left, self.right
        length = float(np.linalg.norm(self.T))
        if length and np.isfinite(length) and not is_plausible_baseline(length * metres(used)):
            raise UnitUnclear(self.located(implausible(length, used)), length, used)
        D1, D2 = (
            camera.D if smooth is None else smooth.D
            for camera, smooth in zip((left, right), self.smooth_lenses, strict=True)
        )
        try:
            T = self.T * metres(used)
            return StereoCalibration(*left.size, left.K, D1, right.K, D2, self.R, T, left.model)
        except CalibrationError as error:
            raise CalibrationError(self.located(str(error))) from None

    @cached_property
    def smooth_lenses(self) -> tuple[Smooth | None, Smooth | None]:
        """Substitutes, left and right, for rational lenses whose poles lie within their images."""
        return self._smooth(self.left), self._smooth(self.right)

    def _smooth(self, camera: DraftCamera) -> Smooth | None:
        if self.left.model != "radtan" or camera.D.size not in (8, 12, 14):
            return None
        if camera.K.shape != (3, 3) or not camera.K[0, 0] > 0 or not camera.K[1, 1] > 0:
            return None
        return without_pole(camera.K, camera.D, self.left.size)

    def smooth_notes(self) -> list[str]:
        """Return one sentence for each lens that was replaced."""
        return [
            _smooth_note(self.own_key(key), smooth)
            for key, smooth in zip(("D1", "D2"), self.smooth_lenses, strict=True)
            if smooth is not None
        ]

    def located(self, sentence: str) -> str:
        """Return the sentence with the file's name in front and the file's own key names."""
        found = _KEY.match(sentence)
        if found is None:
            return f"{self.source}: {sentence}"
        key = found[0]
        origin = f"; {key} is derived from {self.derived[key]}" if key in self.derived else ""
        return f"{self.source}: {self.own_key(key)}{sentence[found.end() :]}{origin}"

    def own_key(self, key: str) -> str:
        """Return what the file calls K1, D1, K2, D2, R or T."""
        left, right = self.left, self.right
        lenses = {"K1": left.K_key, "D1": left.D_key, "K2": right.K_key, "D2": right.D_key}
        return (lenses | {"R": self.R_key, "T": self.T_key})[key] or key


def understood(
    draft: Draft, *, unit: LengthUnit | None = None, expected_size: Size | None = None
) -> UnderstoodCalibration:
    """Return the draft, checked as a whole, with notes on how it was read.

    Args:
        unit: of lengths, if the user knows better than the format; a number is how many metres
            one unit of the file is.
        expected_size: width and height of the camera's images.

    Raises:
        CalibrationError: a camera matrix, the size or the arrangement cannot be right; one
            sentence says which and why.
    """
    notes = list(draft.notes)
    calibration = draft.calibration(unit)
    for key in ("K1", "K2"):
        notes += _check_camera_matrix(draft, key, getattr(calibration, key))
    calibration = _without_skew(calibration)
    notes += draft.smooth_notes()
    if draft.size_is_given:
        _check_central(draft, calibration)
    size = draft.left.size
    if expected_size is not None and size != expected_size:
        raise CalibrationError(
            f"{draft.source}: the calibration is for {size_words(size)} images, but the camera "
            f"delivers {size_words(expected_size)}; calibrate at the camera's image size, or set "
            f"the camera to {size_words(size)}"
        )
    try:
        calibration.check_side_by_side()
    except CalibrationError as error:
        raise CalibrationError(draft.located(str(error))) from None
    used = unit or draft.unit
    verb = "read in" if used == "m" else "converted from"
    notes.append(f"{draft.T_key} {verb} {unit_words(used)}: baseline {calibration.baseline:.5g} m")
    return UnderstoodCalibration(calibration, draft.format, tuple(notes), draft.choices)


def size_words(size: Size) -> str:
    """Return width and height as in ``1280x720``."""
    return f"{size[0]}x{size[1]}"


def _smooth_note(key: str, smooth: Smooth) -> str:
    return (
        f"{key} is a rational lens model that folds over {smooth.fold_px:.0f} px from the centre, "
        "within the image (numerator and denominator nearly cancel); it was replaced by a "
        f"polynomial that differs by at most {smooth.largest_px:.1f} px up to "
        f"{smooth.within_px:.0f} px from the centre and is extrapolated beyond; a new calibration "
        "would be better"
    )


def _check_camera_matrix(draft: Draft, key: str, K: Float64Array) -> list[str]:
    """Return notes on a camera matrix; refuse one that is malformed or has skew to rectify."""
    name = draft.own_key(key)
    if K[2, 0] or K[2, 1] or K[1, 0]:
        transposed = not K[0, 2] and not K[1, 2]
        hint = "it is transposed" if transposed else "is this a camera matrix?"
        raise CalibrationError(
            f"{draft.source}: {name} must have the rows fx, 0, cx; 0, fy, cy; 0, 0, 1; {hint}"
        )
    if not K[0, 1]:
        return []
    shift = abs(K[0, 1]) / K[1, 1] * max(K[1, 2], draft.left.size[1] - K[1, 2])
    if shift > _MAX_SKEW_PX:
        raise CalibrationError(
            f"{draft.source}: {name} has a skew of {K[0, 1]:.4g}, which shifts pixels by up to "
            f"{shift:.2g} px and is not supported; calibrate without estimating skew"
        )
    return [
        f"{name} has a skew of {K[0, 1]:.3g}, which shifts no pixel by more than 0.1 px and was "
        "ignored"
    ]


def _without_skew(calibration: StereoCalibration) -> StereoCalibration:
    if not calibration.K1[0, 1] and not calibration.K2[0, 1]:
        return calibration
    K1, K2 = calibration.K1.copy(), calibration.K2.copy()
    K1[0, 1] = K2[0, 1] = 0
    return replace(calibration, K1=K1, K2=K2)


def _check_central(draft: Draft, calibration: StereoCalibration) -> None:
    for key in ("K1", "K2"):
        centre = getattr(calibration, key)[:2, 2]
        part = centre / draft.left.size
        if (part < _CENTRAL[0]).any() or (part > _CENTRAL[1]).any():
            raise CalibrationError(
                f"{draft.source}: {draft.own_key(key)} has its principal point at "
                f"({centre[0]:.5g}, {centre[1]:.5g}), which is far from the centre of "
                f"{size_words(draft.left.size)} images; specify the size of the calibration images"
            )
