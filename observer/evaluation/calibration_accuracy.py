"""Accuracy of a calibration with a hand-held board, where the cameras are known exactly.

A simulated person shows a board, its corners are detected in noisy images, both cameras are fitted,
and the depth of another simulated place is measured with the result. Everything is compared with
the simulated cameras.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from observer.calibration.boards.board import BoardView
from observer.calibration.boards.detection import detect_board, same_numbering
from observer.calibration.fitting.fit import fit_stereo
from observer.calibration.fitting.held_out import vertical_errors
from observer.calibration.fitting.lens import directions
from observer.calibration.fitting.uncertainty import view_angles_deg
from observer.camera import StereoCalibration, as_gray
from observer.errors import ScenarioError
from observer.evaluation.targets import Target
from observer.parameters import StereoParameters
from observer.simulation.held_board import HeldBoard, corners_px
from observer.simulation.imaging import StereoImager
from observer.simulation.scenarios import load_scenario
from observer.simulation.visibility import cast
from observer.simulation.world import World
from observer.types import Image
from observer.vision.rectification import Rectification
from observer.vision.stereo import disparity_map

BOARD_SCENARIO = "calibration"
# The same cameras elsewhere.
DEPTH_SCENARIO = "webcams"
POSES = 20
# Pairs of images of the other place, spread over the scenario's duration.
SCENES = 6
# Metres along the left camera's axis: range in which depth is evaluated.
DEPTH_M = (2.5, 3.5)
# Pixels between two cast rays, in both directions.
_STEP_PX = 2


@dataclass(frozen=True)
class CameraErrors:
    """Differences of a calibration from the true cameras, absolute values.

    Attributes:
        focal_percent: the worst of fx and fy of both cameras.
        baseline_percent: of the distance between the two cameras.
        rotation_deg: angle of the rotation from the true R to the estimated one.
        turn_y_deg: part of that rotation about the right camera's y axis.
        pitch_deg, vergence_deg, roll_deg: errors of ``view_angles_deg``, by which both images are
            rotated. A wrong principal point compensates for part of ``turn_y``.
    """

    focal_percent: float
    baseline_percent: float
    rotation_deg: float
    turn_y_deg: float
    pitch_deg: float
    vergence_deg: float
    roll_deg: float


@dataclass(frozen=True)
class DepthAccuracy:
    """Relative errors of distances along the left camera's lines of sight, by dense stereo.

    Attributes:
        count: lines of sight that hit a surface within ``DEPTH_M`` and were matched.
        matched: share of all lines of sight that hit a surface there.
        median_percent: median absolute error. bias_percent: median error; positive where things
            seem too far away. spread_percent: half the distance between the errors' 16th and 84th
            percentiles. All None if nothing was matched.
    """

    count: int
    matched: float
    median_percent: float | None
    bias_percent: float | None
    spread_percent: float | None


@dataclass(frozen=True, eq=False)
class Scene:
    """Pair of images of a simulated place.

    Attributes:
        time: seconds. left, right: as taken, (H, W) grey.
    """

    time: float
    left: Image
    right: Image


@dataclass(frozen=True)
class CalibrationAccuracy:
    """Result of one seed.

    Attributes:
        seed: of both scenarios.
        poses: of the board that were shown. pairs: those that both cameras saw and the fit used.
        refused: views that the fit rejected.
        errors: of the calibration.
        rms_px: root mean square distance of the corners in both images.
        held_out_p95_px: of the vertical errors on held-out views; None if there were too few views.
        exact_p95_px: of the vertical errors of noise-free corners, at all poses of the scenario,
            shown or not: the error of the calibration alone.
        depth: measured with this calibration. depth_by_truth: measured in the same images with
            the true cameras, so that only matching errors remain.
        detection_s: time to detect the corners in all images. fit_s: time to calibrate.
    """

    seed: int
    poses: int
    pairs: int
    refused: int
    errors: CameraErrors
    rms_px: float
    held_out_p95_px: float | None
    exact_p95_px: float
    depth: DepthAccuracy
    depth_by_truth: DepthAccuracy
    detection_s: float
    fit_s: float


def calibration_accuracy(
    seed: int,
    *,
    poses: int = POSES,
    scenes: int = SCENES,
    clock: Callable[[], float] = time.perf_counter,
) -> CalibrationAccuracy:
    """Calibrate the simulated cameras with a board shown in one seed's poses.

    Args:
        poses: how many, spread evenly over those of the scenario.
        scenes: pairs of images in which depth is measured.
        clock: seconds; used only to measure durations.

    Raises:
        CalibrationError: the views do not give a calibration.
        ScenarioError: the two scenarios have different cameras, or no board is held.
    """
    world = World(load_scenario(BOARD_SCENARIO), seed)
    place = World(load_scenario(DEPTH_SCENARIO), seed)
    truth = world.true_calibration
    if world.board is None or not same_cameras(truth, place.true_calibration):
        raise ScenarioError(
            f"{BOARD_SCENARIO} must contain a board before the cameras of {DEPTH_SCENARIO}"
        )
    held = world.board
    views, detection_s = _views(world, held, poses, clock)
    began = clock()
    fit = fit_stereo(views, held.board, truth.width, truth.height)
    fit_s = clock() - began
    images = scenes_of(place, scenes)
    return CalibrationAccuracy(
        seed=seed,
        poses=len(views),
        pairs=fit.pairs,
        refused=sum(not view.used for view in fit.views),
        errors=camera_errors(fit.calibration, truth),
        rms_px=fit.rms_stereo,
        held_out_p95_px=None if fit.held_out is None else fit.held_out.p95_px,
        exact_p95_px=exact_row_error_p95(world, held, fit.calibration),
        depth=depth_accuracy(place, fit.calibration, images),
        depth_by_truth=depth_accuracy(place, truth, images),
        detection_s=detection_s,
        fit_s=fit_s,
    )


def calibration_targets(runs: Sequence[CalibrationAccuracy]) -> dict[str, tuple[Target, ...]]:
    """Return the targets over all seeds, for the ``worst`` and the ``median`` one."""
    figures: list[tuple[str, float, list[float | None]]] = [
        ("focal length, %", 0.3, [r.errors.focal_percent for r in runs]),
        ("baseline, %", 0.5, [r.errors.baseline_percent for r in runs]),
        ("rotation, deg", 0.05, [r.errors.rotation_deg for r in runs]),
        ("apparent vergence, deg", 0.02, [r.errors.vergence_deg for r in runs]),
        ("rows on held-out views, p95, px", 0.3, [r.held_out_p95_px for r in runs]),
        ("depth at 3 m, median, %", 2.0, [r.depth.median_percent for r in runs]),
    ]

    def over(choose: Callable[[Sequence[float]], float]) -> tuple[Target, ...]:
        found = []
        for name, most, values in figures:
            known = [v for v in values if v is not None]
            value = choose(known) if known and len(known) == len(values) else None
            found.append(Target(name, None, most, value, len(values)))
        return tuple(found)

    return {"worst": over(max), "median": over(statistics.median)}


def camera_errors(found: StereoCalibration, truth: StereoCalibration) -> CameraErrors:
    """Return the errors of a calibration."""
    focal = [
        abs(K[k, k] / true[k, k] - 1)
        for K, true in ((found.K1, truth.K1), (found.K2, truth.K2))
        for k in (0, 1)
    ]
    turn = np.degrees(np.ravel(cv2.Rodrigues(found.R @ truth.R.T)[0]))
    pitch, vergence, roll = np.abs(view_angles_deg(found) - view_angles_deg(truth)).tolist()
    return CameraErrors(
        focal_percent=100 * float(max(focal)),
        baseline_percent=100 * abs(found.baseline / truth.baseline - 1),
        rotation_deg=float(np.linalg.norm(turn)),
        turn_y_deg=float(abs(turn[1])),
        pitch_deg=pitch,
        vergence_deg=vergence,
        roll_deg=roll,
    )


def same_cameras(a: StereoCalibration, b: StereoCalibration) -> bool:
    """Return whether two calibrations are of the same cameras, to the last digit."""
    names = ("width", "height", "distortion_model", "K1", "D1", "K2", "D2", "R", "T")
    return all(np.array_equal(getattr(a, name), getattr(b, name)) for name in names)


def exact_row_error_p95(world: World, held: HeldBoard, calibration: StereoCalibration) -> float:
    """Return the 95th percentile, px, of the vertical errors of corners at their true positions.

    It covers all held poses, wherever both images show the corner.
    """
    truth, errors = world.true_calibration, []
    last = np.array([truth.width, truth.height]) - 1
    for instant in held.motion.held_at:
        left, right = corners_px(truth, world.board_pose(instant), held.board.object_points)
        inside = np.logical_and.reduce([(px >= 0) & (px <= last) for px in (left, right)]).all(1)
        errors.append(vertical_errors(calibration, left[inside], right[inside]))
    return float(np.percentile(np.abs(np.concatenate(errors)), 95))


def depth_accuracy(
    world: World, calibration: StereoCalibration, scenes: Sequence[Scene]
) -> DepthAccuracy:
    """Compare the distances that dense stereo measures under a calibration with the true ones.

    Each rectified pixel is mapped back to the left image as taken, by the calibration, and from
    there to the true camera's ray. A wrong lens model therefore counts by its effect on the
    distance along that ray.
    """
    rectification = Rectification(calibration)
    camera = rectification.camera
    true = world.true_calibration
    v, u = np.mgrid[0 : camera.height : _STEP_PX, 0 : camera.width : _STEP_PX].reshape(2, -1)
    rectified = np.stack([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy], axis=1)
    rectified = np.column_stack([rectified, np.ones(len(u))])
    zero = np.zeros(3)
    px, _ = cv2.projectPoints(
        rectified @ rectification.R_rectified_left, zero, zero, calibration.K1, calibration.D1
    )
    rays = directions("radtan", true.K1, true.D1, np.asarray(px, np.float64).reshape(-1, 2))
    errors, seen = [], 0
    for scene in scenes:
        pair = rectification.apply(scene.left, scene.right)
        disparity = disparity_map(*pair, StereoParameters())[v, u]
        hits = cast(world, world.T_room_left(scene.time).inverse(), rays[:, :2], scene.time)
        with np.errstate(divide="ignore"):
            z = 1 / hits.inverse_depth
        there = (z >= DEPTH_M[0]) & (z <= DEPTH_M[1])
        seen += int(np.count_nonzero(there))
        chosen = there & np.isfinite(disparity)
        measured = camera.fb / disparity[chosen]
        measured *= np.linalg.norm(rectified[chosen], axis=1)
        errors.append(measured / (z[chosen] * np.linalg.norm(rays[chosen], axis=1)) - 1)
    every = 100 * np.concatenate(errors) if errors else np.zeros(0)
    if not len(every):
        return DepthAccuracy(0, 0.0, None, None, None)
    low, middle, high = np.percentile(every, [16, 50, 84])
    return DepthAccuracy(
        count=len(every),
        matched=len(every) / seen,
        median_percent=float(np.median(np.abs(every))),
        bias_percent=float(middle),
        spread_percent=float(high - low) / 2,
    )


def _views(
    world: World, held: HeldBoard, poses: int, clock: Callable[[], float]
) -> tuple[list[BoardView], float]:
    """Return the board at evenly spread poses as seen by both cameras, and the detection time."""
    imager = StereoImager(world)
    times = held.motion.held_at
    chosen = np.unique(np.linspace(0, len(times) - 1, min(poses, len(times))).round().astype(int))
    views, spent = [], 0.0
    for k in chosen.tolist():
        images = imager.pair(k, times[k])
        began = clock()
        left, right = (detect_board(image, held.board) for image in images)
        if left is not None and right is not None:
            right = same_numbering(left, right, held.board)
        spent += clock() - began
        views.append(BoardView(str(k), left, right))
    return views, spent


def scenes_of(world: World, count: int) -> list[Scene]:
    """Return pairs of images at evenly spread instants."""
    imager = StereoImager(world)
    length = world.scenario.duration_s
    scenes = []
    for k in range(count):
        instant = length * (k + 0.5) / count
        left, right = imager.pair(k, instant)
        scenes.append(Scene(instant, as_gray(left), as_gray(right)))
    return scenes
