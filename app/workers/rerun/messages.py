"""Messages to and from the worker: plain frozen dataclasses, sent as pickles."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from app.contract.parameters import ParameterValues


@dataclass(frozen=True)
class Rerun:
    """Request to observe a recording once, from its first frame to its last.

    Attributes:
        images: path of the recording that holds the frames.
        output: path of the new recording, which holds no images.
        results: path for what the server keeps of each frame: ``FrameResult`` as JSON lines.
        id, name, preset, versions: of the new run, as in ``RunFacts``.
        parameters: all parameters by dotted name, including the guard's.
        rig_yaml: rig of the run; gives the camera's mount if the recording does not.
    """

    images: str
    output: str
    results: str
    id: str
    name: str
    preset: str | None
    versions: Mapping[str, str]
    parameters: ParameterValues
    rig_yaml: str | None


@dataclass(frozen=True)
class Rerunned:
    """End of a re-run.

    Attributes:
        frames, segments, begin_s, duration_s: of the new run, as in ``RunRecord``.
        bytes: size of its recording.
        lost: number of frames whose images could not be read.
    """

    frames: int
    segments: int
    begin_s: float | None
    duration_s: float | None
    bytes: int
    lost: int
