"""KITTI odometry: ``image_0 image_1`` or ``image_2 image_3``, ``times.txt``, ``calib.txt``."""

from __future__ import annotations

from pathlib import Path

from observer.calibration.formats.kitti_file import read_kitti_odometry
from observer.camera import StereoCalibration
from observer.errors import SourceError
from observer.image_files.listing import pairs_by_name, read_times
from observer.sources.file_pairs import FilePairSource


def open_kitti_odometry(folder: Path) -> FilePairSource:
    """Open a sequence of KITTI's odometry benchmark; its images are rectified.

    The grey pair is taken where both pairs are there.

    Raises:
        SourceError: a part is missing or unusable.
        CalibrationError: ``calib.txt`` is there and unusable.
    """
    pairs = (k for k in (0, 2) if all(_camera(folder, c).is_dir() for c in (k, k + 1)))
    left = next(pairs, None)
    if left is None:
        raise SourceError(
            f"{folder} has images of one camera only; KITTI odometry needs image_0 and image_1, "
            f"or image_2 and image_3"
        )
    calibration_file = folder / "calib.txt"

    def calibrate(width: int, height: int) -> StereoCalibration | None:
        if not calibration_file.is_file():
            return None
        return read_kitti_odometry(calibration_file, left, width, height)

    return FilePairSource(
        spec=str(folder),
        kind="KITTI odometry",
        entries=pairs_by_name(
            _camera(folder, left),
            _camera(folder, left + 1),
            read_times(folder / "times.txt"),
            "times.txt",
        ),
        calibrate=calibrate,
    )


def _camera(folder: Path, number: int) -> Path:
    return folder / f"image_{number}"
