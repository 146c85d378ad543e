"""Flat tables of a run: one row an instant, the unit at the column's end.

``_m`` metres, ``_mps`` m/s, ``_s`` seconds, ``_rad`` radians, ``_px`` pixels, ``_m2`` and
``_m2ps2`` their squares. ``time_s`` is the source's clock, ``received_s`` the host's monotonic
one. An empty cell (null in Parquet) is what is not known.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from observer.exporting.errors import ExportError
from observer.recording.payloads import MatchedBody
from observer.recording.reader import Recording
from observer.truth.contract import TrueBody

Kind = Literal["int", "float", "text"]
Row = Mapping[str, Any]


@dataclass(frozen=True)
class Column:
    """Column of a table.

    Attributes:
        name: ends with the unit. kind: of its values. help: what it is, for the README.
    """

    name: str
    kind: Kind
    help: str


@dataclass(frozen=True)
class Table:
    """Table with its columns, and the reader of its rows, one by one.

    Attributes:
        rows: values by column; None is not known.
    """

    name: str
    help: str
    columns: tuple[Column, ...]
    rows: Callable[[Recording], Iterator[Row]]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns."""
        return tuple(column.name for column in self.columns)


def _columns(kind: Kind, help_: str, *names: str) -> tuple[Column, ...]:
    return tuple(Column(name, kind, help_) for name in names)


_AXES = ("x", "y", "z")
_UPPER = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
_POSITION = tuple(f"{axis}_m" for axis in _AXES)
_VELOCITY = tuple(f"v{axis}_mps" for axis in _AXES)
_SIZE = tuple(f"size_{axis}_m" for axis in _AXES)
_TURN = ("qw", "qx", "qy", "qz")
_POSITION_COV = tuple(f"cov_{_AXES[i]}{_AXES[j]}_m2" for i, j in _UPPER)
_VELOCITY_COV = tuple(f"cov_v{_AXES[i]}v{_AXES[j]}_m2ps2" for i, j in _UPPER)
_BOX = ("box_u0_px", "box_v0_px", "box_u1_px", "box_v1_px")

_INSTANT = (
    Column("frame", "int", "number of the frame in its source"),
    Column("time_s", "float", "exposure of the left image, the source's clock"),
)
_SEGMENT = Column("segment", "int", "number of the stretch that shares one world frame")

_OBSTACLE_COLUMNS = (
    *_INSTANT,
    _SEGMENT,
    Column("status", "text", "of the frame: ok, degraded or lost"),
    Column("id", "int", "of the track, lasting within its segment"),
    Column("state", "text", "confirmed or coasting (not seen in this frame); tentative if asked"),
    Column("motion", "text", "moving or stopped"),
    *_columns("float", "centre of the obstacle in the world", *_POSITION),
    *_columns("float", "its velocity in the world", *_VELOCITY),
    Column("speed_mps", "float", "length of the velocity"),
    Column("speed_std_mps", "float", "one standard deviation of the speed"),
    Column("velocity_time_s", "float", "the instant that the velocity belongs to"),
    *_columns("float", "covariance of the position, world axes", *_POSITION_COV),
    *_columns("float", "covariance of the velocity, world axes", *_VELOCITY_COV),
    *_columns("float", "extent along the box's own axes", *_SIZE),
    *_columns("float", "the box's attitude in the world, a unit quaternion", *_TURN),
    Column("range_m", "float", "distance from the camera"),
    Column("bearing_rad", "float", "angle to the right of the optical axis"),
    Column("closing_speed_mps", "float", "positive while the range shrinks"),
    Column("points", "int", "feature points that support it in this frame"),
    Column("significance", "float", "how far its motion stands out, standard deviations"),
    *_columns("float", "rectangle in the rectified left image", *_BOX),
    Column("why", "text", "why it counts as dynamic"),
)


def _at(frame: int, time: float) -> dict[str, Any]:
    return {"frame": frame, "time_s": time}


def _spread(names: Sequence[str], values: Sequence[Any] | None) -> dict[str, Any]:
    return dict.fromkeys(names) if values is None else dict(zip(names, values, strict=True))


def _covariance(names: Sequence[str], matrix: Sequence[Sequence[float]] | None) -> dict[str, Any]:
    return _spread(names, None if matrix is None else [matrix[i][j] for i, j in _UPPER])


def _obstacle_rows(recording: Recording) -> Iterator[Row]:
    for line in recording.lines():
        for entry in line["obstacles"]:
            yield obstacle_row(line, entry)


def obstacle_row(line: Mapping[str, Any], entry: Mapping[str, Any]) -> Row:
    """Return an obstacle of a JSON line as a row of the table ``obstacles``."""
    return {
        **_at(line["frame"], line["time"]),
        "segment": line["segment"],
        "status": line["status"],
        **{name: entry[name] for name in ("id", "state", "motion", "points", "significance")},
        **_spread(_POSITION, entry["position"]),
        **_spread(_VELOCITY, entry["velocity"]),
        "speed_mps": entry["speed"],
        "speed_std_mps": entry["speed_std"],
        "velocity_time_s": entry["velocity_time"],
        **_covariance(_POSITION_COV, entry["position_cov"]),
        **_covariance(_VELOCITY_COV, entry["velocity_cov"]),
        **_spread(_SIZE, entry["size"]),
        **_spread(_TURN, entry["orientation_wxyz"]),
        "range_m": entry["range"],
        "bearing_rad": entry["bearing"],
        "closing_speed_mps": entry["closing_speed"],
        **_spread(_BOX, entry["box_px"]),
        "why": entry.get("why"),
    }


_FRAME_COLUMNS = (
    *_INSTANT,
    _SEGMENT,
    Column("status", "text", "how far the frame may be trusted: ok, degraded or lost"),
    Column("reasons", "text", "why not further, sentences with ; between them"),
    Column("parameters_revision", "int", "of the parameters in force, see the table parameters"),
    *_columns("float", "the camera's place in the world", *(f"camera_{n}" for n in _POSITION)),
    *_columns("float", "its attitude, a unit quaternion", *(f"camera_{n}" for n in _TURN)),
    Column("obstacles", "int", "how many were reported"),
)


def _frame_rows(recording: Recording) -> Iterator[Row]:
    for line in recording.lines():
        pose = line["pose"]
        yield {
            **_at(line["frame"], line["time"]),
            "segment": line["segment"],
            "status": line["status"],
            "reasons": "; ".join(line["reasons"]),
            "parameters_revision": line["parameters_revision"],
            **_spread([f"camera_{n}" for n in _POSITION], pose and pose["position"]),
            **_spread([f"camera_{n}" for n in _TURN], pose and pose["orientation_wxyz"]),
            "obstacles": len(line["obstacles"]),
        }


_BODY_COLUMNS = (
    Column("id", "int", "of the true body"),
    Column("name", "text", "of the true body"),
    Column("role", "text", "obstacle or observer"),
    *_columns("float", "its centre", *_POSITION),
    *_columns("float", "its velocity", *_VELOCITY),
    Column("speed_mps", "float", "length of the velocity"),
    Column("commanded_speed_mps", "float", "as commanded, where that is known"),
    *_columns("float", "length, width and height", "length_m", "width_m", "height_m"),
    Column("yaw_rad", "float", "its heading"),
    Column("visible", "float", "share of it that the camera can see, 0 to 1"),
)
_TRUTH_COLUMNS = (*_INSTANT, *_BODY_COLUMNS)
_MATCHED_COLUMNS = (
    *_INSTANT,
    *_BODY_COLUMNS,
    Column("track_id", "int", "of the obstacle that it was taken for, as in obstacles"),
)


def _body_cells(body: TrueBody | MatchedBody, speed: float) -> dict[str, Any]:
    return {
        "id": body.id,
        "name": body.name,
        "role": body.role,
        **_spread(_POSITION, [float(value) for value in body.position]),
        **_spread(_VELOCITY, [float(value) for value in body.velocity]),
        "speed_mps": speed,
        "commanded_speed_mps": body.commanded_speed,
        **_spread(("length_m", "width_m", "height_m"), [float(value) for value in body.size]),
        "yaw_rad": body.yaw,
        "visible": body.visible,
    }


def _truth_rows(recording: Recording) -> Iterator[Row]:
    for sample in recording.truth_samples():
        for body in sample.bodies:
            cells = _body_cells(body, float(sum(value * value for value in body.velocity)) ** 0.5)
            yield {**_at(sample.frame, sample.time), **cells}


def _matched_rows(recording: Recording) -> Iterator[Row]:
    for matched in recording.matched_truth():
        for body in matched.bodies:
            cells = _body_cells(body, body.speed)
            yield {**_at(matched.frame, matched.time), **cells, "track_id": body.track_id}


_ODOMETRY_COLUMNS = (
    *_INSTANT,
    *_columns("float", "the robot's place by its wheels since its start", "x_m", "y_m"),
    Column("yaw_rad", "float", "its heading by its wheels, positive to the left"),
)


def _odometry_rows(recording: Recording) -> Iterator[Row]:
    for frame in recording.frames:
        told = frame.odometry
        if told is not None:
            instant = _at(frame.index, frame.time)
            yield {**instant, "x_m": told.x, "y_m": told.y, "yaw_rad": told.yaw}


_ROBOT_COLUMNS = (
    Column("received_s", "float", "the host's monotonic clock"),
    Column("time_s", "float", "the source's clock, where known"),
    Column("role", "text", "observer or obstacle"),
    Column("sent_speed_mps", "float", "as really sent"),
    Column("sent_turn_rate_radps", "float", "as really sent"),
    Column("encoder_speed_mps", "float", "as the robot told"),
    Column("encoder_turn_rate_radps", "float", "as the robot told"),
    *_columns("float", "its place by its wheels", "x_m", "y_m"),
    Column("yaw_rad", "float", "its heading by its wheels"),
)


def _robot_rows(recording: Recording) -> Iterator[Row]:
    for row in recording.robot_rows():
        yield {
            "received_s": row.received,
            "time_s": row.time,
            "role": row.role,
            "sent_speed_mps": row.sent_speed,
            "sent_turn_rate_radps": row.sent_turn_rate,
            "encoder_speed_mps": row.encoder_speed,
            "encoder_turn_rate_radps": row.encoder_turn_rate,
            "x_m": row.x,
            "y_m": row.y,
            "yaw_rad": row.yaw,
        }


_PARAMETER_COLUMNS = (
    Column("revision", "int", "counted up with every change, but those of the guard"),
    Column("from_position", "int", "of the first recorded frame that they act on, from 0"),
    Column("name", "text", "of the parameter"),
    Column("value", "text", "as JSON"),
)


def _parameter_rows(recording: Recording) -> Iterator[Row]:
    for position, revision in recording.positioned_revisions:
        for name, value in revision.values.items():
            instant = {"revision": revision.revision, "from_position": position}
            yield {**instant, "name": name, "value": json.dumps(value)}


TABLES: Mapping[str, Table] = {
    table.name: table
    for table in (
        Table(
            "obstacles",
            "one row for each obstacle at each frame, tracks by segment and id",
            _OBSTACLE_COLUMNS,
            _obstacle_rows,
        ),
        Table("frames", "one row for each observed frame", _FRAME_COLUMNS, _frame_rows),
        Table(
            "truth",
            "one row for each true body at each frame, in the truth's own world",
            _TRUTH_COLUMNS,
            _truth_rows,
        ),
        Table(
            "matched_truth",
            "the same in the world of the obstacles, with the track it was taken for",
            _MATCHED_COLUMNS,
            _matched_rows,
        ),
        Table(
            "odometry",
            "one row for each frame at which the robot's wheels told something",
            _ODOMETRY_COLUMNS,
            _odometry_rows,
        ),
        Table(
            "robots",
            "one row for each robot at each instant it was heard",
            _ROBOT_COLUMNS,
            _robot_rows,
        ),
        Table(
            "parameters",
            "all parameters that were in force, by revision",
            _PARAMETER_COLUMNS,
            _parameter_rows,
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
