"""Recognition of the layout of a folder of stereo images; each layout has its own module."""

from __future__ import annotations

from pathlib import Path

from observer.errors import SourceError
from observer.sources.euroc import open_euroc
from observer.sources.file_pairs import FilePairSource
from observer.sources.kitti import open_kitti_odometry, open_kitti_raw
from observer.sources.stereo_folder import open_stereo_folder

# One of a layout's folders is enough to recognise it; its reader reports what is missing.
_LAYOUTS = (
    (open_euroc, ("mav0", "cam0/data.csv", "cam1/data.csv")),
    (open_kitti_raw, tuple(f"image_{k:02d}/data" for k in range(4))),
    (open_kitti_odometry, tuple(f"image_{k}" for k in range(4))),
    (open_stereo_folder, ("left", "right")),
)


def open_folder(path: Path) -> FilePairSource:
    """Open a folder of stereo images; its content determines the layout.

    Raises:
        SourceError: there is no such folder, no layout is recognised, or its parts are unusable.
        CalibrationError: a calibration is there and unusable.
    """
    if not path.exists():
        if path.name == str(path):
            raise SourceError(f"“{path}” is neither a known source nor an existing folder")
        raise SourceError(f"there is no folder {path}")
    if not path.is_dir():
        raise SourceError(
            f"{path} is a file; give a folder of stereo images, or video:{path} for a video"
        )
    for open_layout, signs in _LAYOUTS:
        if any((path / sign).exists() for sign in signs):
            return open_layout(path)
    raise SourceError(
        f"{path} contains no stereo images in a known layout; it needs left/ and right/ with "
        "times.txt (stereo folder), image_0/ and image_1/ (KITTI odometry), image_00/data/ and "
        "image_01/data/ (KITTI raw), or mav0/cam0/ and mav0/cam1/ (EuRoC)"
    )
