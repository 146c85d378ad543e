"""Ground truth applied to a run afterwards, in place of that recorded with it."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from app.contract.runs import AlignmentFacts, AlignmentMatch, CameraOnBodyFacts
from app.contract.values import filled, known
from app.reports.gathering import Gathered, gather
from app.reports.pairing import pair_with_truth
from observer.errors import InputError, TruthError
from observer.evaluation.speed_errors import TrueMotion
from observer.geometry import Pose
from observer.jsonl import ObservationLine
from observer.recording.payloads import MatchedBody, MatchedTruth
from observer.recording.reader import Recording
from observer.recording.run_times import RunTimes
from observer.rig.rig import OBSTACLE
from observer.truth.alignment.aligned import DEFAULT_SIZE, AlignedTruth
from observer.truth.alignment.camera_on_body import CameraOnBody
from observer.truth.alignment.observed import TrackKey
from observer.truth.alignment.result import Alignment
from observer.truth.csv_file import CsvTruth
from observer.truth.files.known import AngleReading
from observer.truth.files.recognition import file_kind, read_capture
from observer.truth.matching import entry
from observer.truth.motion_capture import Capture
from observer.truth.sampled import SampledTruth

ALIGNED_ALREADY = "truth.csv"
_RECORDING = ".mcap"


@dataclass(frozen=True)
class TruthFile:
    """Truth file with its reading options.

    Attributes:
        path: any format of ``read_capture``, a ``truth.csv``, or the recording of another run whose
            live motion capture is used.
        name: for people.
        rate_hz, angles: as for ``read_capture``.
    """

    path: Path
    name: str
    rate_hz: float | None = None
    angles: AngleReading | None = None

    @property
    def needs_alignment(self) -> bool:
        """Return true if it has a clock and a room of its own."""
        return self.path.suffix == _RECORDING or file_kind(self.path) != ALIGNED_ALREADY

    def capture(self) -> Capture:
        """Return its motion capture.

        Raises:
            TruthError: it cannot be read, or holds none.
        """
        if self.path.suffix != _RECORDING:
            return read_capture(self.path, rate_hz=self.rate_hz, angles=self.angles)
        with Recording(self.path) as recording:
            return recorded_capture(recording)


def recorded_capture(recording: Recording) -> Capture:
    """Return the live motion capture of a run.

    Raises:
        TruthError: none was recorded.
    """
    capture = recording.capture()
    if capture is None:
        raise TruthError(
            "no motion capture was recorded with this run; upload a ground-truth file and name it"
        )
    return capture


@dataclass(frozen=True, eq=False)
class Comparison:
    """Truth of a run, with its alignment.

    Attributes:
        alignment: of the truth with the run; None where it is on the run's clock already.
        truth: the file; None where it is the live motion capture that the run recorded.
    """

    alignment: Alignment | None
    truth: TruthFile | None

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        truth = None
        if self.truth is not None:
            truth = asdict(self.truth) | {"path": str(self.truth.path.absolute())}
        return {
            "alignment": None if self.alignment is None else self.alignment.as_dict(),
            "truth": truth,
        }

    @staticmethod
    def of_dict(plain: Mapping[str, Any]) -> Comparison:
        """Restore a comparison from the output of ``as_dict``.

        Raises:
            TruthError: it is something else.
        """
        try:
            kept, kept_truth = plain["alignment"], plain["truth"]
            truth = (
                None
                if kept_truth is None
                else TruthFile(**{**kept_truth, "path": Path(kept_truth["path"])})
            )
        except (KeyError, TypeError) as error:
            raise TruthError(f"this is not a file written by align ({error})") from None
        return Comparison(None if kept is None else Alignment.of_dict(kept), truth)

    @staticmethod
    def read(path: Path) -> Comparison:
        """Read the file that ``align`` wrote.

        Raises:
            InputError: it cannot be read.
            TruthError: it is something else.
        """
        try:
            plain = json.loads(path.read_text(encoding="utf-8"))
        except (OSError, ValueError, RecursionError) as error:
            raise InputError(f"{path} cannot be read: {error}") from None
        if not isinstance(plain, dict):
            raise TruthError(f"{path} is not a file written by align")
        return Comparison.of_dict(plain)

    @property
    def words(self) -> str:
        """Describe in one sentence the source of the truth and the quality of its fit."""
        live = "motion capture received live"
        what = live if self.truth is None else self.truth.name
        if self.alignment is None:
            return f"Ground truth: {what}, on the run's own clock."
        return f"Ground truth: {what}, aligned with the run: {self.alignment.time.words}."


def alignment_facts(alignment: Alignment) -> AlignmentFacts:
    """Return the facts of an alignment that are shown to people."""
    time, T_body_camera = alignment.time, alignment.T_body_camera
    camera = None if T_body_camera is None else CameraOnBody.of_pose(T_body_camera)
    matches = sorted(alignment.matches.items())
    return filled(
        AlignmentFacts,
        time,
        frame_residual_m=alignment.frame_residual_m,
        observer=alignment.observer,
        camera_on_body=known(CameraOnBodyFacts, camera),
        roles=alignment.roles,
        matches={str(key): filled(AlignmentMatch, match) for key, match in matches},
        notes=alignment.notes,
    )


def gather_compared(
    path: Path,
    comparison: Comparison | None,
    lines: Iterable[ObservationLine] | None = None,
) -> Gathered:
    """Gather as ``gather`` does, with this truth instead of the recorded one.

    Raises:
        SourceError: it is no recording.
        TruthError: the truth file cannot be read.
    """
    if comparison is None:
        with Recording(path) as recording:
            return gather(recording, lines=lines)
    compared = ComparedRecording(path, comparison)
    with compared:
        gathered = gather(compared, comparison.alignment, lines)
    true = tuple(_without_directions(each, compared.unplaced) for each in gathered.true)
    return replace(gathered, true=true, truth_words=comparison.words)


def true_speeds(recording: Recording) -> list[dict[str, Any]]:
    """Return each body's true speed at each frame, as the database stores them."""
    times = RunTimes(recording.frames)
    lines = times.lines(recording.lines())
    matched = times.matched(recording.matched_truth())
    truth = recording.truth()
    if not matched and truth is not None:
        matched = pair_with_truth(lines, truth)
    segments = {float(line["time"]): int(line["segment"]) for line in lines}
    return [
        {
            "time": payload.time,
            "role": body.role,
            "track_id": body.id,
            "speed": body.speed,
            "segment": segments[payload.time],
            "body": body.name,
        }
        for payload in matched
        for body in payload.bodies
        if payload.time in segments
    ]


class ComparedRecording(Recording):
    """Recording with a truth other than its own.

    Attributes:
        unplaced: instants at which bodies' speeds are known, but not their positions.

    Raises:
        SourceError: it is no recording.
    """

    def __init__(self, path: Path | str, comparison: Comparison) -> None:
        super().__init__(path)
        self._comparison = comparison
        self.unplaced: set[float] = set()

    @cached_property
    def _capture(self) -> Capture | None:
        truth = self._comparison.truth
        if truth is None:
            return super().capture()
        return truth.capture() if self._comparison.alignment is not None else None

    def capture(self) -> Capture | None:
        return self._capture

    def truths(self) -> tuple[tuple[int, SampledTruth | None], ...]:
        truth = self._comparison.truth
        if self._comparison.alignment is not None or truth is None:
            return ()
        return ((0, CsvTruth(truth.path)),)

    def matched_truth(self) -> Iterator[MatchedTruth]:
        """Pair bodies and tracks by the alignment's matches, with a person's corrections."""
        alignment, capture = self._comparison.alignment, self._capture
        if alignment is None or capture is None:
            return
        truth = AlignedTruth(capture, alignment)
        names = [name for name, role in alignment.roles.items() if role == OBSTACLE]
        for line in self.lines():
            time = line["time"]
            bodies = [
                MatchedBody.of(entry(body, Pose.identity(), None)) for body in truth.bodies(time)
            ]
            if not bodies:
                bodies = _speeds_only(truth, names, time)
                self.unplaced |= {time} if bodies else set()
            tracks = _tracks(alignment, line, bodies)
            yield MatchedTruth(
                frame=line["frame"],
                time=time,
                bodies=[
                    msgspec.structs.replace(body, track_id=tracks.get(body.name)) for body in bodies
                ],
            )


def _speeds_only(truth: AlignedTruth, names: Iterable[str], time: float) -> list[MatchedBody]:
    """Return bodies with their speeds alone, while the room's pose in the world is unknown."""
    unknown = [float("nan")] * 3
    return [
        MatchedBody(
            id=number, name=name, role=OBSTACLE, position=unknown, velocity=unknown, speed=speed,
            size=DEFAULT_SIZE.tolist(), yaw=float("nan"),
        )
        for number, name in enumerate(names, start=1)
        if (speed := truth.speed(name, time)) is not None
    ]  # fmt: skip


def _tracks(
    alignment: Alignment, line: ObservationLine, bodies: Iterable[MatchedBody]
) -> dict[str, int]:
    """Return, by body, the nearest of its tracks."""
    places = {body.name: np.array(body.position) for body in bodies}
    found: dict[str, tuple[float, int]] = {}
    for reported in line["obstacles"]:
        match = alignment.matches.get(TrackKey(line["segment"], reported["id"]))
        if match is None or match.body not in places:
            continue
        distance = np.inf
        if reported["position"] is not None:
            distance = float(np.linalg.norm(places[match.body] - np.array(reported["position"])))
        candidate = float(np.nan_to_num(distance, nan=np.inf)), reported["id"]
        found[match.body] = min(found.get(match.body, candidate), candidate)
    return {body: track for body, (_, track) in found.items()}


def _without_directions(motion: TrueMotion, unplaced: set[float]) -> TrueMotion:
    """Remove the directions of motion at times without a known place."""
    if not unplaced:
        return motion
    known = [float(time) not in unplaced for time in motion.times]

    def only(words: tuple[str, ...]) -> tuple[str, ...]:
        return tuple(word if here else "" for word, here in zip(words, known, strict=True))

    return replace(motion, directions=only(motion.directions), ways=only(motion.ways))
