"""The numbers behind the picture of each step, as comma-separated values."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np

from observer.steps.nine_steps import one_step
from observer.steps.pair import ObservedPair
from observer.steps.space_steps import true_speed_of
from observer.vision.stereo import sample_disparity

_Rows = tuple[Sequence[str], Iterable[Sequence[Any]]]


def step_table(pair: ObservedPair, number: int) -> str:
    """Return the data of one step as CSV with a header; unknown values are empty.

    Coordinates are pixels in rectified images, or metres in the camera frame of the instant that
    the column's name gives.

    Raises:
        ValueError: there is no such step.
    """
    step = one_step(pair, number)
    header, rows = ((), ()) if step.missing else _TABLES[number - 1](pair)
    file = io.StringIO()
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(header)
    writer.writerows([_cell(value) for value in row] for row in rows)
    return file.getvalue()


def _cell(value: Any) -> Any:
    """Return a value as it is written: plain, with all its digits, empty if unknown."""
    if value is None or (isinstance(value, float | np.floating) and not np.isfinite(value)):
        return ""
    if isinstance(value, bool | np.bool_):
        return int(value)
    return value.item() if isinstance(value, np.generic) else value


def _images(pair: ObservedPair) -> _Rows:
    return ("name", "value", "unit"), [
        (number.name, number.value, number.unit) for number in one_step(pair, 1).numbers
    ]


def _features(pair: ObservedPair) -> _Rows:
    return ("u_t_px", "v_t_px"), pair.trace["features_px"]


def _matches(pair: ObservedPair) -> _Rows:
    matches = pair.trace["matches"]
    rows = np.hstack([matches.previous, matches.current])
    return ("u_t_px", "v_t_px", "u_t+dt_px", "v_t+dt_px"), rows


def _ego_motion(pair: ObservedPair) -> _Rows:
    matches, ego = pair.trace["matches"], pair.trace["ego_motion"]
    predicted = ego.predict(matches.previous)
    rows = [
        (*before, *after, *expected, inlier)
        for before, after, expected, inlier in zip(
            matches.previous, matches.current, predicted, ego.inliers, strict=True
        )
    ]
    header = ("u_t_px", "v_t_px", "u_t+dt_px", "v_t+dt_px", "u_model_px", "v_model_px", "inlier")
    return header, rows


def _transformation(pair: ObservedPair) -> _Rows:
    return ("column_1", "column_2", "column_3"), pair.trace["ego_motion"].homography


def _flow(pair: ObservedPair) -> _Rows:
    trace = pair.trace
    length = np.linalg.norm(trace["flow_residual_px"], axis=1)
    rows = zip(trace["flow_px"], trace["flow_observed_px"], length, trace["dynamic"], strict=True)
    header = ("u_t_px", "v_t_px", "u_transformed_px", "v_transformed_px", "residual_px", "dynamic")
    return header, [(*start, *end, size, dynamic) for start, end, size, dynamic in rows]


def _stereo(pair: ObservedPair) -> _Rows:
    px = pair.trace["features_px"].astype(np.float64)
    disparity = sample_disparity(pair.trace["disparity"], px)
    points = pair.camera.triangulate(px, disparity)
    rows = np.hstack([px, disparity[:, None], points])
    return ("u_t_px", "v_t_px", "disparity_px", "x_m", "y_m", "z_m"), rows


def _displacement(pair: ObservedPair) -> _Rows:
    motions = pair.trace["motions"]
    speed = np.linalg.norm(motions.velocity, axis=1)
    header = ("x_t_m", "y_t_m", "z_t_m", "x_t+dt_m", "y_t+dt_m", "z_t+dt_m",
              "vx_mps", "vy_mps", "vz_mps", "speed_mps")  # fmt: skip
    parts = (motions.points_previous, motions.points_current, motions.velocity, speed[:, None])
    return header, np.hstack(parts)


def _obstacles(pair: ObservedPair) -> _Rows:
    header = ("id", "state", "x_m", "y_m", "z_m", "speed_mps", "speed_std_mps", "true_speed_mps",
              "points", "significance", "u0_px", "v0_px", "u1_px", "v1_px")  # fmt: skip
    return header, [
        (one.id, str(one.state), *one.position_camera, one.speed, one.speed_std,
         true_speed_of(pair, one.id), one.points, one.significance, *one.box_px)
        for one in pair.observation.obstacles
    ]  # fmt: skip


_TABLES: tuple[Callable[[ObservedPair], _Rows], ...] = (
    _images,
    _features,
    _matches,
    _ego_motion,
    _transformation,
    _flow,
    _stereo,
    _displacement,
    _obstacles,
)
