"""Plain CSV and TUM: samples with their own timestamps."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from observer.errors import TruthError
from observer.truth.alignment.curves import between

from .conftest import Read

T = np.array([1305031102.1758, 1305031102.2, 1305031102.25])
P = np.array([[1.25, -2.5, 0.3], [1.3, -2.5, 0.3], [1.35, -2.5, 0.31]])
TURNED = Rotation.random(3, rng=0)
HEADER = "t,x,y,z,qx,qy,qz,qw"


def table(*columns: object, separator: str = ",") -> str:
    rows = np.column_stack([np.asarray(column) for column in columns])
    return "".join(separator.join(repr(float(v)) for v in row) + "\n" for row in rows)


def test_reads_plain_csv(read: Read) -> None:
    capture = read("t,x,y,z\n" + table(T, P))
    assert capture.format == "plain CSV"
    assert capture.rate_hz is None
    body = capture.bodies["body"]
    np.testing.assert_array_equal(body.times, T)
    np.testing.assert_array_equal(body.positions, P)
    assert body.rotations is None


def test_reads_orientations_with_reordered_and_unknown_columns(read: Read) -> None:
    names = ["note"] * 3
    rows = [
        f"{name};{q[3]};{z};{y};{x};{t};{q[0]};{q[1]};{q[2]}".replace(".", ",")
        for name, t, (x, y, z), q in zip(names, T, P, TURNED.as_quat(), strict=True)
    ]
    body = read("\n".join(["remark;qw;z;Y;x;Time;qx;qy;qz", *rows])).bodies["body"]
    np.testing.assert_allclose(body.positions, P)
    np.testing.assert_allclose(body.rotations, TURNED.as_matrix(), atol=1e-12)


@pytest.mark.parametrize("point", [".", ","])
def test_tabs_separate_cells_as_well(read: Read, point: str) -> None:
    text = "t\tx\ty\tz\n" + table(T, P, separator="\t").replace(".", point)
    body = read(text).bodies["body"]
    np.testing.assert_array_equal(body.times, T)
    np.testing.assert_array_equal(body.positions, P)


@pytest.mark.parametrize("header", ["t_ms,x_mm,y_mm,z_mm", "t [ms],X (mm),y [mm],z[mm]"])
def test_reads_units_stated_in_the_header(read: Read, header: str) -> None:
    capture = read(header + "\n" + table(1000 * T, 1000 * P))
    np.testing.assert_allclose(capture.bodies["body"].times, T)
    np.testing.assert_allclose(capture.bodies["body"].positions, P)
    assert "positions are in millimetres" in capture.notes


def test_millimetres_without_a_unit_are_noted(read: Read) -> None:
    noted = read("t,x,y,z\n" + table(T, 1000 * P)).notes
    assert (
        "a body is 2500 m from the origin, too far for a room: the file seems to use a smaller "
        "unit; name it in the header, as in x_mm,y_mm,z_mm"
    ) in noted
    for header, scale in (("t,x,y,z", 1), ("t,x_mm,y_mm,z_mm", 1000), ("t,x_m,y_m,z_m", 1000)):
        notes = read(f"{header}\n" + table(T, scale * P)).notes
        assert not any("too far for a room" in note for note in notes)


def test_name_column_separates_bodies(read: Read) -> None:
    capture = read("t,body,x,y,z\n0,a,1,2,3\n0,b b,4,5,6\n1,a,,,\n1,b b,4,5,7\n")
    assert list(capture.bodies) == ["a", "b b"]
    assert capture.bodies["a"].seen.tolist() == [True, False]
    np.testing.assert_array_equal(capture.bodies["b b"].positions, [[4, 5, 6], [4, 5, 7]])


@pytest.mark.parametrize("quote", ["", '"'])
def test_decimal_commas_are_read_beside_quotation_marks(read: Read, quote: str) -> None:
    rows = [f"{quote}cart, red{quote};{t};1,5;{quote}2,25{quote};3" for t in ("0,1", "0,2")]
    bodies = read("\n".join(["body;t;x;y;z", *rows])).bodies
    assert list(bodies) == ["cart, red"]
    np.testing.assert_array_equal(bodies["cart, red"].times, [0.1, 0.2])
    np.testing.assert_array_equal(bodies["cart, red"].positions, [[1.5, 2.25, 3.0]] * 2)


def test_reads_tum(read: Read) -> None:
    content = "# ground truth\n# timestamp tx ty tz qx qy qz qw\n\n"
    capture = read(content + table(T, P, TURNED.as_quat(), separator=" ") + "\n# end\n")
    assert capture.format == "TUM trajectory"
    body = capture.bodies["body"]
    np.testing.assert_array_equal(body.times, T)
    np.testing.assert_array_equal(body.positions, P)
    np.testing.assert_allclose(body.rotations, TURNED.as_matrix(), atol=1e-12)


@pytest.mark.parametrize(("unit", "scale"), [("milli", 1e3), ("micro", 1e6), ("nano", 1e9)])
@pytest.mark.parametrize("separator", [" ", ","])
def test_times_since_1970_in_smaller_units_are_read(
    read: Read, unit: str, scale: float, separator: str
) -> None:
    # As ORB-SLAM writes its trajectories for EuRoC.
    times = 1403636579.763 + 0.005 * np.arange(40)
    header = "" if separator == " " else HEADER + "\n"
    places = np.arange(120.0).reshape(40, 3)
    turns = np.tile([0.0, 0.0, 0.0, 1.0], (40, 1))
    capture = read(header + table(times * scale, places, turns, separator=separator))
    np.testing.assert_allclose(capture.bodies["body"].times, times, rtol=0, atol=1e-6)
    assert f"times are in {unit}seconds since 1970" in capture.notes


@pytest.mark.parametrize("scale", [1e4, 1e6, 1e9])
@pytest.mark.parametrize("count", [10, 40])
def test_times_in_another_unit_from_another_moment_are_refused(
    read: Read, scale: float, count: int
) -> None:
    rows = table(scale * 0.01 * np.arange(count), np.zeros((count, 3)))
    with pytest.raises(TruthError, match="s apart, so they seem to be in a smaller unit"):
        read("t,x,y,z\n" + rows)
    assert len(read("t_ms,x,y,z\n" + rows).bodies["body"].times) == count


@pytest.mark.parametrize(("count", "step_s"), [(2, 10), (40, 10), (2, 150), (9, 150)])
def test_samples_far_apart_are_read_with_a_note(read: Read, count: int, step_s: float) -> None:
    rows = table(step_s * np.arange(count), np.zeros((count, 3)))
    capture = read("t,x,y,z\n" + rows)
    assert len(capture.bodies["body"].times) == count
    note = (
        f"samples are {step_s} s apart: if their times are not in seconds, give them as CSV with a "
        "header that names their unit, as in t_ms"
    )
    assert note in capture.notes
    assert note not in read("t_s,x,y,z\n" + rows).notes


def test_rare_samples_of_a_body_do_not_count_as_another_unit(read: Read) -> None:
    steady = [f"{0.01 * n:.2f},a,0,0,0" for n in range(3000)]
    rare = [f"{3 * n},b,0,0,0" for n in range(10)]
    rows = sorted([*steady, *rare], key=lambda row: float(row.split(",")[0]))
    assert len(read("\n".join(["t,body,x,y,z", *rows])).bodies["b"].times) == 10


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-be"])
def test_utf_16_is_read(read: Read, encoding: str) -> None:
    mark = "\ufeff" if encoding == "utf-16-be" else ""
    capture = read((mark + "t,x,y,z\r\n" + table(T, P)).encode(encoding))
    np.testing.assert_array_equal(capture.bodies["body"].positions, P)
    assert not any("Windows" in note for note in capture.notes)


def test_gap_in_tum_is_nan(read: Read) -> None:
    body = read("0 1 2 3 0 0 0 1\n1 nan nan nan 0 0 0 1\n").bodies["body"]
    assert body.seen.tolist() == [True, False]
    assert body.rotations is not None
    assert np.isnan(body.rotations[1]).all()


def test_given_rate_is_ignored(read: Read) -> None:
    capture = read("t,x,y,z\n" + table(T, P), rate_hz=100)
    assert capture.rate_hz is None
    assert any("the given rate of 100 Hz is ignored" in note for note in capture.notes)


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        ("t,x,y,z\n1,1,2,3\n0,1,2,3\n", "upload line 3: the time is earlier than the previous one"),
        ("t,x,y,z\n0,1,2,3\n,1,2,3\n", "upload line 3: the time must be given"),
        ("t,x,y,z\n0,1,2\n", "upload line 2: the row has only 3 cells, but there must be 4: t, x"),
        ("t,x,y,z\n0,1,2,3,4\n", "upload line 2: the row has 5 cells, but the header has 4"),
        ("t,x,y,z\n0,1,two,3\n", "upload line 2 cell 3: y must be a number, not 'two'"),
        ("t,x,y,z\n0,1,,3\n", "upload line 2: x, y and z must all be given, or none"),
        ("t,x,y,z\n0,1,1e99,3\n", "upload line 2: x, y and z must be within"),
        ("t,x,y,z\n", "upload: it contains no data rows"),
        ("t,x,y,z,qx\n0,1,2,3,0\n", "upload line 1: qx is given, but not all of qx, qy, qz, qw"),
        ("t,x,y,z,x\n0,1,2,3,0\n", "upload line 1 cell 5: x appears twice"),
        ("t,x_mm,y,z\n0,1,2,3\n", "upload line 1: x, y and z must be in the same unit"),
        ("t,x [ft],y [ft],z [ft]\n0,1,2,3\n", "upload line 1 cell 2: the unit 'ft' of x must be"),
        (f"{HEADER}\n0,1,2,3,0,0,0,2\n", "upload line 2: qx, qy, qz, qw must be a unit quat"),
        ("0 1 2 3 0 0 0 1\n1 2 3\n", "upload line 2: the row has only 3 cells"),
        ("# c\n0 1 2 3 0 0 0 1\n1 1 2 3 0 0 0 w\n", "upload line 3 cell 8: qw must be a number"),
        ("1 1 2 3 0 0 0 1\n0 1 2 3 0 0 0 1\n", "upload line 2: the time is earlier than"),
    ],
)  # fmt: skip
def test_refusal_names_the_line_and_cell(read: Read, content: str, expected: str) -> None:
    with pytest.raises(TruthError) as caught:
        read(content)
    assert expected in str(caught.value)


def test_samples_with_repeated_times_are_ignored_and_reported(read: Read) -> None:
    capture = read("0 1 2 3 0 0 0 1\n0 9 9 9 0 0 0 1\n1 4 5 6 0 0 0 1\n1 4 5 6 0 0 0 1\n")
    body = capture.bodies["body"]
    assert body.times.tolist() == [0.0, 1.0]
    assert body.positions.tolist() == [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]
    assert "2 samples with a repeated time are ignored" in capture.notes


def test_samples_written_twice_with_rounded_times_are_one(read: Read) -> None:
    rows = [f"{k / 100 + late:.7f} {k} 2 3 0 0 0 1" for k in range(50) for late in (0.0, 1e-7)]
    capture = read("\n".join(rows))
    body = capture.bodies["body"]
    assert body.positions[:, 0].tolist() == list(range(50))
    assert "50 samples with a repeated time are ignored" in capture.notes
    # No gap between them.
    halfway = between(body.times, body.positions, body.times[:-1] + 0.005)
    assert np.allclose(halfway[:, 0], np.arange(49) + 0.5)


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r\r\n"])
def test_empty_lines_are_skipped(read: Read, end: str) -> None:
    rows = [f"{t},1,2,3" for t in range(6)]
    body = read(end.join(["t,x,y,z", *rows[:3], "", " ,,,", *rows[3:], ""])).bodies["body"]
    assert body.times.tolist() == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]


def test_each_body_has_its_own_times(read: Read) -> None:
    capture = read("t,body,x,y,z\n0,a,1,2,3\n0,b,4,5,6\n0,b,7,8,9\n1,a,1,2,3\n")
    assert capture.bodies["a"].times.tolist() == [0.0, 1.0]
    assert capture.bodies["b"].positions.tolist() == [[4.0, 5.0, 6.0]]
    assert "1 sample with a repeated time is ignored" in capture.notes


def test_time_going_back_after_a_repeated_one_is_refused(read: Read) -> None:
    with pytest.raises(
        TruthError, match="upload line 4: the time is earlier than the previous one of body"
    ):
        read("t,x,y,z\n1,1,2,3\n1,1,2,3\n0.5,1,2,3\n")


@pytest.mark.parametrize("title", ["#timestamp", "#timestamp [ns]"])
def test_reads_euroc_ground_truth(read: Read, title: str) -> None:
    names = "p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z []"
    turn = TURNED.as_quat()
    rows = [
        f"{round(t * 1e4)}00000," + ",".join(map(repr, map(float, (*p, q[3], *q[:3], 0.5))))
        for t, p, q in zip(T, P, turn, strict=True)
    ]
    text = f"{title}, {names}, v_RS_R_x [m s^-1]\n" + "\n".join(rows)
    body = read(text).bodies["body"]
    np.testing.assert_allclose(body.times, T, atol=1e-6)
    np.testing.assert_array_equal(body.positions, P)
    assert body.rotations is not None
    np.testing.assert_allclose(body.rotations, TURNED.as_matrix(), atol=1e-12)


def test_reads_euroc_positions_with_full_time_precision(read: Read) -> None:
    first, step = 1403636579763555584, 5_000_064
    rows = "".join(f"{first + k * step},{k},2,3\n" for k in range(50))
    header = "#timestamp [ns], p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m]"
    capture = read(f"{header}\n{rows}{first + 49 * step},49,2,3\n")
    assert capture.format == "EuRoC ground truth"
    body = capture.bodies["body"]
    assert body.rotations is None
    np.testing.assert_allclose(np.diff(body.times), step * 1e-9, atol=5e-7)
    assert abs(int(body.times[0] * 1e6) - first // 1000) <= 1
    assert "1 sample with a repeated time is ignored" in capture.notes
    with pytest.raises(TruthError, match="upload line 3: the time is earlier"):
        read(f"{header}\n{first},1,2,3\n{first - step},1,2,3\n")
