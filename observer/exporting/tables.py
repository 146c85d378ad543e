"""Flat tables of a run: one row per instant, the unit at the end of the column's name.

``_m`` metres, ``_mps`` m/s, ``_s`` seconds, ``_rad`` radians, ``_px`` pixels, ``_m2`` and
``_m2ps2`` squares of metres and m/s. ``time_s`` is the source's clock, ``received_s`` the host's
monotonic one. An empty cell (null in Parquet) means unknown.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Literal

import msgspec

from observer.exporting.choices import TableName
from observer.exporting.errors import ExportError
from observer.recording.reader import Recording

Kind = Literal["int", "float", "text"]
Row = Mapping[str, Any]


@dataclass(frozen=True)
class Column:
    """Column of a table.

    Attributes:
        name: ends with the unit. kind: of its values. help: what it is, for the README.
        key: of its value in a record; empty if equal to the name.
        place: indices within the value, if that is a vector or a matrix.
    """

    name: str
    kind: Kind
    help: str
    key: str = ""
    place: tuple[int, ...] = ()

    def cell(self, record: Mapping[str, Any]) -> Any:
        """Return its value in a record; None means unknown."""
        value = record[self.key or self.name]
        for index in self.place:
            value = None if value is None else value[index]
        return value


@dataclass(frozen=True)
class Table:
    """Table with its columns, and a reader that yields the record of each row."""

    name: TableName
    help: str
    columns: tuple[Column, ...]
    records: Callable[[Recording], Iterator[Mapping[str, Any]]]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns."""
        return tuple(column.name for column in self.columns)

    def rows(self, recording: Recording) -> Iterator[Row]:
        """Yield the rows: values by column; None means unknown."""
        for record in self.records(recording):
            yield {column.name: column.cell(record) for column in self.columns}


def _vector(help_: str, key: str, *names: str) -> tuple[Column, ...]:
    return tuple(Column(name, "float", help_, key, (k,)) for k, name in enumerate(names))


def _covariance(help_: str, key: str, name: str) -> tuple[Column, ...]:
    """Return the upper triangle of a matrix; ``name`` has placeholders for two axes."""
    return tuple(
        Column(name.format(_AXES[i], _AXES[j]), "float", help_, key, (i, j))
        for i in range(3)
        for j in range(i, 3)
    )


_AXES = ("x", "y", "z")
_POSITION = tuple(f"{axis}_m" for axis in _AXES)
_VELOCITY = tuple(f"v{axis}_mps" for axis in _AXES)
_SIZE = tuple(f"size_{axis}_m" for axis in _AXES)
_TURN = ("qw", "qx", "qy", "qz")
_BOX = ("box_u0_px", "box_v0_px", "box_u1_px", "box_v1_px")

_INSTANT = (
    Column("frame", "int", "number of the frame in its source"),
    Column("time_s", "float", "exposure of the left image, on the source's clock", "time"),
)
_SEGMENT = Column(
    "segment", "int", "number of the segment, in which all frames share one world frame"
)

_OBSTACLE_COLUMNS = (
    *_INSTANT,
    _SEGMENT,
    Column("status", "text", "of the frame: ok, degraded or lost"),
    Column("id", "int", "track id, constant within its segment"),
    Column(
        "state", "text", "confirmed or coasting (not seen in this frame); tentative if requested"
    ),
    Column("motion", "text", "moving or stopped"),
    *_vector("centre of the obstacle in the world", "position", *_POSITION),
    *_vector("velocity in the world", "velocity", *_VELOCITY),
    Column("speed_mps", "float", "magnitude of the velocity", "speed"),
    Column(
        "speed_std_mps",
        "float",
        "standard deviation of the speed",
        "speed_std",
    ),
    Column("velocity_time_s", "float", "time to which the velocity refers", "velocity_time"),
    *_covariance("covariance of the position, world axes", "position_cov", "cov_{}{}_m2"),
    *_covariance("covariance of the velocity, world axes", "velocity_cov", "cov_v{}v{}_m2ps2"),
    *_vector("extent along the axes of the box", "size", *_SIZE),
    *_vector("orientation of the box in the world, unit quaternion", "orientation_wxyz", *_TURN),
    Column("range_m", "float", "distance from the camera", "range"),
    Column("bearing_rad", "float", "angle to the right of the optical axis", "bearing"),
    Column("closing_speed_mps", "float", "positive while the range decreases", "closing_speed"),
    Column("points", "int", "feature points supporting it in this frame"),
    Column("significance", "float", "significance of its motion: standard deviations above zero"),
    *_vector("rectangle in the rectified left image", "box_px", *_BOX),
    Column("why", "text", "why it counts as moving"),
)


def _obstacles(recording: Recording) -> Iterator[Row]:
    for line in recording.lines():
        for entry in line["obstacles"]:
            yield {**line, "why": None, **entry}


_FRAME_COLUMNS = (
    *_INSTANT,
    _SEGMENT,
    Column("status", "text", "reliability of the frame: ok, degraded or lost"),
    Column("reasons", "text", "reasons for it, separated by ;"),
    Column("parameters_revision", "int", "of the parameters used, see the table parameters"),
    *_vector("camera position in the world", "position", *(f"camera_{name}" for name in _POSITION)),
    *_vector(
        "camera orientation, unit quaternion", "orientation_wxyz", *(f"camera_{n}" for n in _TURN)
    ),
    Column("obstacles", "int", "number of reported obstacles"),
    Column(
        "source_position", "int", "position within the source, which repeats if it plays in a loop"
    ),
    Column(
        "source_time_s", "float", "time within the source, which repeats likewise", "source_time"
    ),
)


def _frames(recording: Recording) -> Iterator[Row]:
    lost = {"position": None, "orientation_wxyz": None}
    for position, line in recording.positioned_lines():
        frame = None if position is None else recording.frames[position]
        within = {
            "source_position": None if frame is None else frame.source_position,
            "source_time": None if frame is None else frame.source_time,
        }
        summary = {"reasons": "; ".join(line["reasons"]), "obstacles": len(line["obstacles"])}
        yield {**line, **(line["pose"] or lost), **summary, **within}


_TRUTH_COLUMNS = (
    *_INSTANT,
    Column("id", "int", "of the true body"),
    Column("name", "text", "of the true body"),
    Column("role", "text", "obstacle or observer"),
    *_vector("its centre", "position", *_POSITION),
    *_vector("its velocity", "velocity", *_VELOCITY),
    Column("speed_mps", "float", "magnitude of the velocity", "speed"),
    Column("commanded_speed_mps", "float", "as commanded, where that is known", "commanded_speed"),
    *_vector("length, width and height", "size", "length_m", "width_m", "height_m"),
    Column("yaw_rad", "float", "its heading", "yaw"),
    Column("visible", "float", "fraction visible to the camera, 0 to 1"),
)
_MATCHED_COLUMNS = (
    *_TRUTH_COLUMNS,
    Column("track_id", "int", "id of the track matched to it, as in obstacles"),
)


_BODY_VECTORS = ("position", "velocity", "size")


def _truth(recording: Recording) -> Iterator[Row]:
    samples = (s for _, truth in recording.truths() if truth is not None for s in truth.samples)
    for sample in samples:
        instant = {"frame": sample.frame, "time": sample.time}
        for body in sample.bodies:
            vectors = {name: getattr(body, name).tolist() for name in _BODY_VECTORS}
            speed = sum(value * value for value in vectors["velocity"]) ** 0.5
            yield {**vars(body), **vectors, "speed": speed, **instant}


def _matched(recording: Recording) -> Iterator[Row]:
    for matched in recording.matched_truth():
        for body in matched.bodies:
            yield {**msgspec.structs.asdict(body), "frame": matched.frame, "time": matched.time}


_ODOMETRY_COLUMNS = (
    *_INSTANT,
    Column("x_m", "float", "robot position by wheel odometry since the start", "x"),
    Column("y_m", "float", "robot position by wheel odometry since the start", "y"),
    Column("yaw_rad", "float", "heading by wheel odometry, positive to the left", "yaw"),
)


def _odometry(recording: Recording) -> Iterator[Row]:
    for frame in recording.frames:
        if frame.odometry is not None:
            yield {"frame": frame.index, "time": frame.time, **vars(frame.odometry)}


_ROBOT_COLUMNS = (
    Column("received_s", "float", "the host's monotonic clock", "received"),
    Column("time_s", "float", "the source's clock, if known", "time"),
    Column("role", "text", "observer or obstacle"),
    Column("sent_speed_mps", "float", "as actually sent", "sent_speed"),
    Column("sent_turn_rate_radps", "float", "as actually sent", "sent_turn_rate"),
    Column("encoder_speed_mps", "float", "as reported by the robot", "encoder_speed"),
    Column("encoder_turn_rate_radps", "float", "as reported by the robot", "encoder_turn_rate"),
    Column("x_m", "float", "position by wheel odometry", "x"),
    Column("y_m", "float", "position by wheel odometry", "y"),
    Column("yaw_rad", "float", "heading by wheel odometry", "yaw"),
)


def _robots(recording: Recording) -> Iterator[Row]:
    return map(msgspec.structs.asdict, recording.robot_rows())


_GOAL_COLUMNS = (
    Column("received_s", "float", "the host's monotonic clock of the robot's status", "received"),
    Column("time_s", "float", "the source's clock, if known", "time"),
    Column("state", "text", "driving, reached or ended"),
    Column("reason", "text", "what the robot does and why", "sentence"),
    Column("ahead_m", "float", "the goal, seen from the robot", "ahead"),
    Column("left_m", "float", "the goal, seen from the robot", "left"),
    Column("waits_for", "int", "track for which the robot stops or swerves"),
    Column("meets_s", "float", "time until it would meet that track"),
    Column(
        "declared_risk_per_m",
        "float",
        "accepted probability of a contact with tracked obstacles, per metre driven",
        "risk_per_metre",
    ),
    Column("planned_risk_per_m", "float", "of the planned path", "planned_risk_per_metre"),
    Column("meets_ahead_m", "float", "where it would meet that track, seen from the robot"),
    Column("meets_left_m", "float", "where it would meet that track, seen from the robot"),
    Column(
        "refused",
        "text",
        "rejected paths, as JSON: direction (rad to the left), speed_mps, path (m "
        "ahead and left), cause (risk, later, guard or surface), risk, track, meets_s, guard",
    ),
)


def _goals(recording: Recording) -> Iterator[Row]:
    for row in recording.robot_rows():
        goal = row.facts.get("goal")
        if isinstance(goal, dict):
            ahead, left = goal.get("place") or (None, None)
            # Older recordings have neither of these.
            meets_ahead, meets_left = goal.get("meets_at") or (None, None)
            yield {
                **goal,
                "received": row.received,
                "time": row.time,
                "ahead": ahead,
                "left": left,
                "meets_ahead_m": meets_ahead,
                "meets_left_m": meets_left,
                "refused": json.dumps(goal.get("refused", [])),
            }


_MAP_COLUMNS = (
    *_INSTANT,
    Column("received_s", "float", "the host's monotonic clock of the frame", "received"),
    *_vector("the robot, by wheel odometry", "robot", "robot_x_m", "robot_y_m", "robot_yaw_rad"),
    Column("corner_x_m", "float", "corner of the grid, by wheel odometry", "x"),
    Column("corner_y_m", "float", "corner of the grid, by wheel odometry", "y"),
    Column("cell_m", "float", "side of a cell"),
    Column("size", "int", "cells along each side, y within x"),
    Column(
        "runs",
        "text",
        "how many cells in a row are unknown, free, blocked, unknown and so on, as JSON; in numpy: "
        "repeat(arange(len(runs)) % 3, runs).reshape(size, size)",
    ),
)


def _maps(recording: Recording) -> Iterator[Row]:
    for payload in recording.local_maps():
        runs = json.dumps(payload.map.runs, separators=(",", ":"))
        yield {**vars(payload.map), "frame": payload.frame, "time": payload.time, "runs": runs}


_PARAMETER_COLUMNS = (
    Column("revision", "int", "incremented by every change except those of guard and navigation"),
    Column("from_position", "int", "index of the first recorded frame they apply to, from 0"),
    Column("name", "text", "of the parameter"),
    Column("value", "text", "as JSON"),
)


def _parameters(recording: Recording) -> Iterator[Row]:
    for position, revision in recording.positioned_revisions:
        for name, value in revision.values.items():
            instant = {"revision": revision.revision, "from_position": position}
            yield {**instant, "name": name, "value": json.dumps(value)}


TABLES: Mapping[str, Table] = {
    table.name: table
    for table in (
        Table(
            "obstacles",
            "one row per obstacle and frame, tracks by segment and id",
            _OBSTACLE_COLUMNS,
            _obstacles,
        ),
        Table("frames", "one row per observed frame", _FRAME_COLUMNS, _frames),
        Table(
            "truth",
            "one row per ground-truth body and frame, in the world frame of the ground truth",
            _TRUTH_COLUMNS,
            _truth,
        ),
        Table(
            "matched_truth",
            "one row per ground-truth body and frame, in the world frame of the obstacles, with "
            "the matched track",
            _MATCHED_COLUMNS,
            _matched,
        ),
        Table(
            "odometry",
            "one row per frame with wheel odometry",
            _ODOMETRY_COLUMNS,
            _odometry,
        ),
        Table(
            "robots",
            "one row per robot and status message",
            _ROBOT_COLUMNS,
            _robots,
        ),
        Table(
            "goal",
            "one row per status message of a robot that was sent to a goal",
            _GOAL_COLUMNS,
            _goals,
        ),
        Table(
            "map",
            "one row per local map that was used to plan the way to a goal",
            _MAP_COLUMNS,
            _maps,
        ),
        Table(
            "parameters",
            "all parameters used, by revision",
            _PARAMETER_COLUMNS,
            _parameters,
        ),
    )
}


def find_table(name: str) -> Table:
    """Return a table by its name.

    Raises:
        ExportError: there is no such table.
    """
    if name not in TABLES:
        raise ExportError(f"there is no table {name!r}; there are: {', '.join(TABLES)}")
    return TABLES[name]
