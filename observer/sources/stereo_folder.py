"""A stereo folder: ``left/ right/ times.txt`` and, usually, ``calibration.yaml``."""

from __future__ import annotations

from pathlib import Path

from observer.calibration.formats.opencv_file import read_noted_calibration
from observer.camera import StereoCalibration
from observer.image_files.listing import pairs_by_name, read_times
from observer.sources.file_pairs import FilePairSource


def open_stereo_folder(folder: Path) -> FilePairSource:
    """Open a stereo folder; the two images of a pair have equal file names.

    Raises:
        SourceError: a part is missing or unusable.
        CalibrationError: ``calibration.yaml`` is there and unusable.
    """
    times = read_times(folder / "times.txt")
    calibration_file = folder / "calibration.yaml"

    notes: list[str] = []

    def calibrate(_width: int, _height: int) -> StereoCalibration | None:
        if not calibration_file.is_file():
            return None
        calibration, calibration_notes = read_noted_calibration(calibration_file)
        notes.extend(calibration_notes)
        return calibration

    source = FilePairSource(
        spec=str(folder),
        kind="stereo folder",
        entries=pairs_by_name(folder / "left", folder / "right", times, "times.txt"),
        calibrate=calibrate,
    )
    source.calibration_notes = tuple(notes)
    return source
