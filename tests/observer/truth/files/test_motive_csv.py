"""Rigid bodies of OptiTrack Motive."""

from __future__ import annotations

import contextlib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from observer.errors import TruthError
from observer.truth.files.recognition import read_capture

from .conftest import Read

HEAD = (
    "Format Version,1.23,Take Name,a walk,Capture Frame Rate,120.0,Export Frame Rate,100.0,"
    "Rotation Type,Quaternion,Length Units,Millimeters,Coordinate Space,Global"
)
BODY = ["Rigid Body"] * 8 + ["Rigid Body Marker"] * 3
NAMES = ["drone"] * 8 + ["drone:1"] * 3
KINDS = ["Rotation"] * 4 + ["Position"] * 3 + ["Mean Marker Error"] + ["Position"] * 3
AXES = ["X", "Y", "Z", "W", "X", "Y", "Z", "", "X", "Y", "Z"]
TURNED = Rotation.random(3, rng=1)
PLACES = np.array([[1.0, 2.0, 3.0], [1.1, 2.0, 3.0], [np.nan] * 3])


def text(*, head: str = HEAD, types: list[str] = BODY) -> str:
    """A file of three frames, in the last of which the body was not seen."""
    lines = [head, ""]
    for title, row in (("Type", types), ("Name", NAMES), ("ID", NAMES), ("", KINDS)):
        lines.append(",".join(["", title, *row]))
    lines.append(",".join(["Frame", "Time (Seconds)", *AXES]))
    for number, (place, turn) in enumerate(zip(PLACES, TURNED.as_quat(), strict=True)):
        cells = ["" if np.isnan(place[0]) else repr(float(c)) for c in (*turn, *1e3 * place)]
        lines.append(",".join([str(number), repr(number / 100), *cells, "0.1", "7", "8", "9"]))
    return "\n".join(lines) + "\n"


def test_reads_rigid_bodies_with_z_upwards(read: Read) -> None:
    capture = read(text())
    assert (capture.format, capture.rate_hz) == ("Motive CSV", 100.0)
    assert list(capture.bodies) == ["drone"]
    body = capture.bodies["drone"]
    assert body.times.tolist() == [0.0, 0.01, 0.02]
    # What was y is z now, and what was z points back.
    np.testing.assert_allclose(body.positions[0], [1.0, -3.0, 2.0])
    assert np.isnan(body.positions[2]).all()
    assert body.rotations is not None
    up_motive = TURNED.as_matrix()[0, 1]
    np.testing.assert_allclose(body.rotations[0, 2], up_motive, atol=1e-12)
    assert np.linalg.det(body.rotations[0]) == pytest.approx(1.0)
    assert any("4 columns of markers" in note for note in capture.notes)


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        (text(head=HEAD.replace("Millimeters", "Yards")), "Length Units must be meters"),
        (text(head=HEAD.replace("Quaternion", "XYZ")), "Rotation Type Quaternion, not 'XYZ'"),
        (text(types=["Marker"] * 11), "export rigid bodies"),
        (text().replace("Frame,Time", "Picture,Time"), "the line with Frame and Time is missing"),
        (text().replace("0.01,", "0.0,"), "line 9 cell 2: the time is not later"),
    ],
)
def test_what_cannot_be_read_is_refused_in_a_sentence(read: Read, changed: str, told: str) -> None:
    with pytest.raises(TruthError) as refused:
        read(changed)
    assert told in str(refused.value)


def test_marker_tables_are_refused_by_name(read: Read) -> None:
    with pytest.raises(TruthError, match="a TRC file holds single markers"):
        read("PathFileType\t4\t(X/Y/Z)\ta.trc\n")


@settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.integers(0, 900), st.integers(0, 60), st.text(max_size=8))
def test_no_damage_is_more_than_a_refusal(tmp_path: Path, at: int, length: int, put: str) -> None:
    whole = text()
    file = tmp_path / "damaged.csv"
    file.write_text(whole[:at] + put + whole[at + length :], errors="replace")
    with contextlib.suppress(TruthError):
        assert read_capture(file).bodies


@pytest.mark.parametrize(
    ("name", "body", "samples"),
    [
        ("motive_1.21.csv", "Rigid Body 1", 250),
        ("motive_1.23.csv", "drone", 1493),
        ("euroc_groundtruth.csv", "body", 1999),
        ("tum_repeated_time.txt", "body", 1500),
    ],
)
def test_files_of_other_tools_are_read(
    shared_data: Path, name: str, body: str, samples: int
) -> None:
    capture = read_capture(shared_data / "wild" / "motion_capture" / name)
    assert len(capture.bodies[body].times) == samples
    assert capture.bodies[body].rotations is not None
