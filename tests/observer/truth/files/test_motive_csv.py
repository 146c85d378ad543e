"""Rigid bodies of OptiTrack Motive."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
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


def text(
    *,
    head: str = HEAD,
    types: Sequence[str] = BODY,
    names: Sequence[str] = NAMES,
    ids: Sequence[str] = NAMES,
    titled: bool = True,
) -> str:
    """Return a file of three frames; the body is not seen in the last.

    Args:
        titled: whether header rows begin with a title, as from version 1.23 on.
    """
    lines = [head, ""]
    for title, row in (("Type", types), ("Name", names), ("ID", ids), ("", KINDS)):
        lines.append(",".join(["", title if titled else "", *row]))
    lines.append(",".join(["Frame", "Time (Seconds)", *AXES]))
    for number, (place, turn) in enumerate(zip(PLACES, TURNED.as_quat(), strict=True)):
        cells = ["" if np.isnan(place[0]) else repr(float(c)) for c in (*turn, *1e3 * place)]
        lines.append(",".join([str(number), repr(number / 100), *cells, "0.1", "7", "8", "9"]))
    return "\n".join(lines) + "\n"


def poses(*bodies: tuple[str, str], turn: str, rows: Sequence[str], head: str = HEAD) -> str:
    """Return a file of bodies by name and id, with the given rotation columns and rows."""
    lines = [head, ""]
    columns = [
        (name, number, kind, axis)
        for name, number in bodies
        for kind, axes in (("Rotation", turn), ("Position", "XYZ"))
        for axis in axes
    ]
    for title, row in (
        ("Type", ["Rigid Body"] * len(columns)),
        ("Name", [column[0] for column in columns]),
        ("ID", [column[1] for column in columns]),
        ("", [column[2] for column in columns]),
    ):
        lines.append(",".join(["", title, *row]))
    lines.append(",".join(["Frame", "Time (Seconds)", *(column[3] for column in columns)]))
    return "\n".join([*lines, *rows]) + "\n"


@pytest.mark.parametrize("titled", [True, False])
def test_reads_rigid_bodies_converted_to_z_up(read: Read, titled: bool) -> None:
    capture = read(text(titled=titled))
    assert (capture.format, capture.rate_hz) == ("Motive CSV", 100.0)
    assert list(capture.bodies) == ["drone"]
    body = capture.bodies["drone"]
    assert body.times.tolist() == [0.0, 0.01, 0.02]
    # Motive's y becomes z, and its z points backward.
    np.testing.assert_allclose(body.positions[0], [1.0, -3.0, 2.0])
    assert body.seen.tolist() == [True, True, False]
    assert body.rotations is not None
    up_motive = TURNED.as_matrix()[0, 1]
    np.testing.assert_allclose(body.rotations[0, 2], up_motive, atol=1e-12)
    assert np.linalg.det(body.rotations[0]) == pytest.approx(1.0)
    assert np.isnan(body.rotations[2]).all()
    assert "4 columns are ignored (rigid body marker, mean marker error)" in capture.notes
    assert any("millimetres, rotated from y up" in note for note in capture.notes)


def test_fixed_points_turn_with_their_body(read: Read) -> None:
    body = read(text()).bodies["drone"]
    arm = np.array([0.1, 0.2, 0.3])
    x, y, z = (PLACES[:2] + TURNED.apply(arm)[:2]).T
    np.testing.assert_allclose(body.fixed_points(arm)[:2], np.column_stack([x, -z, y]), atol=1e-12)


@pytest.mark.parametrize("order", ["XYZ", "ZYX", "YZX"])
def test_reads_euler_angles_in_the_stated_order(read: Read, order: str) -> None:
    expected = read(text()).bodies["drone"]
    degrees = TURNED.as_euler(order, degrees=True)  # type: ignore[call-overload]
    rows = []
    for number in range(2):
        # Columns are in the order X, Y, Z, whatever the rotation order.
        angles = [float(degrees[number, order.index(axis)]) for axis in "XYZ"]
        cells = (number / 100, *angles, *(float(v) for v in 1e3 * PLACES[number]))
        rows.append(",".join(map(repr, (number, *cells))))
    capture = read(
        poses(("drone", "1"), turn="XYZ", rows=rows, head=HEAD.replace("Quaternion", order))
    )
    np.testing.assert_allclose(capture.bodies["drone"].positions, expected.positions[:2])
    assert expected.rotations is not None
    np.testing.assert_allclose(
        capture.bodies["drone"].rotations, expected.rotations[:2], atol=1e-12
    )
    assert f"angles are Euler angles {order} in degrees" in capture.notes


def test_bodies_with_equal_names_are_distinguished_by_id(read: Read) -> None:
    capture = read(
        poses(("cup", "A"), ("cup", "B"), turn="XYZW",
              rows=["0,0,0,0,0,1,1000,0,0,0,0,0,1,2000,0,0"])
    )  # fmt: skip
    assert list(capture.bodies) == ["cup", "cup (2)"]
    assert [body.positions[0, 0] for body in capture.bodies.values()] == [1.0, 2.0]


def test_bodies_without_rotations_are_read(read: Read) -> None:
    whole = poses(
        ("cup", "A"), turn="", rows=["0,0,1,2,3"], head=HEAD.replace("Quaternion", "None")
    )
    assert read(whole).bodies["cup"].rotations is None


@pytest.mark.parametrize(
    ("unit", "metres"),
    [("Meters", 1.0), ("Centimeters", 0.01), ("Inches", 0.0254), ("Feet", 0.3048)],
)
def test_reads_the_unit_stated_in_the_file(read: Read, unit: str, metres: float) -> None:
    body = read(text(head=HEAD.replace("Millimeters", unit))).bodies["drone"]
    np.testing.assert_allclose(body.positions[0], np.array([1000, -3000, 2000]) * metres)


def test_commas_in_take_notes_are_harmless(read: Read) -> None:
    whole = text(head=HEAD.replace("Take Name,a walk", "Take Notes,slow, then fast"))
    assert read(whole).rate_hz == 100.0


def test_empty_lines_are_skipped(read: Read) -> None:
    body = read(text().replace("\n", "\r\r\n")).bodies["drone"]
    assert len(body.times) == len(PLACES)


def test_reads_spreadsheet_exports_with_semicolons(read: Read) -> None:
    body = read(text().replace(",", ";").replace(".", ",")).bodies["drone"]
    np.testing.assert_allclose(body.positions[1], [1.1, -3.0, 2.0])


def test_implausible_frame_rate_is_ignored(read: Read) -> None:
    for rate in ("0", "1e300", "nan", "1_0", "fast"):
        head = HEAD.replace("Export Frame Rate,100.0", f"Export Frame Rate,{rate}")
        assert read(text(head=head)).rate_hz is None


TURN, ONE = "XYZW", ("cup", "A")


@pytest.mark.parametrize(
    ("changed", "expected"),
    [
        (text(head=HEAD.replace("Millimeters", "Yards")), "line 1: Length Units must be meters"),
        (text(head=HEAD.replace("Global", "Local")), "line 1: export with the Coordinate Space"),
        (text(head=HEAD.replace("Quaternion", "XYX")), "Rotation Type Quaternion, not 'XYX'"),
        (text(head=HEAD.replace("Quaternion", "XYZ")), "line 7: the rotation of 'drone' must be"),
        (text(types=["Marker"] * 11), "it contains no rigid bodies; export with Rigid Bodies"),
        (text(types=["Bone"] * 11), "it contains no rigid bodies; export with Rigid Bodies"),
        (text(types=["Rigid Body"] * 11, names=["drone"] * 11, ids=["1"] * 11),
         "line 7 cell 11: the position X of 'drone' appears twice"),
        (text().replace("Frame,Time", "Picture,Time"), "the line with Frame and Time is missing"),
        (text().replace("Time (Seconds)", "X"), "line 7 cell 2: the column after Frame must be"),
        (HEAD + "\n", "the line with Frame and Time is missing"),
        (HEAD + "\n,Type,Rigid Body\nFrame,Time,X\n", "line 3: the header rows with types, names"),
        (text().replace("0.01,", "0.0,"), "line 9 cell 2: the time is not later"),
        (text().replace("0.01,", ","), "line 9 cell 2: the time must be given"),
        (text().replace("0.02,", "1e300,"), "line 10 cell 2: the time must be given and at most"),
        (text().replace("1100.0", ""), "line 9 cell 7: X, Y and Z of drone must all be given"),
        (text().replace("1100.0", "1e99"), "line 9 cell 7: the position of drone must be within"),
        (text().replace("1100.0", "far"), "line 9 cell 7: drone position x must be a number"),
        (poses(ONE, turn=TURN, rows=[]), "it contains no data rows"),
        (poses(ONE, turn=TURN, rows=["0,0,1,1,1,1,0,0,0"]),
         "line 8 cell 3: the rotation of cup must be a unit quaternion"),
        (poses(ONE, turn="XYW", rows=["0,0,0,0,1,0,0,0"]), "columns W, X, Y, Z"),
        (poses(ONE, turn="XYZ", rows=["0,0,1e9,0,0,0,0,0"], head=HEAD.replace("Quaternion", "ZYX")),
         "line 8 cell 5: the angles of cup must be within"),
    ],
)  # fmt: skip
def test_unreadable_file_is_refused_with_a_one_line_reason(
    read: Read, changed: str, expected: str
) -> None:
    with pytest.raises(TruthError) as refused:
        read(changed)
    assert expected in str(refused.value)
    assert str(refused.value).startswith("upload")
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    "content", ["PathFileType\t4\t(X/Y/Z)\ta.trc\n", "PathFileType,4,(X/Y/Z),a\n"]
)
def test_marker_tables_are_refused_by_name(read: Read, content: str) -> None:
    with pytest.raises(TruthError, match=r"a TRC file contains single markers.* as CSV, or C3D$"):
        read(content)


def test_third_party_marker_table_is_refused_by_name(shared_data: Path) -> None:
    with pytest.raises(TruthError, match=r"^markers\.trc: a TRC file contains single markers"):
        read_capture(shared_data / "wild" / "motion_capture" / "markers.trc")


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.integers(0, 900), st.integers(0, 60), st.text(max_size=8))
def test_damaged_file_is_read_or_refused(tmp_path: Path, at: int, length: int, put: str) -> None:
    whole = text()
    file = tmp_path / "damaged.csv"
    file.write_text(whole[:at] + put + whole[at + length :], errors="replace")
    with contextlib.suppress(TruthError):
        assert read_capture(file).bodies


@pytest.mark.parametrize(
    ("name", "expected", "body", "samples", "gaps"),
    [
        ("motive_1.21.csv", "Motive CSV", "Rigid Body 1", 250, 0),
        ("motive_1.23.csv", "Motive CSV", "drone", 1493, 13),
        ("euroc_groundtruth.csv", "EuRoC ground truth", "body", 1999, 0),
        ("tum_repeated_time.txt", "TUM trajectory", "body", 1500, 0),
    ],
)
def test_third_party_files_are_read(
    shared_data: Path, name: str, expected: str, body: str, samples: int, gaps: int
) -> None:
    capture = read_capture(shared_data / "wild" / "motion_capture" / name)
    assert capture.format == expected
    assert list(capture.bodies) == [body]
    found = capture.bodies[body]
    assert (len(found.times), found.gaps) == (samples, gaps)
    assert found.rotations is not None
    np.testing.assert_allclose(np.linalg.det(found.rotations[found.seen]), 1.0)
