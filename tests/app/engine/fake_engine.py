"""An engine with sources that misbehave on demand; the supervisor's tests run it as a program.

Sources: ``numbers`` counts, ``exit`` ends the process while it is opened, ``hang`` blocks the main
loop at the third frame, ``busy`` computes for every frame, ``bare`` has no calibration. The
name of a missing file ends the first process that opens it. The first argument may be
``channel-only``: then the kernel does not end it with its parent, as on systems other than Linux.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable

import numpy as np

from app.engine.process import run_engine
from app.runtime.arguments import parse_arguments
from observer.camera import StereoCalibration, StereoCamera
from observer.geometry import Pose
from observer.mount import CameraMount
from observer.opening import OpenedSource
from observer.parameters import Parameters
from observer.processes import die_with_parent
from observer.sources.contract import SourceInfo
from observer.trace import Trace
from observer.types import Observation, Status, StereoFrame

WIDTH, HEIGHT, RATE = 160, 120, 50.0


class Numbers:
    """Endless grey frames, 50 per second."""

    def __init__(self, spec: str) -> None:
        self.info = SourceInfo(spec, "numbers", WIDTH, HEIGHT, RATE, None)
        self.calibration = StereoCalibration.rectified(WIDTH, HEIGHT, 100, 100, 80, 60, 0.1)
        self._at = 0

    def read(self) -> StereoFrame:
        if self.info.spec == "hang" and self._at == 3:
            time.sleep(3600)
        if self.info.spec == "busy":
            until = time.process_time() + 0.04
            while time.process_time() < until:
                pass
        image = np.full((HEIGHT, WIDTH), self._at % 256, dtype=np.uint8)
        frame = StereoFrame(self._at, self._at / RATE, image, image, time.monotonic())
        self._at += 1
        return frame

    def rewind(self) -> None:
        self._at = 0

    def close(self) -> None:
        pass


class Counting:
    """An observer that finds nothing."""

    def __init__(
        self,
        calibration: StereoCalibration,
        parameters: Parameters,
        *,
        mount: CameraMount | None,
        parameters_revision: int,
        clock: Callable[[], float],
    ) -> None:
        del mount, clock
        self.camera = StereoCamera(WIDTH, HEIGHT, 100.0, 100.0, 80.0, 60.0, calibration.baseline)
        self.parameters = parameters
        self._revision = parameters_revision

    def use(self, parameters: Parameters, revision: int) -> None:
        self.parameters, self._revision = parameters, revision

    def begin_segment(self) -> None:
        pass

    def observe(self, frame: StereoFrame, trace: Trace | None = None) -> Observation:
        if trace is not None:
            trace.keep("left", frame.left)
        return Observation(
            frame.index,
            frame.time,
            frame.received,
            0,
            Status.OK,
            (),
            self._revision,
            Pose.identity(),
            (),
        )


def open_fake(spec: str) -> OpenedSource:
    if spec == "exit":
        os._exit(7)
    if spec.startswith("/") and not os.path.exists(spec):
        open(spec, "w").close()
        os._exit(7)
    return OpenedSource(Numbers(spec), None)


if __name__ == "__main__":
    behaviour, *arguments = sys.argv[1:]
    inherited = parse_arguments(arguments)
    if behaviour != "channel-only":
        die_with_parent(inherited.parent)
    run_engine(inherited, open_source=open_fake, make_observer=Counting)
