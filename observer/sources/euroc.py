"""EuRoC: ``mav0/cam0`` and ``mav0/cam1``, each with ``data/``, ``data.csv``, ``sensor.yaml``."""

from __future__ import annotations

from pathlib import Path

from observer.calibration.formats.euroc_file import read_euroc
from observer.camera import StereoCalibration
from observer.errors import SourceError
from observer.image_files.listing import FilePair, MissingPair, read_lines
from observer.sources.file_pairs import FilePairSource


def open_euroc(folder: Path) -> FilePairSource:
    """Open a sequence in EuRoC's layout; ``folder`` is ``mav0`` or the folder that holds it.

    Images with the same stamp are a pair. Times are seconds since the first stamp.

    Raises:
        SourceError: a part is missing or unusable.
        CalibrationError: the ``sensor.yaml`` files are there and unusable.
    """
    root = folder / "mav0" if (folder / "mav0").is_dir() else folder
    left, right = root / "cam0", root / "cam1"
    for camera in (left, right):
        if not camera.is_dir():
            raise SourceError(
                f"{root} has no {camera.name}; EuRoC's layout needs cam0 (left) and cam1 (right)"
            )

    def calibrate(_width: int, _height: int) -> StereoCalibration | None:
        files = left / "sensor.yaml", right / "sensor.yaml"
        return read_euroc(*files) if all(file.is_file() for file in files) else None

    return FilePairSource(
        spec=str(folder), kind="EuRoC", entries=_entries(left, right), calibrate=calibrate
    )


def read_image_list(path: Path) -> dict[int, str]:
    """Return file names by stamp, nanoseconds, from a ``data.csv``.

    Raises:
        SourceError: the file is missing, a line is malformed or a stamp appears twice.
    """
    names: dict[int, str] = {}
    where = f"{path.parent.name}/{path.name}"
    for number, line in read_lines(path):
        stamp, _, name = (part.strip() for part in line.partition(","))
        if not (stamp.isascii() and stamp.isdecimal() and len(stamp) < 20) or not name:
            raise SourceError(
                f"{where} line {number} must be a timestamp in nanoseconds and a file name, not "
                f"{line[:60]!r}"
            )
        # A list of images must not reach outside its own folder.
        if name in (".", "..") or "/" in name or "\\" in name:
            raise SourceError(f"{where} line {number} must name a file in data, not {name[:60]!r}")
        if int(stamp) in names:
            raise SourceError(f"{where} line {number} repeats the timestamp {stamp}")
        names[int(stamp)] = name
    return names


def _entries(left: Path, right: Path) -> list[FilePair | MissingPair]:
    left_names = read_image_list(left / "data.csv")
    right_names = read_image_list(right / "data.csv")
    if not left_names.keys() & right_names.keys():
        raise SourceError(
            f"no timestamp occurs in both {left.name}/data.csv and {right.name}/data.csv of "
            f"{left.parent}; the two images of a pair must have the same timestamp"
        )
    stamps = sorted(left_names.keys() | right_names.keys())
    entries: list[FilePair | MissingPair] = []
    for stamp in stamps:
        if stamp not in left_names or stamp not in right_names:
            lacking = right if stamp in left_names else left
            entries.append(
                MissingPair(f"the image with timestamp {stamp} is missing in {lacking.name}")
            )
            continue
        entries.append(
            FilePair(
                left / "data" / left_names[stamp],
                right / "data" / right_names[stamp],
                # Relative to the first: a float64 of seconds since 1970 resolves only 0.2 us.
                (stamp - stamps[0]) * 1e-9,
            )
        )
    return entries
