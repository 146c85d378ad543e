"""C3D files: markers in binary, read by the package ``c3d``, which the extra ``c3d`` installs.

It is plain Python: a damaged file raises an exception instead of crashing the process, as C++
readers may. The format: C3D.ORG, The C3D File Format User Guide.
"""

from __future__ import annotations

import importlib.util
import math
import mmap
import warnings
from pathlib import Path
from typing import Any

import numpy as np

from observer.errors import TruthError
from observer.extras import package_missing
from observer.geometry import Float64Array
from observer.truth.files.body_names import BodyNames
from observer.truth.files.units import FASTEST_HZ, LENGTHS_M, MOST_METRES, length_word
from observer.truth.motion_capture import Capture, Trajectory

# The second byte of every C3D file, and its smallest size: header and parameters.
_KEY = 0x50
_LEAST_BYTES = 1024
_MOST_NUMBERS = 60_000_000
# Groups of points that are model outputs, not positions.
_NO_PLACES = ("ANGLES", "FORCES", "MOMENTS", "POWERS", "SCALARS")


def is_c3d(head: bytes) -> bool:
    """Return whether a file with this beginning is C3D: the key byte, and bytes no text has."""
    return len(head) > 1 and head[1] == _KEY and 0 < head[0] < 0x20 and b"\0" in head


def is_c3d_installed() -> bool:
    """Return whether the extra ``c3d`` is installed."""
    return importlib.util.find_spec("c3d") is not None


def read_c3d(path: Path, name: str, *, rate_hz: float | None = None) -> Capture:
    """Read every marker of the file; times are seconds since the system's frame 1.

    Args:
        name: the file's, for messages. rate_hz: overrides the file's.

    Raises:
        TruthError: the extra ``c3d`` is not installed, or the file is damaged.
    """
    if not is_c3d_installed():
        raise TruthError(
            f"{name}: {package_missing('reading C3D files', 'c3d', 'c3d')} -- or export the "
            "trajectories as CSV"
        )
    if path.stat().st_size < _LEAST_BYTES:
        raise TruthError(f"{name}: the C3D file is truncated; export it again")
    with (
        path.open("rb") as file,
        # A damaged file may claim any length; reads cannot go beyond the end of a memory map.
        mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content,
        warnings.catch_warnings(),
        np.errstate(all="ignore"),
    ):
        # The package warns about things that are checked here or do not matter.
        warnings.simplefilter("ignore")
        try:
            import c3d  # type: ignore[import-untyped]

            return _Trial(c3d.Reader(content), name, len(content)).capture(rate_hz)
        except TruthError:
            raise
        except Exception as error:  # noqa: BLE001 - what the package raises of damage is anything
            why = " ".join(str(error).split())[:80] or type(error).__name__
            raise TruthError(
                f"{name}: the C3D file is damaged ({why}); export it again, or as CSV"
            ) from None


class _Trial:
    """Points of a C3D file."""

    def __init__(self, reader: Any, name: str, size: int) -> None:
        self._reader = reader
        self._name = name
        self._points = int(reader.point_used)
        self._first = self._first_frame()
        self._frames = int(reader.last_frame) - self._first + 1
        if self._points < 1:
            raise TruthError(f"{name}: the C3D file contains no markers")
        if self._frames < 1:
            raise TruthError(f"{name}: the C3D file contains no frames")
        number_bytes = 4 if reader.point_scale < 0 else 2
        if not 0 < abs(reader.point_scale) < math.inf:
            raise TruthError(f"{name}: the C3D file's POINT:SCALE must not be 0")
        if self._frames * self._points * 4 * number_bytes > size:
            raise TruthError(
                f"{name}: the C3D file should have {self._frames} frames of {self._points} "
                "markers, but is shorter; export it again"
            )
        if self._frames * self._points * 3 > _MOST_NUMBERS:
            raise TruthError(
                f"{name}: there are more than {_MOST_NUMBERS} numbers; export a shorter section, "
                "or fewer markers"
            )

    def capture(self, rate_hz: float | None) -> Capture:
        rate = float(self._reader.point_rate) if rate_hz is None else rate_hz
        if not 0 < rate <= FASTEST_HZ:
            raise TruthError(
                f"{self._name}: the frame rate must be above 0 and at most {FASTEST_HZ:g} Hz, not "
                f"{rate:g}; give the frame rate of the capture system in Hz"
            )
        unit, notes = self._unit()
        positions = self._positions() * LENGTHS_M[unit]
        if (np.abs(positions) > MOST_METRES).any():
            raise TruthError(
                f"{self._name}: the C3D file is damaged (a marker is more than {MOST_METRES:g} m "
                "away); export it again"
            )
        times = (self._first - 1 + np.arange(self._frames)) / rate
        left_out = {name for key in _NO_PLACES for name in self._texts(f"POINT:{key}")}
        bodies: dict[str, Trajectory] = {}
        names = BodyNames(self._name)
        labels = self._labels()
        for index in range(self._points):
            label = labels[index] if index < len(labels) else ""
            if label in left_out and label:
                continue
            name = names.of(label)
            bodies[name] = Trajectory(name, times, positions[:, index])
        if not bodies:
            raise TruthError(f"{self._name}: the C3D file contains model outputs, but no markers")
        if len(bodies) < self._points:
            notes += (f"{self._points - len(bodies)} model outputs were ignored",)
        return Capture("C3D markers", rate, bodies, notes)

    def _first_frame(self) -> int:
        """Return the first frame's number; the package misreads large ones."""
        start = self._reader.get("TRIAL:ACTUAL_START_FIELD")
        if start is None:
            return int(self._reader.first_frame)
        low, high = (int(word) for word in start.uint16_array[:2])
        return low + (high << 16)

    def _positions(self) -> Float64Array:
        """Return positions (frames, points, 3) in the file's unit; NaN in gaps."""
        positions = np.full((self._frames, self._points, 3), np.nan)
        read = 0
        for _, points, _ in self._reader.read_frames(copy=False):
            seen = (points[:, 3] >= 0) & (points[:, :3] != 0).any(axis=1)
            positions[read, seen] = points[seen, :3]
            read += 1
            if read == self._frames:
                break
        if read < self._frames:
            raise TruthError(
                f"{self._name}: the C3D file ends after frame {read} of {self._frames}; export it "
                "again"
            )
        return positions

    def _unit(self) -> tuple[str, tuple[str, ...]]:
        texts = self._texts("POINT:UNITS")
        unit = texts[0].lower() if texts else ""
        if unit in LENGTHS_M:
            return unit, (f"positions are in {length_word(unit)}",)
        if unit:
            raise TruthError(
                f"{self._name}: POINT:UNITS must be a length in mm, cm or m, not {unit[:20]!r}"
            )
        return "mm", (
            "positions are assumed to be in millimetres, as the file does not state the unit",
        )

    def _labels(self) -> list[str]:
        # Beyond 255 points the names continue in LABELS2 and so on.
        labels = self._texts("POINT:LABELS")
        number = 2
        while len(labels) < self._points and (more := self._texts(f"POINT:LABELS{number}")):
            labels += more
            number += 1
        return labels

    def _texts(self, key: str) -> list[str]:
        """Return a parameter's strings; the package would loop as often as a damaged file says."""
        parameter = self._reader.get(key)
        if parameter is None:
            return []
        content = bytes(parameter.bytes)
        width = (parameter.dimensions[0] if parameter.dimensions else len(content)) or 1
        return [
            " ".join(content[at : at + width].decode("utf-8", "replace").replace("\0", " ").split())
            for at in range(0, len(content), width)
        ]
