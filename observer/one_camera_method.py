"""One camera (in the making)."""

from __future__ import annotations

from collections.abc import Iterator

from observer.camera import StereoCamera
from observer.geometry import Float64Array
from observer.method import StageTimer, Step, View
from observer.mount import CameraMount
from observer.parameters import Parameters
from observer.types import Trace


class OneCameraMethod:
    def __init__(
        self,
        camera: StereoCamera,
        numbers: Iterator[int] | None = None,
        mount: CameraMount | None = None,
    ) -> None:
        self._camera = camera

    def begin(self, view: View, parameters: Parameters) -> None:
        pass

    def step(self, view: View, parameters: Parameters, timer: StageTimer, trace: Trace) -> Step:
        raise NotImplementedError
