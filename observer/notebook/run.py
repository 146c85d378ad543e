"""Recorded run as arrays, for notebooks and scripts."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from observer.errors import SourceError
from observer.exporting.choices import CloudFrame
from observer.exporting.clouds import Cloud, cloud_at
from observer.exporting.errors import ExportError
from observer.exporting.overlay import draw_overlay
from observer.exporting.tables import TABLES, find_table
from observer.geometry import Float64Array
from observer.jsonl import ObservationLine, OutlinedEntry, observation_line
from observer.parameters import effective
from observer.recording.reader import Recording
from observer.recording.replay import replay, replay_revisions
from observer.recording.run_times import RunTimes
from observer.recording.source import RecordingSource
from observer.truth.contract import Truth
from observer.types import Image
from observer.vision.rectification import Rectification

_UNKNOWN3 = (np.nan, np.nan, np.nan)


@dataclass(frozen=True, eq=False)
class Track:
    """An obstacle under one identity: N frames in order of time; unknown values are NaN.

    Attributes:
        segment, id: of the track.
        frames: (N,) numbers. times: (N,) seconds on the source's clock.
        positions: (N, 3) metres, velocities: (N, 3) m/s, the segment's world.
        velocity_times: (N,) the instants to which the velocities refer.
        speeds, speed_stds: (N,) m/s. ranges: (N,) metres from the camera.
        coasting: (N,) True where it was not seen in that frame.
    """

    segment: int
    id: int
    frames: NDArray[np.int64]
    times: Float64Array
    positions: Float64Array
    velocities: Float64Array
    velocity_times: Float64Array
    speeds: Float64Array
    speed_stds: Float64Array
    ranges: Float64Array
    coasting: NDArray[np.bool_]

    def __repr__(self) -> str:
        return f"<track {self.id} of segment {self.segment}, {len(self)} frames>"

    def __len__(self) -> int:
        return len(self.times)


@dataclass(frozen=True, eq=False)
class SpeedComparison:
    """Speeds of a track and of the body matched to it, at the same N instants.

    Attributes:
        body: the body's name. segment, id: of the track. times: (N,) seconds, source's clock.
        seen, std, true: (N,) m/s; NaN: unknown.
    """

    body: str
    segment: int
    id: int
    times: Float64Array
    seen: Float64Array
    std: Float64Array
    true: Float64Array

    @property
    def errors(self) -> Float64Array:
        """Errors (N,) m/s, seen minus true."""
        return self.seen - self.true

    @property
    def rmse(self) -> float:
        """Root of the mean squared error, m/s; NaN where nothing can be compared."""
        known = self.errors[np.isfinite(self.errors)]
        return float(np.sqrt(np.mean(known**2))) if len(known) else float("nan")


class LoadedRun:
    """A recorded run; see ``observer.load``. Nothing is written to it.

    Attributes:
        recording: reader of everything that was recorded.
    """

    def __init__(self, path: Path) -> None:
        self.recording = Recording(path)

    def __enter__(self) -> LoadedRun:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        facts = self.recording.facts
        return f"<run {facts.name or facts.id} of {facts.source}, {len(self)} frames>"

    def __len__(self) -> int:
        return len(self.recording.frames)

    @cached_property
    def lines(self) -> tuple[ObservationLine, ...]:
        """JSON lines as ``observe`` writes them, one dictionary per frame."""
        return tuple(self.recording.lines())

    def __iter__(self) -> Iterator[ObservationLine]:
        return iter(self.lines)

    @cached_property
    def times(self) -> Float64Array:
        """Times of the frames (N,), seconds on the source's clock."""
        return np.array([frame.time for frame in self.recording.frames])

    @cached_property
    def run_times(self) -> Float64Array:
        """Times of the frames (N,) within the run, seconds; they always increase.

        They equal ``times`` unless the engine was replaced during the run.
        """
        return np.array([time for _, time in RunTimes(self.recording.frames).frames])

    @cached_property
    def tracks(self) -> tuple[Track, ...]:
        """Tracks of all obstacles, by segment and id."""
        seen: dict[tuple[int, int], list[tuple[ObservationLine, OutlinedEntry]]] = defaultdict(list)
        for line in self.lines:
            for entry in line["obstacles"]:
                seen[line["segment"], entry["id"]].append((line, entry))
        return tuple(_track(*key, rows) for key, rows in sorted(seen.items(), key=lambda e: e[0]))

    @cached_property
    def truth(self) -> Truth | None:
        """True bodies in the truth's own world, over ``run_times``; None if none were recorded."""
        return self.recording.truth()

    @property
    def parameters(self) -> dict[str, Any]:
        """Parameters that the run began with, by dotted name."""
        return dict(replay_revisions(self.recording)[0][0].flat())

    def speed_comparisons(self) -> tuple[SpeedComparison, ...]:
        """Return each track's speed next to ground truth, as matched during the run.

        True speeds are interpolated to the instants of the estimated ones; they are NaN unless the
        body is known on both sides.
        """
        true: dict[tuple[int, str], list[tuple[float, float]]] = defaultdict(list)
        taken: dict[tuple[int, int], str] = {}
        # Numbers and times of frames repeat where an engine was replaced; the run's times do not.
        times = RunTimes(self.recording.frames)
        segments = {(e["frame"], e["time"]): e["segment"] for e in times.lines(self.lines)}
        payloads = tuple(self.recording.matched_truth())
        for matched, placed in zip(payloads, times.matched(payloads), strict=True):
            segment = segments.get((placed.frame, placed.time))
            if segment is None:
                continue
            for body in matched.bodies:
                true[segment, body.name].append((matched.time, body.speed))
                if body.track_id is not None:
                    taken.setdefault((segment, body.track_id), body.name)
        found = []
        for track in self.tracks:
            name = taken.get((track.segment, track.id))
            if name is None:
                continue
            instants, speeds = np.array(sorted(true[track.segment, name])).T
            known = np.interp(track.velocity_times, instants, speeds, left=np.nan, right=np.nan)
            found.append(
                SpeedComparison(
                    body=name,
                    segment=track.segment,
                    id=track.id,
                    times=track.velocity_times,
                    seen=track.speeds,
                    std=track.speed_stds,
                    true=np.asarray(known, dtype=np.float64),
                )
            )
        return tuple(found)

    def table(self, name: str) -> dict[str, NDArray[Any]]:
        """Return a table as arrays by column; unknown numbers are NaN.

        Args:
            name: one of ``observer.exporting.tables.TABLES``, e.g. ``obstacles``.

        Raises:
            ExportError: there is no such table.
        """
        table = find_table(name)
        rows = list(table.rows(self.recording))
        found: dict[str, NDArray[Any]] = {}
        for column in table.columns:
            values = [row[column.name] for row in rows]
            if column.kind == "text":
                found[column.name] = np.array(values, dtype=object)
            elif column.kind == "int" and None not in values:
                found[column.name] = np.array(values, dtype=np.int64)
            else:
                found[column.name] = np.array(values, dtype=np.float64)
        return found

    def dataframe(self, name: str = "obstacles") -> Any:
        """Return a table as ``pandas.DataFrame``.

        Raises:
            ExportError: there is no such table, or pandas is not installed.
        """
        try:
            import pandas  # type: ignore[import-untyped]
        except ImportError:
            raise ExportError(
                "a DataFrame needs pandas, which is not installed; install it, or use table()"
            ) from None
        return pandas.DataFrame(self.table(name), columns=list(TABLES[name].names))

    def images(self, position: int) -> tuple[Image, Image]:
        """Return the left and right image of a frame as taken, grey or BGR.

        Raises:
            SourceError: they were not recorded.
        """
        if not 0 <= position < len(self):
            raise SourceError(f"there is no frame {position}; frames are 0 to {len(self) - 1}")
        return self.recording.pair(position)

    def picture(self, position: int) -> Image:
        """Return the rectified left image with overlay, (H, W, 3) RGB, for ``plt.imshow``.

        Raises:
            SourceError: the frame's images or its observation were not recorded.
        """
        left, right = self.images(position)
        # Numbers and times of frames repeat where an engine was replaced; the run's times do not.
        times = RunTimes(self.recording.frames)
        number, time = times.frames[position]
        placed = zip(self.lines, times.lines(self.lines), strict=True)
        line = next(
            (line for line, at in placed if (at["frame"], at["time"]) == (number, time)), None
        )
        if line is None:
            raise SourceError(f"the observation of frame {number} was not recorded")
        rectified, _ = Rectification(self.recording.calibration()).apply(left, right)
        return np.ascontiguousarray(draw_overlay(rectified, line)[:, :, ::-1])

    def cloud(self, position: int, frame: CloudFrame = "camera") -> Cloud:
        """Return the point cloud of a frame: as recorded, or from its images by dense stereo.

        Raises:
            ExportError, SourceError: as for ``observer.exporting.clouds.cloud_at``.
        """
        return cloud_at(self.recording, position, frame)

    def rerun(self, changes: Mapping[str, Any] | None = None) -> tuple[ObservationLine, ...]:
        """Re-run the recorded images, and return the JSON lines.

        Without changes and with lossless images they equal the run's except for the timings.

        Args:
            changes: parameters that replace the recorded ones throughout, by dotted name.

        Raises:
            SourceError: the images were not recorded. ParameterError: a parameter is invalid, or
                has no effect with the method that the run began with.
        """
        effective(replay_revisions(self.recording)[0][0], changes or {})
        source = RecordingSource(self.recording.path)
        try:
            revisions = replay_revisions(self.recording, changes)
            return tuple(observation_line(each) for each in replay(source, revisions))
        finally:
            source.close()

    def close(self) -> None:
        """Close the file; safe to call twice."""
        self.recording.close()


def _track(segment: int, id_: int, rows: list[tuple[ObservationLine, OutlinedEntry]]) -> Track:
    entries = [entry for _, entry in rows]

    def numbers(values: Iterable[float | None]) -> Float64Array:
        return np.array(list(values), dtype=np.float64)

    def vectors(values: Iterable[Sequence[float] | None]) -> Float64Array:
        known = [_UNKNOWN3 if value is None else value for value in values]
        return np.array(known, dtype=np.float64)

    return Track(
        segment=segment,
        id=id_,
        frames=np.array([line["frame"] for line, _ in rows], dtype=np.int64),
        times=np.array([line["time"] for line, _ in rows], dtype=np.float64),
        positions=vectors(entry["position"] for entry in entries),
        velocities=vectors(entry["velocity"] for entry in entries),
        velocity_times=numbers(entry["velocity_time"] for entry in entries),
        speeds=numbers(entry["speed"] for entry in entries),
        speed_stds=numbers(entry["speed_std"] for entry in entries),
        ranges=numbers(entry["range"] for entry in entries),
        coasting=np.array([entry["state"] == "coasting" for entry in entries], dtype=np.bool_),
    )
