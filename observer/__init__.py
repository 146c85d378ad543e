"""Detection of moving obstacles from a moving stereo camera: the library.

Frames (``T_target_source`` maps source coordinates into the target frame):

=========  =====================================================================
camera     rectified left camera's optical frame: x right, y down, z forward
base       the robot: x forward, y left, z up (REP-103)
world      the camera frame at a segment's first valid pose; obstacles are expressed in it
image      pixels: u right, v down, the upper left pixel's centre is (0, 0)
=========  =====================================================================

Units: metres, seconds, radians, pixels, m/s. ``time`` is the exposure on the source's own clock,
``received`` the host's monotonic clock.

The public interface is ``open`` and ``load`` for notebooks and scripts, and for your own frames
``Observer``, ``StereoFrame``, ``StereoCalibration`` and ``Parameters``::

    import observer

    with observer.open("simulated:lab", {"klt_tracking.spacing_px": 14}) as source:
        for step in source.steps(50):
            print(step.frame.time, [o.speed for o in step.obstacles])

    with observer.load("recording.mcap") as run:
        for track in run.tracks:
            print(track.id, track.speeds.mean())
"""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from observer.camera import StereoCalibration
    from observer.notebook.live import ObservedSource
    from observer.notebook.run import LoadedRun
    from observer.observer import Observer
    from observer.parameters import Parameters
    from observer.types import StereoFrame

    __version__: str

__all__ = [
    "Observer",
    "Parameters",
    "StereoCalibration",
    "StereoFrame",
    "__version__",
    "load",
    "open",
]

# Imported on first use, so that using one part of the library does not load the others.
_HOMES = {
    "Observer": "observer.observer",
    "Parameters": "observer.parameters",
    "StereoCalibration": "observer.camera",
    "StereoFrame": "observer.types",
}


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from observer.version import library_version

        return library_version()
    if name in _HOMES:
        return getattr(importlib.import_module(_HOMES[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def open(
    source: str,
    parameters: Mapping[str, Any] | None = None,
    *,
    preset: str = "default",
    calibration: Path | str | None = None,
) -> ObservedSource:
    """Open a source, to be processed while you iterate over it.

    Args:
        source: anything that ``dynamic-observer observe`` accepts: ``simulated:lab``, a folder,
            videos, ``camera:0,1``, a recording.
        parameters: values by dotted name, replacing those of the preset; each must have an effect
            with the current method.
        preset: ``default`` or ``paper``.
        calibration: a file to use instead of the source's own.

    Raises:
        InputError: one sentence says what cannot be used.

    Example::

        with observer.open("simulated:lab", {"ego_motion.model": "affine"}) as source:
            for step in source.steps(20):
                plt.imshow(step.picture())
            source.set({"flow.residual_threshold_px": 1.5})
            last = list(source.steps(20))[-1]
    """
    from observer.calibration.formats.recognition import named_file, read_any
    from observer.notebook.live import ObservedSource
    from observer.opening import open_source
    from observer.parameters import effective
    from observer.parameters import preset as find_preset

    chosen = effective(find_preset(preset), parameters or {})
    opened = open_source(source)
    try:
        info = opened.source.info
        given = None
        if calibration is not None:
            size = (info.width, info.height)
            given = read_any([named_file(str(calibration))], expected_size=size).calibration
        return ObservedSource(opened, chosen, given)
    except BaseException:
        opened.source.close()
        raise


def load(run: Path | str, data: Path | str | None = None) -> LoadedRun:
    """Read a recorded run.

    Args:
        run: a recording's file, a run's folder, or the id of a run or its beginning.
        data: the data folder in which a run is searched by its id.

    Raises:
        SourceError: there is no such recording, or it cannot be read.

    Example::

        with observer.load("recording.mcap") as run:
            for track in run.tracks:
                plt.plot(track.times, track.speeds, label=f"track {track.id}")
            for pair in run.speed_comparisons():
                print(pair.body, pair.rmse)
            plt.imshow(run.picture(10))
            rerun = run.rerun({"ego_motion.model": "affine"})
    """
    from observer.notebook.run import LoadedRun
    from observer.recording.run_folder import find_recording

    return LoadedRun(find_recording(run, None if data is None else Path(data)))
