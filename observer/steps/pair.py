"""One pair of frames of a source, observed by the paper's method and frozen."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass

from observer.camera import StereoCalibration, StereoCamera
from observer.errors import CalibrationError, InputError, SourceError
from observer.observer import Observer
from observer.parameters import Parameters
from observer.parameters.fields import PLANAR
from observer.recording.run_times import RunTimes
from observer.recording.source import RecordingSource
from observer.sources.contract import SeekableSource, SkippingSource, Source
from observer.trace import FullTrace, NoTrace, TraceValues
from observer.truth.contract import Truth
from observer.truth.matching import TruthMatcher
from observer.types import Observation, StereoFrame

# Frames beyond those that a track needs to be confirmed: it may be missed in some.
_SPARE_FRAMES = 2
# Seconds: default frame of a source without recorded obstacles; by then something moves in every
# scenario.
_USUAL_S = 2.0
# Frames: reaching a later one takes too long in a source that can only be played from the start.
_MOST_PLAYED = 3000
# Bytes of the cached images: more than are observed for a pair, unless they are very large.
_MOST_BYTES = 96 << 20


@dataclass(frozen=True)
class TrueSpeed:
    """True speed of a body that is in sight.

    Attributes:
        name: shown to people. speed_mps: at the instant to which the obstacles' velocities belong.
        track_id: of the obstacle that it was matched with, or None.
    """

    name: str
    speed_mps: float
    track_id: int | None


@dataclass(frozen=True, eq=False)
class ObservedPair:
    """The images of t and t+dt with everything that the method computed from them.

    Attributes:
        frame: position in the source of the image of t+dt, from 0. first: position of the first
            frame that was observed for it, so that tracks are confirmed.
        trace: intermediate results (see ``observer.observer``).
        observation: the result. parameters: those used. camera: the rectified pair.
        truth: the true bodies in sight; None without ground truth.
    """

    frame: int
    first: int
    trace: TraceValues
    observation: Observation
    parameters: Parameters
    camera: StereoCamera
    truth: tuple[TrueSpeed, ...] | None

    @property
    def dt(self) -> float:
        """Seconds between the two exposures."""
        return float(self.trace["time"] - self.trace["previous_time"])


class FrameReader:
    """Frames of a source by their position; the last ones used are cached.

    Args:
        source: not live; nothing else may read from it.
    """

    def __init__(self, source: Source) -> None:
        if source.info.live:
            raise SourceError(
                f"{source.info.spec} is live, so it has no frame to go back to; record a run of it"
            )
        self.source = source
        self._next = 0
        self._kept: OrderedDict[int, StereoFrame | str] = OrderedDict()
        self._begins: dict[int, bool] = {}

    def get(self, position: int) -> StereoFrame | str:
        """Return a frame, or a sentence that says why it cannot be read.

        Raises:
            SourceError: the source has no such frame.
        """
        if position not in self._kept:
            self._read(position)
        self._kept.move_to_end(position)
        return self._kept[position]

    def begins_segment(self, position: int) -> bool:
        """Return whether a segment of the recorded run began at this frame, already read."""
        return self._begins.get(position, False)

    def _read(self, position: int) -> None:
        self.check(position)
        self._go_to(position)
        item = self.source.read()
        self._next = position + 1
        if item is None:
            raise self._no_frame(position)
        found = item if isinstance(item, StereoFrame) else getattr(item, "reason", "no frame came")
        self._kept[position] = found
        if isinstance(self.source, SeekableSource):
            self._begins[position] = self.source.begins is not None
        while len(self._kept) > 1 and sum(map(_bytes, self._kept.values())) > _MOST_BYTES:
            self._begins.pop(self._kept.popitem(last=False)[0], None)

    def check(self, position: int) -> None:
        """Refuse a position that the source is known not to have.

        Raises:
            SourceError: there is no such frame, or it takes too long to reach.
        """
        count = self.source.info.frame_count
        if position < 0 or (count is not None and position >= count):
            raise self._no_frame(position)
        plays = not isinstance(self.source, SeekableSource | SkippingSource)
        if plays and position > _MOST_PLAYED:
            raise SourceError(
                f"{self.source.info.spec} can only be played from its first frame, and frame "
                f"{position} is too far from it; choose one up to {_MOST_PLAYED}"
            )

    def _go_to(self, position: int) -> None:
        if isinstance(self.source, SeekableSource):
            self.source.seek(position)
            return
        if position < self._next:
            self.source.rewind()
            self._next = 0
        if isinstance(self.source, SkippingSource):
            self.source.skip(position - self._next)
            return
        for _ in range(position - self._next):
            if self.source.read() is None:
                break

    def _no_frame(self, position: int) -> SourceError:
        info = self.source.info
        known = "" if info.frame_count is None else f"; its frames are 0 to {info.frame_count - 1}"
        return SourceError(f"{info.spec} has no frame {position}{known}")


def _bytes(item: StereoFrame | str) -> int:
    return 0 if isinstance(item, str) else item.left.nbytes + item.right.nbytes


def frames_before(parameters: Parameters) -> int:
    """Return how many frames are observed before the wanted one.

    The sum of the pair's interval, the frames a track needs to be confirmed, and two spare ones.
    """
    return parameters.frames.interval + parameters.tracking.confirm_hits + _SPARE_FRAMES


def usual_frame(source: Source) -> int:
    """Return the position of a frame that is worth looking at.

    For a recording it is the one with the most significant moving obstacle, the first of equals.
    """
    info = source.info
    last = None if info.frame_count is None else info.frame_count - 1
    if isinstance(source, RecordingSource) and (best := _most_significant(source)) is not None:
        return best
    chosen = max(1, round(_USUAL_S * info.frame_rate))
    return chosen if last is None else max(0, min(chosen, last))


def _most_significant(source: RecordingSource) -> int | None:
    # Numbers and times of frames repeat where an engine was replaced; the run's times do not.
    times = RunTimes(source.recording.frames)
    positions = {frame: k for k, frame in enumerate(times.frames)}
    found = [
        (obstacle["significance"], -positions[line["frame"], line["time"]])
        for line in times.lines(source.recording.lines())
        if (line["frame"], line["time"]) in positions
        for obstacle in line["obstacles"]
        if obstacle["motion"] == "moving" and obstacle["state"] == "confirmed"
    ]
    return -max(found)[1] if found else None


def observe_pair(
    reader: FrameReader,
    frame: int,
    parameters: Parameters,
    *,
    calibration: StereoCalibration | None = None,
    truth: Truth | None = None,
) -> ObservedPair:
    """Observe the pair that ends with a frame, after the earlier frames that tracks need.

    Args:
        frame: position in the source, from 0.
        calibration: used instead of the source's own.

    Raises:
        SourceError: there is no such frame, or it cannot be read or compared with one before.
        CalibrationError: there is no calibration, or one that cannot be used.
        InputError: the parameters are not those of a planar method.
    """
    if parameters.ego_motion.model not in PLANAR:
        raise InputError(
            f"the steps are those of the planar methods, {' and '.join(PLANAR)}; "
            f"{parameters.ego_motion.model} has others"
        )
    calibration = calibration or reader.source.calibration
    if calibration is None:
        raise CalibrationError(
            f"{reader.source.info.spec} has no calibration, so no distance or speed can be "
            "measured; calibrate its cameras first"
        )
    reader.check(frame)
    first = max(0, frame - frames_before(parameters))
    observer = Observer(calibration, parameters)
    matcher: TruthMatcher | None = None
    observation, trace = None, FullTrace()
    began = False
    for position in range(first, frame + 1):
        item = reader.get(position)
        # It may have begun with a frame that cannot be read.
        began = began or reader.begins_segment(position)
        if not isinstance(item, StereoFrame):
            if position == frame:
                raise SourceError(f"frame {frame} cannot be read: {item}")
            continue
        if observation is None:
            matcher = _matcher(truth, item.time, first)
        elif began:
            observer.begin_segment()
        began = False
        observation = observer.observe(item, trace if position == frame else NoTrace())
        bodies = [] if matcher is None else matcher.match(observation, item.time)
    assert observation is not None
    if "previous_left" not in trace:
        raise SourceError(f"frame {frame} has no earlier one to compare with; choose a later frame")
    true_speeds = None
    if truth is not None and matcher is not None:
        when = trace["previous_time"] + (trace["time"] - trace["previous_time"]) / 2
        speeds = {body.id: body.speed for body in truth.bodies(when)}
        true_speeds = tuple(
            TrueSpeed(body["name"], speeds.get(body["id"], body["speed"]), body["track_id"])
            for body in bodies
            if body["role"] != "observer" and body["visible"] != 0
        )
    return ObservedPair(frame, first, trace, observation, parameters, observer.camera, true_speeds)


def _matcher(truth: Truth | None, time: float, first: int) -> TruthMatcher | None:
    """Return the matcher of ground truth and observation; None if they cannot be related.

    If the camera's true pose is unknown, both share only the source's first frame.
    """
    if truth is None or (first > 0 and truth.camera_pose(time) is None):
        return None
    return TruthMatcher(truth)
