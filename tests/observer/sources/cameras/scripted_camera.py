"""A camera scripted by a file, run by the real camera process in place of OpenCV.

The file is JSON, read before each frame: ``mode`` (below), ``size`` [width, height], ``rate``,
``phase`` (fraction of a period by which frames come after the host's whole periods), ``stamps``
(``exposure``, ``standing`` or ``none``), ``behind_s`` (by which stamps are earlier), ``late``
(fraction of a period by which every fifth frame is delayed further), ``pace`` (seconds that the
stream's own timestamps advance in a second; it has none otherwise) and ``decoding_s`` (how long it
takes to decode a frame).
"""

from __future__ import annotations

import ctypes
import json
import math
import os
import time
from pathlib import Path
from typing import Any

import numpy as np

from observer.errors import SourceError
from observer.sources.cameras.settings import AppliedSettings, CameraSettings
from observer.sources.cameras.spec import CamerasSpec, CameraTarget
from observer.types import Image

OPENER = "scripted_camera:ScriptedCapture"
USUAL = {"mode": "good", "size": [64, 48], "rate": 30.0, "phase": 0.0, "stamps": "exposure"}


class ScriptedCapture:
    """Implements ``Capture``.

    Modes: ``good``; ``hang in grab`` and ``hang in retrieve``, in a native call that also holds
    the GIL; ``no image``; ``frozen``; ``twice`` (each image), or alternating with it
    ``twice, later``; ``black`` (repeats too); ``stall`` (for half a second, and then the four
    frames that its driver has queued come at once); ``gone`` (each grab fails
    at once); ``raise``; ``die``; ``busy`` (cannot be opened); ``hang in opening``.
    """

    def __init__(self, address: str, settings: CameraSettings) -> None:
        self._file = Path(address)
        self._settings = settings
        self._stamp = self._grabbed = self._sent = self._sent_at = 0.0
        self._noise: Image | None = None
        self._queued: list[float] | None = None
        mode = self._script()["mode"]
        if mode == "busy":
            raise SourceError("is in use by another program; close it")
        if mode == "hang in opening":
            ctypes.PyDLL(None).sleep(3600)

    def _script(self) -> dict[str, Any]:
        try:
            return {**USUAL, **json.loads(self._file.read_text())}
        except FileNotFoundError:
            return {**USUAL, "mode": "gone"}

    @property
    def rate(self) -> float | None:
        return float(self._script()["rate"])

    def grab(self) -> bool:
        script = self._script()
        if script["mode"] == "gone":
            return False
        period = 1.0 / script["rate"]
        if script["mode"] == "stall" and self._queued is None:
            self._queued = [self._stamp + n * period for n in (1, 2, 3, 4)]
            time.sleep(0.5)
        if self._queued:
            self._stamp = self._queued.pop(0)
            return True
        number = math.floor(time.monotonic() / period - script["phase"]) + 1
        if number * period <= self._grabbed:
            # Rounding gave the time of the last frame again.
            number += 1
        self._grabbed = number * period
        late = script.get("late", 0.0) if number % 5 == 0 else 0.0
        self._stamp = (number + script["phase"] + late) * period
        time.sleep(max(0.0, self._stamp - time.monotonic()))
        match self._script()["mode"]:
            case "raise":
                raise RuntimeError("a driver's own words")
            case "die":
                os._exit(3)
            case "hang in grab":
                ctypes.PyDLL(None).sleep(3600)
        return True

    def stamp(self) -> float | None:
        match self._script()["stamps"]:
            case "none":
                return None
            case "standing":
                return 1234.5
        return self._stamp - self._script().get("behind_s", 0.0)

    def sent(self) -> float | None:
        script = self._script()
        if "pace" not in script:
            return None
        self._sent += script["pace"] * (self._stamp - self._sent_at)
        self._sent_at = self._stamp
        return self._sent

    def settle(self) -> AppliedSettings:
        width, height = self._script()["size"]
        refused = ("gain 7 is not offered by it",) if self._settings.gain == 7 else ()
        return AppliedSettings({"size": f"{width}x{height}"}, refused)

    def retrieve(self) -> Image | None:
        script = self._script()
        width, height = script["size"]
        mode = script["mode"]
        if mode == "no image":
            return None
        if mode == "hang in retrieve":
            ctypes.PyDLL(None).sleep(3600)
        time.sleep(script.get("decoding_s", 0.0))
        if mode == "black":
            return np.zeros((height, width, 3), np.uint8)
        # One noise image, shifted per frame: quick to make, and never the same twice.
        if self._noise is None or self._noise.shape != (height, width, 3):
            noise = np.random.default_rng(1).integers(0, 200, (height, width, 3))
            self._noise = noise.astype(np.uint8)
        number = round(self._stamp * script["rate"])
        shift = {"frozen": 0, "twice": number // 2, "twice, later": (number + 1) // 2}.get(
            mode, number
        )
        image = np.roll(self._noise, shift, axis=1)
        # Make the left half even and the right half odd, to identify the halves side by side.
        image[:, : width // 2] &= 0xFE
        image[:, width // 2 :] |= 1
        return image


def write_script(path: Path, **changes: object) -> None:
    """Make this file's camera behave so from its next frame on; written atomically."""
    new = path.with_suffix(".new")
    new.write_text(json.dumps({**USUAL, **changes}))
    new.replace(path)


def scripted_spec(*paths: Path, settings: CameraSettings | None = None) -> CamerasSpec:
    """Return the spec of cameras that these files control."""
    targets = tuple(CameraTarget(str(path), path.name, network=False) for path in paths)
    return CamerasSpec("camera:scripted", targets, settings or CameraSettings())
