"""Result of an alignment: plain data that is stored with the run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from observer.errors import TruthError
from observer.geometry import Float64Array, Pose
from observer.truth.alignment.observed import TrackKey
from observer.truth.alignment.time_offset import TimeOffset
from observer.truth.alignment.track_matching import Match


@dataclass(frozen=True, eq=False)
class Alignment:
    """Relation of motion capture to a run.

    Attributes:
        time: offset and drift of the clocks, with overlap, correlation and residual.
        roles: ``observer`` or ``obstacle``, by the body's name; others are ignored.
        segments: number and start (source clock, seconds) of each segment, in order.
        T_world_room: by segment; without it, only speeds can be compared.
        frame_residual_m: RMS distance of the aligned points; None without an aligned frame.
        T_body_camera: of the observer's body, None where it is unknown.
        matches: the body of each track.
        centres: by body, (3,) metres from its origin to the middle of what was seen, in the
            body's axes, or in the room's if it has no rotations.
        notes: what was decided and what was not observable, one sentence each.
    """

    time: TimeOffset
    roles: Mapping[str, str]
    segments: tuple[tuple[int, float], ...]
    T_world_room: Mapping[int, Pose]
    frame_residual_m: float | None
    T_body_camera: Pose | None
    matches: Mapping[TrackKey, Match]
    centres: Mapping[str, tuple[float, float, float]]
    notes: tuple[str, ...]

    @property
    def observer(self) -> str | None:
        """Name of the observer's body, or None."""
        return next((name for name, role in self.roles.items() if role == "observer"), None)

    def centre(self, name: str) -> Float64Array | None:
        """Return a body's entry in ``centres``, or None."""
        centre = self.centres.get(name)
        return None if centre is None else np.array(centre)

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {
            "time": asdict(self.time),
            "roles": dict(self.roles),
            "segments": [list(segment) for segment in self.segments],
            "T_world_room": {str(k): _listed(T) for k, T in self.T_world_room.items()},
            "frame_residual_m": self.frame_residual_m,
            "T_body_camera": None if self.T_body_camera is None else _listed(self.T_body_camera),
            "matches": {str(key): asdict(match) for key, match in self.matches.items()},
            "centres": {name: list(centre) for name, centre in self.centres.items()},
            "notes": list(self.notes),
        }

    @staticmethod
    def of_dict(plain: Mapping[str, Any]) -> Alignment:
        """Read the output of ``as_dict``.

        Raises:
            TruthError: the data are not its output.
        """
        try:
            camera = plain["T_body_camera"]
            residual = plain["frame_residual_m"]
            return Alignment(
                time=TimeOffset(**plain["time"]),
                roles={str(k): str(v) for k, v in plain["roles"].items()},
                segments=tuple((int(n), float(t)) for n, t in plain["segments"]),
                T_world_room={int(k): _pose(T) for k, T in plain["T_world_room"].items()},
                frame_residual_m=None if residual is None else float(residual),
                T_body_camera=None if camera is None else _pose(camera),
                matches={TrackKey.parse(k): Match(**m) for k, m in plain["matches"].items()},
                centres={str(k): _three(c) for k, c in plain["centres"].items()},
                notes=tuple(str(note) for note in plain["notes"]),
            )
        except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
            raise TruthError(
                f"the stored alignment is damaged: {type(error).__name__} at {str(error)[:60]}; "
                "align the run again"
            ) from None


def _listed(pose: Pose) -> list[list[float]]:
    rows: list[list[float]] = pose.matrix.tolist()
    return rows


def _pose(rows: Any) -> Pose:
    return Pose.from_matrix(np.array(rows, dtype=np.float64))


def _three(values: Any) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in values)
    return x, y, z
