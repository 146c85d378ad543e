"""The layouts of KITTI's odometry and raw data.

Odometry: ``image_0 image_1`` or ``image_2 image_3``, ``times.txt``, ``calib.txt``. Raw:
``image_00/data``, ``image_00/timestamps.txt``, ``calib_cam_to_cam.txt``, and so on.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path

from observer.calibration.ageing.row_refinement import RowRefinement, refine_from_scene
from observer.calibration.formats.kitti_file import read_kitti_odometry, read_kitti_raw
from observer.camera import StereoCalibration
from observer.errors import SourceError
from observer.image_files.listing import (
    FilePair,
    MissingPair,
    pairs_by_name,
    read_lines,
    read_times,
)
from observer.image_files.reading import read_image
from observer.sources.file_pairs import FilePairSource

# Number of pairs, spread evenly over the drive, from which the rows are aligned.
_REFINED_BY = 4
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


def open_kitti_odometry(folder: Path) -> FilePairSource:
    """Open a sequence of KITTI's odometry benchmark; its images are rectified.

    The grey pair is used where both pairs are there.

    Raises:
        SourceError: a part is missing or unusable.
        CalibrationError: ``calib.txt`` is there and unusable.
    """
    left = _left_camera(folder, "image_{}", "KITTI odometry")
    calibration_file = folder / "calib.txt"

    def calibrate(width: int, height: int) -> StereoCalibration | None:
        if not calibration_file.is_file():
            return None
        return read_kitti_odometry(calibration_file, left, width, height)

    return FilePairSource(
        spec=str(folder),
        kind="KITTI odometry",
        entries=pairs_by_name(
            folder / f"image_{left}",
            folder / f"image_{left + 1}",
            read_times(folder / "times.txt"),
            "times.txt",
        ),
        calibrate=calibrate,
    )


def open_kitti_raw(folder: Path) -> FilePairSource:
    """Open a drive of KITTI's raw data, rectified (``_sync``) or not (``_extract``).

    The grey pair is used where both pairs are there. Times are seconds since the left camera's
    first stamp; each image keeps its own.

    One calibration served a whole day of driving and is off by some 0.02 degrees in pitch, which
    is half a pixel between the rows of unrectified drives. Pitch and roll between the cameras are
    therefore refined from a few pairs of the drive; everything else is as in the file.

    Raises:
        SourceError: a part is missing or unusable.
        CalibrationError: ``calib_cam_to_cam.txt`` is there (or one folder up) and unusable.
    """
    left = _left_camera(folder, "image_{:02d}", "KITTI raw")
    entries = _entries(folder / f"image_{left:02d}", folder / f"image_{left + 1:02d}")

    def calibrate(width: int, height: int) -> StereoCalibration | None:
        # A day's calibration is in the folder of its drives.
        for place in (folder, folder.resolve().parent):
            file = place / "calib_cam_to_cam.txt"
            if file.is_file():
                calibration = read_kitti_raw(file, left, width, height)
                return calibration if calibration.is_rectified else _refined(calibration, entries)
        return None

    return FilePairSource(spec=str(folder), kind="KITTI raw", entries=entries, calibrate=calibrate)


def read_timestamps_ns(path: Path) -> list[int]:
    """Return nanoseconds since 1970, one for each line such as ``2011-09-26 14:06:06.052646144``.

    Raises:
        SourceError: the file is missing or a line is not a time.
    """
    stamps = []
    for number, line in read_lines(path):
        whole, _, fraction = line.partition(".")
        try:
            moment = datetime.fromisoformat(whole)
            # int() also accepts signs, underscores and the digits of other scripts.
            if not re.fullmatch(r"[0-9]*", fraction):
                raise ValueError
            nanoseconds = int(fraction[:9].ljust(9, "0"))
        except ValueError:
            raise SourceError(
                f"{path.parent.name}/{path.name} line {number} must be a time such as "
                f"2011-09-26 14:06:06.052646144, not {line[:40]!r}"
            ) from None
        elapsed = moment.replace(tzinfo=UTC) - _EPOCH
        stamps.append((elapsed.days * 86400 + elapsed.seconds) * 1_000_000_000 + nanoseconds)
    return stamps


def _entries(left: Path, right: Path) -> list[FilePair | MissingPair]:
    left_ns = read_timestamps_ns(left / "timestamps.txt")
    right_ns = read_timestamps_ns(right / "timestamps.txt")
    start = left_ns[0] if left_ns else 0
    # Relative to the first: seconds since 1970 would leave a float64 only 0.2 microseconds.
    times = [(stamp - start) * 1e-9 for stamp in left_ns]
    right_times = [(stamp - start) * 1e-9 for stamp in right_ns]
    name = f"{left.name}/timestamps.txt"
    return pairs_by_name(left / "data", right / "data", times, name, right_times)


def _refined(
    calibration: StereoCalibration, entries: Sequence[FilePair | MissingPair]
) -> StereoCalibration:
    """Return the calibration with its rows aligned by the drive's images, where they allow it."""
    pairs = [entry for entry in entries if isinstance(entry, FilePair)]
    chosen = pairs[:: max(1, len(pairs) // _REFINED_BY)][:_REFINED_BY]
    images = []
    for pair in chosen:
        with suppress(SourceError):
            images.append((read_image(pair.left), read_image(pair.right)))
    size = (calibration.height, calibration.width)
    same_size = [(a, b) for a, b in images if a.shape[:2] == size == b.shape[:2]]
    refinement = refine_from_scene(calibration, same_size)
    return refinement.calibration if isinstance(refinement, RowRefinement) else calibration


def _left_camera(folder: Path, name: str, layout: str) -> int:
    """Return the number of the left camera of the grey pair, or of the colour pair without one.

    Args:
        name: of a camera's folder, with a placeholder for its number.

    Raises:
        SourceError: neither pair is there.
    """
    names = [name.format(number) for number in range(4)]
    for left in (0, 2):
        if all((folder / each).is_dir() for each in names[left : left + 2]):
            return left
    raise SourceError(
        f"{folder} contains images of only one camera; {layout} needs {names[0]} and {names[1]}, "
        f"or {names[2]} and {names[3]}"
    )
