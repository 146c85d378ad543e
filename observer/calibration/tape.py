"""Comparison of a calibrated rig's depth with a tape measure, and causes of a difference."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from observer.calibration.fitting.stereo_fit import DepthBias
from observer.calibration.verdict import depth_bias_share, length_words
from observer.camera import StereoCalibration
from observer.errors import InputError
from observer.intervals import half_95

# One standard deviation of a tape measurement, as people do not know where inside the lens depth
# begins: metres, and a share of the length.
_TAPE_M, _TAPE_SHARE = 0.01, 0.002
# One standard deviation of the median disparity over a spot, pixels: semi-global matching is biased
# towards whole pixels, by up to 0.2 px on a plane that faces the cameras.
_SPOT_PX = 0.12
_RANGE_M = (0.05, 200.0)


@dataclass(frozen=True)
class TapeCheck:
    """Result of one measurement.

    Attributes:
        rig_m, tape_m: depth by the rig and by the tape.
        difference_m, share: rig minus tape, and that as a share of the tape's.
        expected_m: half of the 95 % interval of the difference. agrees: whether it lies within.
        square_m: side of the board's squares that would explain all of it, metres; None where
            the board is unknown. baseline_m: the baseline that would.
        vergence_deg: rotation of the right camera that would explain it instead; positive inwards.
        sentence: the same in words.
    """

    rig_m: float
    tape_m: float
    difference_m: float
    share: float
    expected_m: float
    agrees: bool
    square_m: float | None
    baseline_m: float
    vergence_deg: float
    sentence: str


def tape_check(
    calibration: StereoCalibration,
    rig_m: float,
    tape_m: float,
    *,
    square_m: float | None = None,
    bias: DepthBias | None = None,
    lasting_px: float = 0.0,
) -> TapeCheck:
    """Compare the depth that the rig measured with a tape's.

    Depth is proportional to the baseline, and the baseline to the side of the squares as typed in:
    a print whose squares are 97 % of that makes all depths 1 / 0.97 times too large.

    Args:
        rig_m, tape_m: metres, both along the camera's axis or both straight to the place.
        square_m: side of the board's squares as typed in. bias, lasting_px: of the fit.

    Raises:
        InputError: a distance is out of range.
    """
    low, high = _RANGE_M
    for name, value in (("rig", rig_m), ("tape", tape_m)):
        if not low <= value <= high:
            raise InputError(
                f"a tape check needs distances from {low:g} to {high:g} m, not {value:g} m from "
                f"the {name}"
            )
    per_disparity = tape_m / calibration.fb
    sigma = math.hypot(
        tape_m * depth_bias_share(calibration, tape_m, bias, lasting_px),
        tape_m * per_disparity * _SPOT_PX,
        _TAPE_M + _TAPE_SHARE * tape_m,
    )
    difference = rig_m - tape_m
    share, expected = difference / tape_m, half_95(sigma)
    scale = tape_m / rig_m
    # d = f B / Z; rig_m corresponds to the measured disparity.
    offset_px = calibration.fb * (1 / tape_m - 1 / rig_m)
    check = TapeCheck(
        rig_m=rig_m,
        tape_m=tape_m,
        difference_m=difference,
        share=share,
        expected_m=expected,
        agrees=abs(difference) <= expected,
        square_m=None if square_m is None else square_m * scale,
        baseline_m=calibration.baseline * scale,
        vergence_deg=math.degrees(offset_px / float(calibration.K1[0, 0])),
        sentence="",
    )
    return replace(check, sentence=_sentence(check, square_m))


def _sentence(check: TapeCheck, typed_m: float | None) -> str:
    way = "too far" if check.difference_m > 0 else "too near"
    begin = (
        f"Stereo {check.rig_m:.3g} m, tape {check.tape_m:.3g} m: "
        f"{length_words(abs(check.difference_m))} ({100 * abs(check.share):.1f} %) {way}, "
    )
    expected = length_words(check.expected_m)
    if check.agrees:
        return begin + f"within the expected ± {expected} (95 % interval)."
    if typed_m is None or check.square_m is None:
        cause = "a wrong board scale"
    else:
        cause = (
            f"squares of {1e3 * check.square_m:.1f} mm instead of {1e3 * typed_m:g} mm (measure "
            "them on the print)"
        )
    return begin + (
        f"more than the expected ± {expected} (95 % interval). Possible causes: {cause}, or "
        f"cameras that have turned relative to each other by {abs(check.vergence_deg):.2f} "
        "degrees. A second check at another distance tells them apart: a scale error is the same "
        "percentage at every distance."
    )
