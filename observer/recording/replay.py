"""Re-run of a recording, with the original or with other parameters."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

from observer.mount import CameraMount
from observer.observer import Observer
from observer.parameters import Parameters
from observer.recording.reader import Recording
from observer.recording.source import RecordingSource
from observer.types import Observation, StereoFrame

# Parameters and revision by the position of the first frame they apply to.
Revisions = Mapping[int, tuple[Parameters, int]]


def replay_revisions(
    recording: Recording, changes: Mapping[str, Any] | None = None
) -> dict[int, tuple[Parameters, int]]:
    """Return a run's parameters and revisions by the position of the first frame they apply to.

    Args:
        changes: parameters that replace the recorded ones throughout, by dotted name.

    Raises:
        ParameterError: a parameter is unknown to this version or out of range.
    """
    found = {}
    for position, revision in recording.positioned_revisions:
        parameters = Parameters().changed({**Parameters.own(revision.values), **(changes or {})})
        found[position] = parameters, revision.revision
    if 0 not in found:
        found[0] = Parameters().changed(dict(changes or {})), 0
    return found


def replay(
    source: RecordingSource,
    revisions: Revisions,
    *,
    mount: CameraMount | None = None,
) -> Iterator[Observation]:
    """Observe a recording from its first frame on.

    With the run's own revisions and lossless images every result equals the run's to the last
    digit, unless a frame is missing in the recording. Segments are numbered through the run, also
    where its engine was replaced.

    Args:
        revisions: as from ``replay_revisions``; each frame uses the newest one up to it.
        mount: of the camera, for a run that was observed without one.
    """
    mount = source.recording.facts.camera_mount() or mount
    newest = revisions[0]
    observer: Observer | None = None
    # Number of the present observer's first segment, and of segments so far.
    first = segments = 0
    source.rewind()
    while (item := source.read()) is not None:
        position = source.position - 1
        due = revisions.get(position)
        if due is not None:
            newest = due
        if source.begins == "observer":
            observer = None
        if observer is not None and due is not None:
            observer.use(*newest)
        if not isinstance(item, StereoFrame):
            continue
        if observer is None:
            parameters, revision = newest
            observer = Observer(
                source.calibration, parameters, parameters_revision=revision, mount=mount
            )
            first = segments
        if source.begins == "segment":
            observer.begin_segment()
        observation = observer.observe(item)
        observation = replace(observation, segment=first + observation.segment)
        segments = observation.segment + 1
        yield observation
