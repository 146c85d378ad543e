"""Motion-capture files of known motion, written as Vicon's programs write them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest

from observer.geometry import Float64Array
from observer.truth.files.recognition import read_capture
from observer.truth.motion_capture import Capture

BOM = "\ufeff"
Body = tuple[Float64Array, Float64Array]
Read = Callable[..., Capture]


def cells(row: Float64Array) -> str:
    """Format with six digits, as Vicon does; gaps are empty."""
    return ",".join("" if np.isnan(value) else f"{value:.6g}" for value in row)


def tracker_csv(
    bodies: Mapping[str, Body],
    *,
    title: str = "Objects",
    rate: str | None = "100",
    units: str = "rad,rad,rad,mm,mm,mm",
    columns: str = "RX,RY,RZ,TX,TY,TZ",
    prefix: str = "Global Angle ",
    first: int = 1,
) -> str:
    """Return a Tracker file of angles (N, 3) and positions (N, 3) by name, in the file's units.

    It has all the quirks: a byte order mark, CRLF, one cell too many in the third row, an
    empty line at the end.
    """
    count = len(next(iter(bodies.values()))[0])
    commas = "," * (columns.count(",") + 1)
    rows = [
        title,
        *([] if rate is None else [rate]),
        ",," + "".join(f"{prefix}{name}{commas}" for name in bodies) + ",",
        "Frame,Sub Frame," + ",".join([columns] * len(bodies)),
        ",," + ",".join([units] * len(bodies)),
    ]
    for k in range(count):
        numbers = [cells(np.concatenate([a[k], p[k]])) for a, p in bodies.values()]
        rows.append(f"{first + k},0," + ",".join(numbers))
    return BOM + "\r\n".join([*rows, "", ""])


def nexus_csv(markers: Mapping[str, Float64Array], *, unit: str = "mm", rate: str = "100") -> str:
    """Return a section Trajectories of positions (N, 3) by name, in the file's unit."""
    count = len(next(iter(markers.values())))
    rows = [
        "Trajectories",
        rate,
        ",," + "".join(f"{name},,," for name in markers),
        "Frame,Sub Frame," + ",".join(["X,Y,Z"] * len(markers)),
        ",," + ",".join([f"{unit},{unit},{unit}"] * len(markers)),
    ]
    for k in range(count):
        rows.append(f"{k + 1},0," + ",".join(cells(p[k]) for p in markers.values()))
    return "\r\n".join([*rows, ""])


DEVICES = (
    "Devices\r\n2000\r\n,,EMG,,\r\nFrame,Sub Frame,1,2\r\n,,V,V\r\n"
    "1,0,0.1,0.2\r\n1,1,0.1,0.2\r\n1,2,0.1,0.2\r\n\r\n"
)


def places(count: int, *, seed: int = 0) -> Float64Array:
    """Return (N, 3) millimetres within a room, rounded as in a file."""
    drawn = np.random.default_rng(seed).uniform(-3000, 3000, (count, 3))
    return np.array([[float(f"{value:.6g}") for value in row] for row in drawn])


@pytest.fixture
def read(tmp_path: Path) -> Read:
    """Read a text or bytes as a file whose name reveals nothing."""

    def read_content(content: str | bytes, **choices: object) -> Capture:
        path = tmp_path / "upload"
        path.write_bytes(content.encode() if isinstance(content, str) else content)
        return read_capture(path, **choices)  # type: ignore[arg-type]

    return read_content
