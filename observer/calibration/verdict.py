"""Verdict on a calibrated rig: its depth errors in metres, and which motion it reports when."""

from __future__ import annotations

import math
from dataclasses import dataclass

from observer.calibration.fitting.stereo_fit import DepthBias, StereoFit
from observer.calibration.speed_limits import Detectable, Thing, slowest_reported
from observer.camera import StereoCalibration, StereoCamera
from observer.errors import CalibrationError
from observer.intervals import half_95
from observer.parameters import Parameters
from observer.vision.rectification import Rectification

DISTANCES_M = (1.0, 3.0, 5.0)
# A report is useful if it comes within this time, seconds.
WITHIN_S = 1.0
_SENTENCE_M = 3.0
ACROSS, TOWARDS = (1.0, 0.0, 0.0), (0.0, 0.0, -1.0)

# Thresholds of warnings.
_POOR_DEPTH = 0.1
_POOR_RMS = 0.8 / 640  # of the image's width
_POOR_ROWS_PX = 1.0
_POOR_COVERAGE = 0.6
_FEW_PAIRS = 10
# Half of the 95 % interval of the focal length, as a share of it.
_POOR_FOCAL = 0.02
_LENSES_DIFFER = 0.1
# Bend of the board: share of its longer side, and standard deviations.
_BENT, _BENT_SIGMAS = 0.004, 4.0


@dataclass(frozen=True)
class VerdictRow:
    """Expected performance at one distance.

    Attributes:
        distance_m: depth.
        noise_m: one standard deviation of the depth of one point in one frame, which averages out.
        bias_m: one standard deviation of the error that does not: the calibration's own
            uncertainty, and the persistent part of the rows' disagreement.
        depth_m: of both together. depth_share: the same, as a share of the distance.
        points: number assumed to be tracked on a person-sized thing there.
        across, towards: the slowest motion that is reported within ``WITHIN_S``; None if none is.
    """

    distance_m: float
    noise_m: float
    bias_m: float
    depth_m: float
    depth_share: float
    points: int
    across: Detectable | None
    towards: Detectable | None


@dataclass(frozen=True)
class CalibrationVerdict:
    """Verdict at all distances.

    Attributes:
        rows: at ``DISTANCES_M``. sentence: the middle one in words.
        nearest_m: depth of the largest disparity that is searched; nearer things are not seen.
        warnings: one sentence for each weakness of the rig, and what to do.
        frame_rate: 1/s, for which the delays hold.
    """

    rows: tuple[VerdictRow, ...]
    sentence: str
    warnings: tuple[str, ...]
    frame_rate: float
    nearest_m: float


def judge(fit: StereoFit, frame_rate: float) -> CalibrationVerdict:
    """Return what a freshly calibrated pair can do, for a person and default parameters.

    Args:
        frame_rate: of the cameras, 1/s.
    """
    calibration, bias = fit.calibration, fit.depth_bias
    lasting_px = 0.0 if fit.held_out is None else fit.held_out.lasting_px
    thing, parameters = Thing(), Parameters()
    camera, problem = _camera(calibration)
    nearest = camera.fb / parameters.stereo.max_disparity_px
    rows = []
    for distance in DISTANCES_M:
        noise = camera.depth_sigma(distance, thing.disparity_px)
        lasting = distance * depth_bias_share(calibration, distance, bias, lasting_px)
        across, towards = (
            slowest_reported(camera, distance, way, frame_rate, WITHIN_S, thing, parameters)
            if distance > nearest
            else None
            for way in (ACROSS, TOWARDS)
        )
        whole = math.hypot(noise, lasting)
        rows.append(
            VerdictRow(
                distance_m=distance,
                noise_m=noise,
                bias_m=lasting,
                depth_m=whole,
                depth_share=whole / distance,
                points=thing.points(camera, distance, parameters.klt_tracking.spacing_px),
                across=across,
                towards=towards,
            )
        )
    middle = next(row for row in rows if row.distance_m == _SENTENCE_M)
    if nearest > DISTANCES_M[0]:
        wanted = camera.fb / (0.8 * DISTANCES_M[0])
        problem.append(
            f"nothing nearer than {nearest:.1f} m can be measured, because disparities are "
            f"searched only up to {parameters.stereo.max_disparity_px} px; set "
            f"stereo.max_disparity_px to {16 * math.ceil(wanted / 16)} or use a smaller image size"
        )
    return CalibrationVerdict(
        rows=tuple(rows),
        sentence=_sentence(middle),
        warnings=(*problem, *_fit_warnings(fit), *_rig_warnings(calibration, middle)),
        frame_rate=frame_rate,
        nearest_m=nearest,
    )


def depth_bias_share(
    calibration: StereoCalibration,
    distance_m: float,
    bias: DepthBias | None,
    lasting_px: float = 0.0,
) -> float:
    """One standard deviation of depth's persistent error at a distance, as a share of it.

    Args:
        bias: of the fit. lasting_px: of ``HeldOut``: a persistent row error implies an equal
            column error, by distortion that the lens model does not cover.
    """
    per_disparity = distance_m / calibration.fb
    known = 0.0 if bias is None else bias.relative_sigma(per_disparity)
    return math.hypot(known, lasting_px * per_disparity)


def _camera(calibration: StereoCalibration) -> tuple[StereoCamera, list[str]]:
    """Return the rectified pair, or an approximate one and why rectification failed."""
    try:
        return Rectification(calibration).camera, []
    except CalibrationError as error:
        c = calibration
        f, cx, cy = float(c.K1[0, 0]), c.width / 2, c.height / 2
        return StereoCamera(c.width, c.height, f, f, cx, cy, c.baseline), [str(error)]


def _sentence(row: VerdictRow) -> str:
    begin = (
        f"At {row.distance_m:g} m, depth is accurate to ± {length_words(half_95(row.depth_m))} "
        f"({100 * half_95(row.depth_share):.1f} %, 95 % interval); "
    )
    if row.across is None and row.towards is None:
        return begin + f"motion of a person-sized object is not detected within {WITHIN_S:g} s."
    if row.across is None or row.towards is None:
        one = row.across or row.towards
        assert one is not None
        way, other = ("sideways", "towards you") if row.across else ("towards you", "sideways")
        return begin + (
            f"a person-sized object moving {way} at {one.speed_mps:g} m/s is detected within "
            f"{one.delay_s:.1f} s; one moving {other} is not."
        )
    delay = max(row.across.delay_s, row.towards.delay_s)
    return begin + (
        f"a person-sized object moving sideways at {row.across.speed_mps:g} m/s or towards you at "
        f"{row.towards.speed_mps:g} m/s is detected within {delay:.1f} s."
    )


def length_words(metres: float) -> str:
    """Return a length for people: mm below a centimetre, cm below a metre."""
    if metres < 0.01:
        return f"{1e3 * metres:.0f} mm" if metres >= 0.001 else "1 mm"
    if metres < 1:
        return f"{1e2 * metres:.1f} cm" if metres < 0.1 else f"{1e2 * metres:.0f} cm"
    return f"{metres:.1f} m"


def _rig_warnings(c: StereoCalibration, row: VerdictRow) -> list[str]:
    out = []
    noise = row.noise_m / row.distance_m
    if noise > _POOR_DEPTH / 2:
        better = 1.1 * c.baseline * noise / (_POOR_DEPTH / 5)
        out.append(
            f"the baseline of {1e3 * c.baseline:.0f} mm is too short for this lens: at "
            f"{row.distance_m:g} m, noise alone is ± {100 * half_95(noise):.0f} % of the depth (95 "
            f"% interval); a baseline of {1e2 * better:.0f} cm would reduce it to ± "
            f"{100 * half_95(_POOR_DEPTH / 5):.0f} %"
        )
    left, right = float(c.K1[0, 0]), float(c.K2[0, 0])
    if abs(left / right - 1) > _LENSES_DIFFER:
        out.append(
            f"the lenses differ (focal lengths {left:.0f} and {right:.0f} px); two identical "
            "lenses at the same zoom and focus share more of their views"
        )
    return out


def _fit_warnings(fit: StereoFit) -> list[str]:
    c, out = fit.calibration, []
    if fit.rms_stereo > _POOR_RMS * c.width:
        out.append(
            f"the reprojection error of {fit.rms_stereo:.1f} px is high, {0.3 * c.width / 640:.1f} "
            "px is usual; the board may be bent, or it moved during the exposures"
        )
    if fit.held_out is None:
        out.append(
            f"{fit.pairs} pairs are too few to hold some out for validation; capture 15 or more"
        )
    elif fit.held_out.p95_px > _POOR_ROWS_PX:
        out.append(
            f"the epipolar error on held-out views reaches {fit.held_out.p95_px:.1f} px, 0.5 px is "
            "usual; capture more views, with the board in the corners of the image"
        )
    if fit.held_out is not None and fit.pairs < _FEW_PAIRS:
        out.append(f"only {fit.pairs} pairs were used; 15 or more give a more reliable result")
    bend = fit.bend
    if (
        bend is not None
        and bend.height_m > _BENT * max(fit.board.size_m)
        and bend.height_m > _BENT_SIGMAS * bend.sigma_m
    ):
        out.append(
            f"the board seems to be bent by {1e3 * bend.height_m:.1f} mm; mount the print on "
            "something flat, such as glass or a metal plate, and capture the views again"
        )
    share = 0.3 if len(fit.views) > 3 else 1.0
    refused = sum(not view.used for view in fit.views)
    if refused > share * len(fit.views):
        out.append(
            f"{refused} of {len(fit.views)} views were rejected; check the reasons before you "
            "trust the rest"
        )
    for name, covered in zip(("left", "right"), fit.coverage, strict=True):
        if covered < _POOR_COVERAGE:
            out.append(
                f"the board covered only {100 * covered:.0f} % of the {name} image; outside that "
                "area the calibration is extrapolated, so capture the corners too"
            )
    out += _focal_warning(fit)
    return out


def _focal_warning(fit: StereoFit) -> list[str]:
    sides = (
        ("left", float(fit.calibration.K1[0, 0]), fit.interval_95.focal_left_px),
        ("right", float(fit.calibration.K2[0, 0]), fit.interval_95.focal_right_px),
    )
    side, focal, half = max(sides, key=lambda each: each[2] / each[1])
    if half < _POOR_FOCAL * focal:
        return []
    lowest, highest = max(0.0, focal - half), focal + half
    return [
        f"the views barely determine the focal length: that of the {side} camera may be anywhere "
        f"from {lowest:.0f} to {highest:.0f} px (95 % interval); add views with the board tilted "
        "by 30 to 45 degrees to each side, up and down, at several distances, and calibrate again"
    ]
