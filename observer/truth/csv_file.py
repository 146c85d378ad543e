"""Ground truth as a table, ``truth.csv``: one row per body and frame, in the world frame.

Columns: ``frame,t,id,x,y,z,vx,vy,vz,visible,size_x,size_y,size_z,yaw`` (metres, m/s, radians,
seconds on the source's clock; sizes are length, width, height as in ``TrueBody``), and optionally
``name,role,commanded_speed``, ``box_u0,box_v0,box_u1,box_v1`` (pixels), ``kind`` and
``T_world_camera`` as ``camera_x`` ... ``camera_qw`` .... Further columns are ignored. An empty
``visible``, ``commanded_speed``, box or ``kind`` is unknown; an empty position means that the body
was not seen at that instant; with an empty id the row gives only the camera. Cells may be separated
by semicolons, as spreadsheets of some countries write them, then with a decimal comma or point.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, pairwise
from pathlib import Path

import numpy as np
import scipy

from observer.errors import TruthError
from observer.geometry import Float64Array, Pose
from observer.truth.contract import KINDS, TrueBody
from observer.truth.files.body_names import MOST_BODIES
from observer.truth.files.text_lines import has_decimal_comma, separator_of
from observer.truth.files.units import FASTEST_MPS, MOST_METRES, MOST_RADIANS, MOST_SECONDS
from observer.truth.sampled import SampledTruth, TruthSample
from observer.types import BoxPx

_POSITION, _VELOCITY, _SIZE = ("x", "y", "z"), ("vx", "vy", "vz"), ("size_x", "size_y", "size_z")
_REQUIRED = ("frame", "t", "id", *_POSITION, *_VELOCITY, "visible", *_SIZE, "yaw")
_CAMERA = tuple(f"camera_{name}" for name in ("x", "y", "z", "qw", "qx", "qy", "qz"))
_BOX = ("box_u0", "box_v0", "box_u1", "box_v1")
_COLUMNS = (*_REQUIRED, "name", "role", "commanded_speed", *_BOX, "kind", *_CAMERA)
_ROLES = ("obstacle", "observer")
# Highest plausible magnitude and its unit, by column.
_MOST = {
    "t": (MOST_SECONDS, "s"),
    "yaw": (MOST_RADIANS, "rad"),
    **dict.fromkeys((*_POSITION, *_SIZE, "camera_x", "camera_y", "camera_z"), (MOST_METRES, "m")),
    **dict.fromkeys((*_VELOCITY, "commanded_speed"), (FASTEST_MPS, "m/s")),
    **dict.fromkeys(_BOX, (1e9, "px")),
}
# Three hours of one body at 50 Hz. A row takes 1.4 kB of memory.
MOST_ROWS = 540_000


def write_truth_csv(path: Path | str, rows: Iterable[TruthSample]) -> None:
    """Write samples so that ``CsvTruth`` reads them back exactly.

    Raises:
        TruthError: the file cannot be written.
    """
    try:
        with Path(path).open("w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, _COLUMNS, restval="", lineterminator="\n")
            writer.writeheader()
            for sample in rows:
                common = {"frame": str(sample.frame), "t": repr(float(sample.time))}
                common |= _camera_cells(sample.camera_pose)
                writer.writerows(common | _body_cells(body) for body in sample.bodies)
                if not sample.bodies:
                    writer.writerow(common)
    except OSError as error:
        raise TruthError(f"{path} cannot be written: {error.strerror}") from None


class CsvTruth(SampledTruth):
    """Ground truth of a ``truth.csv``, at any instant.

    Raises:
        TruthError: the file cannot be read; the sentence names the line and the column.
    """

    def __init__(self, path: Path | str) -> None:
        path = Path(path)
        try:
            with path.open(newline="", encoding="utf-8-sig") as file:
                super().__init__(_read_samples(file, path.name))
        except OSError as error:
            raise TruthError(f"{path} cannot be read: {error.strerror}") from None
        except UnicodeDecodeError:
            raise TruthError(f"{path.name}: the file must be UTF-8 text") from None


def _read_samples(lines: Iterable[str], name: str) -> tuple[TruthSample, ...]:
    times: dict[int, float] = {}
    bodies: dict[int, dict[int, TrueBody]] = {}
    cameras: dict[int, Pose] = {}
    ids: set[int] = set()
    for row in _rows(lines, name):
        frame, time = row.whole("frame"), row.number("t")
        if times.setdefault(frame, time) != time:
            raise TruthError(
                f"{row.where}: frame {frame} has the time {time!r}, but {times[frame]!r} in an "
                f"earlier line; a frame has one time"
            )
        seen = bodies.setdefault(frame, {})
        body = row.body()
        if body is not None:
            if body.id in seen:
                raise TruthError(f"{row.where}: id {body.id} appears twice in frame {frame}")
            seen[body.id] = body
            ids.add(body.id)
            if len(ids) > MOST_BODIES:
                raise TruthError(
                    f"{row.where}: there are more than {MOST_BODIES} ids; an id names a body, "
                    "which keeps it in all frames"
                )
        camera = row.camera_pose()
        if camera is not None:
            cameras.setdefault(frame, camera)
    if not times:
        raise TruthError(f"{name}: the file contains no rows below its header")
    frames = sorted(times)
    for before, after in pairwise(frames):
        if times[after] <= times[before]:
            raise TruthError(
                f"{name}: frame {after} has the time {times[after]!r}, which is not later than "
                f"the {times[before]!r} of frame {before}"
            )
    return tuple(
        TruthSample(
            frame,
            times[frame],
            tuple(bodies[frame][id_] for id_ in sorted(bodies[frame])),
            cameras.get(frame),
        )
        for frame in frames
    )


def _rows(lines: Iterable[str], name: str) -> Iterator[_Row]:
    lines = iter(lines)
    header = next(lines, "")
    separator = separator_of(header)
    reader = csv.DictReader(chain([header], lines), strict=True, delimiter=separator)
    try:
        missing = [column for column in _REQUIRED if column not in (reader.fieldnames or ())]
        if missing:
            raise TruthError(
                f"{name}: the header lacks the column {missing[0]}; "
                f"it must name {','.join(_REQUIRED)}"
            )
        for group in (_BOX, _CAMERA):
            some = [column for column in group if column in (reader.fieldnames or ())]
            if some and len(some) != len(group):
                raise TruthError(
                    f"{name}: the header has {some[0]} but not all of {','.join(group)}"
                )
        for number, cells in enumerate(reader):
            where = f"{name} line {reader.line_num}"
            if number == MOST_ROWS:
                raise TruthError(
                    f"{where}: there are more than {MOST_ROWS} rows; give a shorter section, or "
                    "fewer bodies"
                )
            if None in cells or None in cells.values():
                raise TruthError(
                    f"{where}: the row must have {len(reader.fieldnames or ())} cells, one per "
                    "column"
                )
            yield _Row(cells, where, decimal_comma=has_decimal_comma(separator))
    except csv.Error as error:
        raise TruthError(
            f"{name} line {reader.reader.line_num}: the line is not valid CSV: {error}"
        ) from None


@dataclass(frozen=True)
class _Row:
    """Cells of a line by column, and the line's location for messages."""

    cells: Mapping[str, str]
    where: str
    decimal_comma: bool = False

    def body(self) -> TrueBody | None:
        """Return the line's body; None where it has no id or was not seen."""
        if not self._text("id") or not any(self._text(c) for c in _POSITION):
            return None
        visible = self._optional("visible")
        if visible is not None and not 0 <= visible <= 1:
            raise TruthError(f"{self.where}: visible must be between 0 and 1, not {visible:g}")
        size = self._vector(_SIZE)
        if (size < 0).any():
            raise TruthError(f"{self.where}: size_x, size_y and size_z must not be negative")
        role = self._text("role") or "obstacle"
        if role not in _ROLES:
            raise TruthError(f"{self.where}: role must be {' or '.join(_ROLES)}, not {role[:40]!r}")
        kind = self._text("kind")
        known = next((each for each in KINDS if each == kind), None)
        if kind and known is None:
            raise TruthError(f"{self.where}: kind must be {' or '.join(KINDS)}, not {kind[:40]!r}")
        id_ = self.whole("id")
        return TrueBody(
            id=id_,
            name=self._text("name") or f"body {id_}",
            role=role,
            position=self._vector(_POSITION),
            velocity=self._vector(_VELOCITY),
            size=size,
            yaw=self.number("yaw"),
            visible=visible,
            commanded_speed=self._optional("commanded_speed"),
            box_px=self._box(),
            kind=known,
        )

    def _box(self) -> BoxPx | None:
        if not any(self._text(column) for column in _BOX):
            return None
        u0, v0, u1, v1 = (self.number(column) for column in _BOX)
        if u0 > u1 or v0 > v1:
            raise TruthError(
                f"{self.where}: box_u0 and box_v0 must not exceed box_u1 and box_v1, but the box "
                f"is {u0:g} {v0:g} {u1:g} {v1:g}"
            )
        return u0, v0, u1, v1

    def camera_pose(self) -> Pose | None:
        """Return ``T_world_camera`` where the line gives it."""
        if not any(self._text(column) for column in _CAMERA):
            return None
        x, y, z, qw, qx, qy, qz = (self.number(column) for column in _CAMERA)
        norm = math.hypot(qw, qx, qy, qz)
        if abs(norm - 1) > 1e-3:
            raise TruthError(
                f"{self.where}: camera_qw, camera_qx, camera_qy and camera_qz must be a unit "
                f"quaternion, but its length is {norm:g}"
            )
        rotation = scipy.spatial.transform.Rotation.from_quat([qx, qy, qz, qw]).as_matrix()
        return Pose(rotation, np.array([x, y, z]))

    def number(self, column: str) -> float:
        text = self._text(column)
        if self.decimal_comma:
            text = text.replace(",", ".")
        try:
            # float() also accepts "1_000", which is surely an error in a table of measurements.
            value = float(text.replace("_", "?"))
        except ValueError:
            raise TruthError(
                f"{self.where}: {column} must be a number, not {text[:40]!r}"
            ) from None
        if not math.isfinite(value):
            raise TruthError(f"{self.where}: {column} must be finite, not {text[:40]}")
        most, unit = _MOST.get(column, (math.inf, ""))
        if abs(value) > most:
            raise TruthError(
                f"{self.where}: {column} must be at most {most:g} {unit} in magnitude, "
                f"not {text[:40]}"
            )
        return value

    def whole(self, column: str) -> int:
        value = self.number(column)
        if value != int(value) or not 0 <= value <= 2**53:
            raise TruthError(
                f"{self.where}: {column} must be a whole number of at least 0, "
                f"not {self._text(column)[:40]}"
            )
        return int(value)

    def _optional(self, column: str) -> float | None:
        return self.number(column) if self._text(column) else None

    def _vector(self, columns: Sequence[str]) -> Float64Array:
        return np.array([self.number(column) for column in columns])

    def _text(self, column: str) -> str:
        return self.cells.get(column, "").strip()


def _camera_cells(pose: Pose | None) -> dict[str, str]:
    if pose is None:
        return {}
    numbers = (*pose.translation, *pose.quaternion_wxyz)
    return {column: repr(float(v)) for column, v in zip(_CAMERA, numbers, strict=True)}


def _body_cells(body: TrueBody) -> dict[str, str]:
    columns = (*_POSITION, *_VELOCITY, *_SIZE, "yaw", "visible", "commanded_speed", *_BOX)
    numbers = (*body.position, *body.velocity, *body.size)
    numbers += (body.yaw, body.visible, body.commanded_speed, *(body.box_px or [None] * 4))
    numbered = zip(columns, numbers, strict=True)
    cells = {column: repr(float(v)) for column, v in numbered if v is not None}
    words = {"id": str(body.id), "name": body.name, "role": body.role, "kind": body.kind or ""}
    return cells | words
