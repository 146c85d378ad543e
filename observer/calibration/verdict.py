"""Verdict on a calibrated rig, in metres: its depth errors, and what motion it reports when."""

from __future__ import annotations

import math
from dataclasses import dataclass

from observer.calibration.speed_limits import Detectable, Thing, depth_noise_m, slowest_reported
from observer.calibration.stereo_fit import DepthBias, StereoFit
from observer.camera import StereoCalibration, StereoCamera
from observer.errors import CalibrationError
from observer.parameters import Parameters
from observer.vision.rectification import Rectification

DISTANCES_M = (1.0, 3.0, 5.0)
# A thing is of use if it is reported within this time, seconds.
WITHIN_S = 1.0
_SENTENCE_M = 3.0
ACROSS, TOWARDS = (1.0, 0.0, 0.0), (0.0, 0.0, -1.0)

# Where warnings begin.
_POOR_DEPTH = 0.1
_POOR_RMS = 0.8 / 640  # of the image's width
_POOR_ROWS_PX = 1.0
_POOR_COVERAGE = 0.6
_FEW_PAIRS = 10
# Half of the 95 % interval of the focal length, as a share of it.
_POOR_FOCAL = 0.02
_LENSES_DIFFER = 0.1
# Of a board's longer side, and standard deviations.
_BENT, _BENT_SIGMAS = 0.004, 4.0


@dataclass(frozen=True)
class VerdictRow:
    """Expected performance at one distance.

    Attributes:
        distance_m: depth.
        noise_m: one standard deviation of the depth of one point in one frame, which averages out.
        bias_m: one standard deviation of what does not: the calibration's own uncertainty, and the
            part of the rows' disagreement that lasts.
        depth_m: of both together. depth_share: the same, as a share of the distance.
        points: that are assumed to be followed on a person-sized thing there.
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
class Verdict:
    """Verdict at all distances.

    Attributes:
        rows: at ``DISTANCES_M``. sentence: the middle one in words.
        nearest_m: depth of the largest disparity that is searched; nearer things are not seen.
        warnings: one sentence each where the rig is poor, and what to do.
        frame_rate: 1/s, that the delays hold for.
    """

    rows: tuple[VerdictRow, ...]
    sentence: str
    warnings: tuple[str, ...]
    frame_rate: float
    nearest_m: float


def judge(fit: StereoFit, frame_rate: float) -> Verdict:
    """Return what a pair that was just calibrated can do, for a person and default parameters.

    Args:
        frame_rate: of the cameras, 1/s.
    """
    calibration, bias = fit.calibration, fit.depth_bias
    lasting_px = 0.0 if fit.held_out is None else fit.held_out.lasting_px
    thing, parameters = Thing(), Parameters()
    camera, problem = _camera(calibration)
    nearest = camera.fx * camera.baseline / parameters.stereo.max_disparity_px
    rows = []
    for distance in DISTANCES_M:
        noise = depth_noise_m(camera, distance, thing.disparity_px)
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
        wanted = camera.fx * camera.baseline / (0.8 * DISTANCES_M[0])
        problem.append(
            f"nothing nearer than {nearest:.1f} m is seen, for disparities are searched up to "
            f"{parameters.stereo.max_disparity_px} px; set stereo.max_disparity_px to "
            f"{16 * math.ceil(wanted / 16)} or the cameras to a smaller image"
        )
    return Verdict(
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
    """One standard deviation of depth's lasting error at a distance, as a share of it.

    Args:
        bias: of the fit. lasting_px: of ``HeldOut``: rows that disagree for good tell that columns
            do so as much, by distortion that the lens model does not hold.
    """
    per_disparity = distance_m / (float(calibration.K1[0, 0]) * calibration.baseline)
    known = 0.0 if bias is None else bias.relative_sigma(per_disparity)
    return math.hypot(known, lasting_px * per_disparity)


def _camera(calibration: StereoCalibration) -> tuple[StereoCamera, list[str]]:
    """The rectified pair, or a likely one and why it is none."""
    try:
        return Rectification(calibration).camera, []
    except CalibrationError as error:
        c = calibration
        f, cx, cy = float(c.K1[0, 0]), c.width / 2, c.height / 2
        return StereoCamera(c.width, c.height, f, f, cx, cy, c.baseline), [str(error)]


def _sentence(row: VerdictRow) -> str:
    begin = (
        f"At {row.distance_m:g} m depth is right to {length_words(row.depth_m)} "
        f"({100 * row.depth_share:.1f} %); "
    )
    if row.across is None and row.towards is None:
        return begin + f"motion of a person-sized thing is not reported within {WITHIN_S:g} s."
    if row.across is None or row.towards is None:
        one = row.across or row.towards
        assert one is not None
        way, other = ("sideways", "towards you") if row.across else ("towards you", "sideways")
        return begin + (
            f"a person-sized thing moving at {one.speed_mps:g} m/s {way} is reported within "
            f"{one.delay_s:.1f} s, one moving {other} is not."
        )
    delay = max(row.across.delay_s, row.towards.delay_s)
    return begin + (
        f"a person-sized thing moving at {row.across.speed_mps:g} m/s sideways or "
        f"{row.towards.speed_mps:g} m/s towards you is reported within {delay:.1f} s."
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
            f"the cameras stand {1e3 * c.baseline:.0f} mm apart, too near each other for this "
            f"lens: at {row.distance_m:g} m noise alone is {100 * noise:.0f} % of the depth; "
            f"{1e2 * better:.0f} cm would make it 2 %"
        )
    left, right = float(c.K1[0, 0]), float(c.K2[0, 0])
    if abs(left / right - 1) > _LENSES_DIFFER:
        out.append(
            f"the lenses differ ({left:.0f} and {right:.0f} px of focal length); two of the same "
            f"kind at the same zoom and focus see more in common"
        )
    return out


def _fit_warnings(fit: StereoFit) -> list[str]:
    c, out = fit.calibration, []
    if fit.rms_stereo > _POOR_RMS * c.width:
        out.append(
            f"the corners fit to {fit.rms_stereo:.1f} px only, where {0.3 * c.width / 640:.1f} px "
            f"are usual; the board may be bent, or was moved while it was taken"
        )
    if fit.held_out is None:
        out.append(
            f"with {fit.pairs} pairs nothing could be left out to measure on; take 15 or more"
        )
    elif fit.held_out.p95_px > _POOR_ROWS_PX:
        out.append(
            f"on views that were left out rows disagree by up to {fit.held_out.p95_px:.1f} px, "
            f"where 0.5 px are usual; take more views, with the board in the corners of the image"
        )
    if fit.held_out is not None and fit.pairs < _FEW_PAIRS:
        out.append(f"only {fit.pairs} pairs were used; 15 or more make it surer")
    bend = fit.bend
    if (
        bend is not None
        and bend.height_m > _BENT * max(fit.board.size_m)
        and bend.height_m > _BENT_SIGMAS * bend.sigma_m
    ):
        out.append(
            f"the board seems to be bent by {1e3 * bend.height_m:.1f} mm; fix the print to "
            f"something flat, such as glass or a plate, and take the views again"
        )
    share = 0.3 if len(fit.views) > 3 else 1.0
    refused = sum(not view.used for view in fit.views)
    if refused > share * len(fit.views):
        out.append(
            f"{refused} of {len(fit.views)} views were refused; see their reasons before trusting "
            f"the rest"
        )
    for name, covered in zip(("left", "right"), fit.coverage, strict=True):
        if covered < _POOR_COVERAGE:
            out.append(
                f"the board was shown in {100 * covered:.0f} % of the {name} image only; what lies "
                f"outside is a guess, so hold it into the corners too"
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
        f"the pictures barely fix the focal length: that of the {side} camera may be anywhere from "
        f"{lowest:.0f} to {highest:.0f} px (95 % interval); add pictures of the board tilted by "
        f"30 to 45 degrees to each side and up and down, at several distances, and calibrate again"
    ]
