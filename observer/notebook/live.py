"""Source that is observed step by step, for notebooks and scripts."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from observer.camera import StereoCalibration
from observer.errors import CalibrationError
from observer.exporting.overlay import draw_overlay
from observer.jsonl import ObservationLine, observation_line
from observer.observer import Observer
from observer.opening import OpenedSource
from observer.parameters import Parameters, effective
from observer.sources.contract import NoFrame, SkippedFrame, SourceInfo, begins_segment
from observer.trace import FullTrace, NoTrace
from observer.truth.contract import TrueBody, Truth
from observer.types import Image, Observation, Obstacle, StereoFrame
from observer.vision.rectification import Rectification


@dataclass(frozen=True, eq=False)
class Step:
    """A frame and what was found in it.

    Attributes:
        frame: as read from the source. observation: what was found.
        truth: true bodies at that instant, in the ground truth's own world; empty if unknown.
        trace: every intermediate image and number by name (see ``observer.observer``); None if
            it was not requested.
    """

    frame: StereoFrame
    observation: Observation
    truth: tuple[TrueBody, ...]
    trace: FullTrace | None
    _rectification: Rectification

    def __repr__(self) -> str:
        return f"<step: {self.observation!r}>"

    @property
    def obstacles(self) -> tuple[Obstacle, ...]:
        """Confirmed and coasting obstacles."""
        return self.observation.reported

    @cached_property
    def line(self) -> ObservationLine:
        """JSON line as ``observe`` writes it, see ``observer.jsonl``."""
        return observation_line(self.observation)

    def picture(self) -> Image:
        """Return the rectified left image with overlay, (H, W, 3) RGB, for ``plt.imshow``."""
        left = self._rectification.apply_left(self.frame.left)
        return np.ascontiguousarray(draw_overlay(left, self.line)[:, :, ::-1])


class ObservedSource:
    """Processes a source while you iterate over it; see ``observer.open``.

    Attributes:
        skipped: frames that could not be read, and why.
    """

    def __init__(
        self,
        opened: OpenedSource,
        parameters: Parameters,
        calibration: StereoCalibration | None = None,
    ) -> None:
        """
        Raises:
            CalibrationError: there is no calibration, or it cannot be used.
        """
        self._opened = opened
        source = opened.source
        used = calibration or source.calibration
        if used is None:
            raise CalibrationError(f"{source.info.spec} has no calibration; pass calibration=FILE")
        self.calibration = used
        self.skipped: list[SkippedFrame] = []
        self._revision = 0
        self._rectification = Rectification(used)
        self._observer = Observer(used, parameters, mount=source.info.mount)

    def __repr__(self) -> str:
        return f"<observed source {self.info.spec}, {self.info.width}x{self.info.height}>"

    def __enter__(self) -> ObservedSource:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def info(self) -> SourceInfo:
        """Description of the source."""
        return self._opened.source.info

    @property
    def truth(self) -> Truth | None:
        """Ground truth of the source's world, or None."""
        return self._opened.truth

    @property
    def parameters(self) -> dict[str, Any]:
        """Current parameters, by dotted name."""
        return dict(self._observer.parameters.flat())

    def set(self, changes: Mapping[str, Any]) -> None:
        """Change parameters from the next frame on.

        Args:
            changes: values by dotted name; the others stay.

        Raises:
            ParameterError: a name or a value is invalid, or has no effect with the
                current method; nothing was changed.
        """
        parameters = effective(self._observer.parameters, changes)
        self._revision += 1
        self._observer.use(parameters, self._revision)

    def __iter__(self) -> Iterator[Step]:
        return self.steps()

    def steps(self, count: int | None = None, *, trace: bool = False) -> Iterator[Step]:
        """Process the next frames of the source.

        Args:
            count: number of frames; None: until the source ends, which live sources never do.
            trace: also keep every intermediate image and number of each frame.
        """
        done = 0
        while count is None or done < count:
            frame = self._opened.source.read()
            if frame is None:
                return
            if isinstance(frame, SkippedFrame):
                self.skipped.append(frame)
            elif not isinstance(frame, NoFrame):
                done += 1
                kept = FullTrace() if trace else None
                if begins_segment(self._opened.source):
                    self._observer.begin_segment()
                observation = self._observer.observe(frame, NoTrace() if kept is None else kept)
                truth = self._opened.truth
                bodies = () if truth is None else truth.bodies(frame.time)
                yield Step(frame, observation, bodies, kept, self._rectification)

    def close(self) -> None:
        """Release files and devices; safe to call twice."""
        self._opened.source.close()
