"""C3D files of known markers, and the errors for damaged or unreadable ones."""

from __future__ import annotations

import io
import struct
import sys
import warnings

import c3d
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from observer.errors import TruthError
from observer.geometry import Float64Array
from observer.truth.files.recognition import read_capture

from .conftest import Read, places

COUNT = 40
# The number of markers: name, offset of the next parameter, two bytes, no dimensions.
USED = b"USED\x1e\0\2\0"


def c3d_file(
    markers: dict[str, Float64Array], *, unit: str = "mm", scale: float = -1.0, first: int = 1
) -> bytes:
    """Return a file of positions (N, 3) by label, gaps NaN; integers if the scale is positive."""
    writer = c3d.Writer(point_rate=100.0, point_scale=scale, point_units=unit)
    writer.set_point_labels(list(markers))
    writer.set_start_frame(first)
    together = np.stack(list(markers.values()), axis=1)
    lost = np.isnan(together).any(axis=2, keepdims=True)
    residual = np.where(lost, -1.0, 0.0)
    points = np.concatenate([np.where(lost, 0, together), residual, residual], axis=2)
    writer.add_frames([(frame, np.zeros((0, 0))) for frame in points])
    file = io.BytesIO()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        writer.write(file)
    content = bytearray(file.getvalue())
    # The package writes the high word of large numbers wrongly.
    for title, frame in ((b"START", first), (b"END", first + len(together) - 1)):
        at = content.index(b"ACTUAL_" + title + b"_FIELD") + len(title) + 18
        content[at : at + 4] = struct.pack("<I", frame)
    return bytes(content)


WHOLE = c3d_file({"left": places(COUNT), "right": places(COUNT, seed=1)})


def test_reads_markers_and_gaps(read: Read) -> None:
    left, right = places(COUNT), places(COUNT, seed=1)
    right[5:8] = np.nan
    capture = read(c3d_file({"box:left": left, "box:right": right}))
    assert capture.format == "C3D markers"
    assert capture.rate_hz == 100
    assert list(capture.bodies) == ["box:left", "box:right"]
    np.testing.assert_allclose(capture.bodies["box:left"].positions, left / 1000, atol=1e-6)
    np.testing.assert_allclose(capture.bodies["box:right"].positions, right / 1000, atol=1e-6)
    np.testing.assert_allclose(capture.bodies["box:left"].times, np.arange(COUNT) / 100)
    assert "gaps: 3 of 80 samples are missing, in 1 of 2 bodies" in capture.notes


@pytest.mark.parametrize("first", [11, 70_000, 200_000])
def test_times_count_from_frame_1_even_in_long_trials(read: Read, first: int) -> None:
    body = read(c3d_file({"a": places(COUNT)}, first=first)).bodies["a"]
    np.testing.assert_allclose(body.times, (first - 1 + np.arange(COUNT)) / 100)
    np.testing.assert_allclose(body.positions, places(COUNT) / 1000, atol=1e-6)


def test_reads_units_rates_and_equal_names(read: Read) -> None:
    metres = c3d_file({"a": places(COUNT) / 1000, "a ": places(COUNT) / 1000}, unit="m")
    capture = read(metres, rate_hz=50)
    assert list(capture.bodies) == ["a", "a (2)"]
    np.testing.assert_allclose(capture.bodies["a"].positions, places(COUNT) / 1000, atol=1e-6)
    assert capture.rate_hz == 50
    with pytest.raises(TruthError, match="POINT:UNITS must be a length in mm, cm or m, not 'ft'"):
        read(c3d_file({"a": places(COUNT)}, unit="ft"))
    silent = read(c3d_file({"a": places(COUNT)}, unit="  "))
    assert (
        "positions are assumed to be in millimetres, as the file does not state the unit"
        in silent.notes
    )


def test_missing_package_is_named_with_alternatives(
    read: Read, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda _: None)
    monkeypatch.delitem(sys.modules, "c3d")
    with pytest.raises(TruthError) as caught:
        read(WHOLE)
    assert str(caught.value) == (
        "upload: reading C3D files needs the package c3d, which is not installed; install it with: "
        f"{sys.executable} -m pip install 'dynamic-observer[c3d]' "
        "-- or export the trajectories as CSV"
    )


def test_refuses_a_truncated_file(read: Read) -> None:
    for length in (600, 1100, len(WHOLE) - 600):
        with pytest.raises(
            TruthError, match=r"C3D file (is truncated|is damaged|should have|ends after)"
        ):
            read(WHOLE[:length])


def test_refuses_a_file_of_an_unknown_processor(read: Read) -> None:
    damaged = bytearray(WHOLE)
    # The parameter header starts in the second block; its fourth byte is the processor.
    damaged[512 + 3] = 99
    with pytest.raises(TruthError, match="C3D file is damaged"):
        read(bytes(damaged))


def test_refuses_a_file_without_markers(read: Read) -> None:
    damaged = bytearray(WHOLE.replace(USED + b"\2\0", USED + b"\0\0"))
    damaged[2:4] = b"\0\0"
    assert damaged[100:] != WHOLE[100:], "the parameter was found"
    with pytest.raises(TruthError, match="contains no markers"):
        read(bytes(damaged))


@settings(max_examples=150)
@given(
    st.lists(st.tuples(st.integers(0, 2000), st.integers(0, 255)), max_size=12),
    st.integers(0, len(WHOLE)),
    st.booleans(),
)
def test_damaged_file_gives_a_truth_error_or_a_capture(
    tmp_path_factory: pytest.TempPathFactory,
    changes: list[tuple[int, int]],
    length: int,
    cut: bool,
) -> None:
    damaged = bytearray(WHOLE)
    for at, value in changes:
        damaged[at % len(damaged)] = value
    path = tmp_path_factory.getbasetemp() / "damaged"
    path.write_bytes(damaged[:length] if cut else damaged)
    try:
        capture = read_capture(path)
    except TruthError:
        return
    assert all(len(body.times) for body in capture.bodies.values())
