"""Source that was chosen, with its calibration."""

from __future__ import annotations

from dataclasses import dataclass

from app.contract.values import LONGEST_SPEC
from app.server.calibrations.library import find_calibration
from app.server.errors import FieldError, NotThere
from app.server.source.camera_match import calibration_of_cameras
from app.storage import CalibrationRecord, Storage
from observer.errors import SourceError
from observer.opening import source_kind
from observer.recording.run_folder import find_recording

# Prefix of a spec that names the recording of a stored run by the run's id, not by its path.
RUN = "run:"


@dataclass(frozen=True)
class ChosenSource:
    """Source with the calibration that replaces its own.

    Attributes:
        name: display name of a run's recording; None for other sources.
    """

    source: str
    calibration: CalibrationRecord | None
    name: str | None = None

    @property
    def endless(self) -> bool:
        """Return whether a run of it lasts until a user ends it; a recording ends by itself."""
        return source_kind(self.source) == "simulated"


def check_spec(source: str) -> None:
    """Refuse a text that names no source before anything is opened.

    Raises:
        FieldError: the text is empty, too long, or has unreadable characters.
    """
    if not source.isprintable() or not 0 < len(source) <= LONGEST_SPEC:
        raise FieldError(
            ("body", "source"),
            "give simulated:SCENARIO, camera:0,1, rtsp://LEFT,rtsp://RIGHT, video:LEFT,RIGHT, "
            "coppeliasim:HOST:PORT, run:ID or the path of a folder or of a recording.mcap",
        )


def choose_source(storage: Storage, source: str, calibration_id: str | None) -> ChosenSource:
    """Return a source with the calibration asked for; live cameras default to their newest one.

    Raises:
        FieldError: the text names no source, or there is no such calibration.
    """
    check_spec(source)
    source = _recording_of(storage, source)
    name = storage.recording_name(source)
    if calibration_id is None:
        return ChosenSource(source, calibration_of_cameras(storage, source), name)
    try:
        return ChosenSource(source, find_calibration(storage, calibration_id), name)
    except NotThere as error:
        raise FieldError(("body", "calibration"), str(error)) from error


def _recording_of(storage: Storage, source: str) -> str:
    if not source.startswith(RUN):
        return source
    try:
        return str(find_recording(source.removeprefix(RUN), storage.folder.path).absolute())
    except SourceError as error:
        raise FieldError(("body", "source"), str(error)) from error
