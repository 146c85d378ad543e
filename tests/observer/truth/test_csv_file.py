"""``truth.csv``: what is read, where it is unknown, what is refused."""

from __future__ import annotations

import csv
import math
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from observer.errors import TruthError
from observer.geometry import Pose
from observer.truth import csv_file
from observer.truth.contract import KINDS, Kind, TrueBody
from observer.truth.csv_file import CsvTruth, write_truth_csv
from observer.truth.files.recognition import file_kind
from observer.truth.sampled import TruthSample
from observer.types import BoxPx

HEADER = "frame,t,id,x,y,z,vx,vy,vz,visible,size_x,size_y,size_z,yaw"
ROW = "0,0.0,1,1,2,3,0.1,0,0.2,0.5,0.4,0.5,0.6,0.7"


BOXED = f"{HEADER},box_u0,box_v0,box_u1,box_v1"


def body(
    id_: int = 1,
    *,
    x: float = 0.0,
    yaw: float = 0.0,
    visible: float | None = 1,
    box_px: BoxPx | None = None,
    kind: Kind | None = None,
) -> TrueBody:
    return TrueBody(
        id=id_,
        name=f"robot {id_}, the 'red'",
        role="obstacle",
        position=np.array([x, 1 / 3, 3.0]),
        velocity=np.array([0.5, 0.0, -0.1]),
        size=np.array([0.4, 0.38, 0.24]),
        yaw=yaw,
        visible=visible,
        commanded_speed=0.5,
        box_px=box_px,
        kind=kind,
    )


def written(path: Path, *samples: TruthSample) -> CsvTruth:
    write_truth_csv(path / "truth.csv", samples)
    return CsvTruth(path / "truth.csv")


def assert_same(a: TrueBody, b: TrueBody) -> None:
    for name in ("id", "name", "role", "yaw", "visible", "commanded_speed", "box_px", "kind"):
        assert getattr(a, name) == getattr(b, name), name
    for name in ("position", "velocity", "size"):
        assert np.array_equal(getattr(a, name), getattr(b, name)), name


def test_round_trip_keeps_every_digit(tmp_path: Path) -> None:
    pose = Pose.from_rotvec([0.1, -0.2, 0.3], [1 / 3, 2, 3])
    boxed = body(1, x=0.1, box_px=(-0.5, 1 / 3, 100.1, 255.5), kind="person")
    truth = written(
        tmp_path,
        TruthSample(0, 0.1, (boxed, body(2, visible=None)), pose),
        TruthSample(1, 0.2, ()),
    )
    first, second = truth.bodies(0.1)
    assert_same(first, boxed)
    assert_same(second, body(2, visible=None))
    assert truth.bodies(0.2) == ()
    read = truth.camera_pose(0.1)
    assert read is not None
    assert np.array_equal(read.translation, pose.translation)
    assert np.allclose(read.rotation, pose.rotation, atol=1e-15)
    assert truth.camera_pose(0.2) is None
    assert [sample.frame for sample in truth.samples] == [0, 1]


finite = st.floats(-1e3, 1e3)


@given(
    numbers=st.lists(finite, min_size=10, max_size=10),
    name=st.text(max_size=20),
    box=st.none() | st.tuples(finite, finite, finite, finite),
    kind=st.sampled_from((None, *KINDS)),
)
@settings(max_examples=50)
def test_round_trip_of_any_numbers(
    numbers: list[float],
    name: str,
    box: BoxPx | None,
    kind: Kind | None,
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    # Cells are trimmed, and a file has no lone surrogates and one kind of line end.
    name = name.encode("utf-8", "ignore").decode().replace("\r", "").replace("\0", "").strip()
    if box is not None:
        (u0, u1), (v0, v1) = sorted(box[::2]), sorted(box[1::2])
        box = (u0, v0, u1, v1)
    made = TrueBody(
        id=7,
        name=name or "x",
        role="observer",
        position=np.array(numbers[:3]),
        velocity=np.array(numbers[3:6]),
        size=np.abs(numbers[6:9]),
        yaw=numbers[9],
        visible=None,
        commanded_speed=None,
        box_px=box,
        kind=kind,
    )
    truth = written(tmp_path_factory.mktemp("truth"), TruthSample(3, 0.0, (made,)))
    assert_same(truth.bodies(0.0)[0], made)


def test_values_between_frames_are_interpolated(tmp_path: Path) -> None:
    turned = Pose.from_rotvec([0, 0.4, 0], [2, 0, 0])
    truth = written(
        tmp_path,
        TruthSample(0, 0.0, (body(x=0.0, yaw=3.1, visible=0.2),), Pose.identity()),
        TruthSample(1, 0.1, (body(x=1.0, yaw=-3.1, visible=0.6),), turned),
    )
    (between,) = truth.bodies(0.025)
    assert between.position[0] == pytest.approx(0.25)
    assert between.visible == pytest.approx(0.3)
    # The short way round, across pi.
    assert math.remainder(between.yaw - 3.1, 2 * math.pi) == pytest.approx(
        0.25 * (2 * math.pi - 6.2)
    )
    pose = truth.camera_pose(0.025)
    assert pose is not None
    assert pose.rotvec == pytest.approx([0, 0.1, 0])
    assert pose.translation == pytest.approx([0.5, 0, 0])


def test_boxes_between_frames_are_interpolated_where_both_are_known(tmp_path: Path) -> None:
    truth = written(
        tmp_path,
        TruthSample(0, 0.0, (body(1, box_px=(0, 0, 10, 20), kind="robot"), body(2)), None),
        TruthSample(1, 0.1, (body(1, box_px=(4, 8, 14, 20)), body(2, box_px=(1, 2, 3, 4))), None),
    )
    first, second = truth.bodies(0.025)
    assert first.box_px == pytest.approx((1, 2, 11, 20))
    assert first.kind == "robot"
    assert second.box_px is None
    assert truth.bodies(0.1)[1].box_px == (1, 2, 3, 4)


def test_bodies_are_unknown_before_after_and_in_gaps(tmp_path: Path) -> None:
    times = [0.0, 0.1, 0.2, 0.3, 0.4, 0.9, 1.0, 1.1]
    samples = [TruthSample(k, t, (body(x=t),)) for k, t in enumerate(times)]
    samples[2] = TruthSample(2, 0.2, ())  # not seen in one frame
    truth = written(tmp_path, *samples)
    known = {
        t: len(truth.bodies(t))
        for t in (-0.06, -0.04, 0.05, 0.14, 0.2, 0.25001, 0.35, 0.44, 0.6, 0.86, 1.14, 1.16)
    }
    assert known == {
        -0.06: 0, -0.04: 1, 0.05: 1, 0.14: 1, 0.2: 0, 0.25001: 1, 0.35: 1, 0.44: 1, 0.6: 0,
        0.86: 1, 1.14: 1, 1.16: 0,
    }  # fmt: skip
    assert truth.bodies(0.14)[0].position[0] == 0.1


def test_samples_in_pairs_leave_no_gaps_between_the_pairs(tmp_path: Path) -> None:
    times = [k / 10 + late for k in range(10) for late in (0.0, 1e-7)]
    samples = [TruthSample(k, t, (body(x=t),)) for k, t in enumerate(times)]
    truth = written(tmp_path, *samples)
    for time in (0.05, 0.33, 0.1 + 5e-8, 0.94):
        (found,) = truth.bodies(time)
        assert found.position[0] == pytest.approx(min(time, times[-1]), abs=1e-6)
    assert truth.bodies(0.96) == ()


def test_reads_rows_in_any_order_and_ignores_extra_columns(tmp_path: Path) -> None:
    path = tmp_path / "truth.csv"
    path.write_text(
        f"weather,{HEADER}\nfog,1,0.1,1,2,2,3,0,0,0,,1,1,1,0\nsun,{ROW}\nsun,0,0.0,2,,,,,,,,,,,\n"
    )
    truth = CsvTruth(path)
    (first,) = truth.bodies(0.0)
    assert (first.position.tolist(), first.visible, first.role) == ([1, 2, 3], 0.5, "obstacle")
    assert truth.bodies(0.1)[0].visible is None


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "the header lacks the column frame"),
        (HEADER.replace("vz,", "") + "\n", "the header lacks the column vz"),
        (HEADER + ",camera_x\n" + ROW + ",1\n", "has camera_x but not all of"),
        (HEADER + "\n", "contains no rows"),
        (f"{HEADER}\n{ROW}\n1,0.1,1,1\n", "line 3: the row must have 14 cells"),
        (f"{HEADER}\n{ROW},5\n", "line 2: the row must have 14 cells"),
        (f"{HEADER}\n{ROW.replace('0.7', 'west')}\n", "line 2: yaw must be a number, not 'west'"),
        (f"{HEADER}\n{ROW.replace('0.7', 'nan')}\n", "line 2: yaw must be finite"),
        (f"{HEADER}\n{ROW.replace('0.7', '1_0')}\n", "line 2: yaw must be a number"),
        (f"{HEADER}\n{ROW.replace('0.7', '')}\n", "line 2: yaw must be a number, not ''"),
        (f"{HEADER}\n{ROW.replace('0.5,0.4', '1.5,0.4')}\n", "visible must be between 0 and 1"),
        (f"{HEADER}\n{ROW.replace('0.6', '-0.6')}\n", "must not be negative"),
        (f"{HEADER}\n{ROW.replace('0.0,1,', '0.0,1.5,')}\n", "id must be a whole number"),
        (f"{HEADER}\n-1{ROW[1:]}\n", "frame must be a whole number"),
        (f"{HEADER}\n{ROW}\n{ROW}\n", "line 3: id 1 appears twice in frame 0"),
        (f"{HEADER}\n{ROW}\n0,0.5,2{ROW[7:]}\n", "line 3: frame 0 has the time 0.5"),
        (f"{HEADER}\n{ROW}\n1,0.0,1{ROW[7:]}\n", "frame 1 has the time 0.0, which is not later"),
        (BOXED.replace(",box_v1", "") + f"\n{ROW},1,2,3\n", "has box_u0 but not all of box_u0,"),
        (f"{BOXED}\n{ROW},1,2,3,\n", "line 2: box_v1 must be a number, not ''"),
        (f"{BOXED}\n{ROW},1,2,3,wide\n", "line 2: box_v1 must be a number, not 'wide'"),
        (
            f"{HEADER}\n{ROW.replace('1,1,2', '1,1e9,2')}\n",
            "line 2: x must be at most 1e+08 m in magnitude, not 1e9",
        ),
        (
            f"{HEADER}\n{ROW.replace('0.1,', '-1001,')}\n",
            "line 2: vx must be at most 1000 m/s in magnitude, not -1001",
        ),
        (f"{HEADER}\n{ROW.replace('0,0.0', '0,2e11')}\n", "line 2: t must be at most 1e+11 s"),
        (f"{HEADER}\n{ROW.replace('0.6', '1e300')}\n", "line 2: size_z must be at most"),
        (f"{HEADER}\n{ROW.replace('0.7', '1e300')}\n", "line 2: yaw must be at most"),
        (f"{HEADER};kind\n{ROW}\n".replace(",", ";"), "must have 15 cells"),
        (f"{BOXED}\n{ROW},1,2,inf,4\n", "line 2: box_u1 must be finite"),
        (f"{BOXED}\n{ROW},5,2,3,4\n", "must not exceed box_u1 and box_v1, but the box is 5 2 3 4"),
        (f"{HEADER},kind\n{ROW},ghost\n", "kind must be robot or person, not 'ghost'"),
        (f"{HEADER},role\n{ROW},ghost\n", "role must be obstacle or observer"),
        (f'{HEADER}\n{ROW[:-3]}"0.7"x\n', "line 2: the line is not valid CSV"),
        (
            f"{HEADER},camera_x,camera_y,camera_z,camera_qw,camera_qx,camera_qy,camera_qz\n"
            f"{ROW},0,0,0,2,0,0,0\n",
            "must be a unit quaternion, but its length is 2",
        ),
    ],
)
def test_refuses(text: str, expected: str, tmp_path: Path) -> None:
    path = tmp_path / "truth.csv"
    path.write_text(text)
    with pytest.raises(TruthError) as caught:
        CsvTruth(path)
    assert expected in str(caught.value)
    assert str(caught.value).startswith("truth.csv")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("point", [".", ","])
def test_semicolons_separate_cells_as_well(point: str, tmp_path: Path) -> None:
    samples = [TruthSample(k, k / 10, (body(1, x=k / 7), body(2, kind="person"))) for k in range(3)]
    write_truth_csv(tmp_path / "truth.csv", samples)
    saved = tmp_path / "saved.csv"
    with (tmp_path / "truth.csv").open(newline="") as file, saved.open("w", newline="") as again:
        writer = csv.writer(again, delimiter=";")
        for number, row in enumerate(csv.reader(file)):
            names = csv_file._COLUMNS.index("name"), csv_file._COLUMNS.index("role")
            writer.writerow(
                cell if number == 0 or index in names else cell.replace(".", point)
                for index, cell in enumerate(row)
            )
    assert file_kind(saved) == "truth.csv"
    for sample, read in zip(samples, CsvTruth(saved).samples, strict=True):
        for a, b in zip(sample.bodies, read.bodies, strict=True):
            assert_same(a, b)


@pytest.mark.parametrize("quote", ['"', "'", " "])
def test_the_format_is_recognised_with_quoted_titles(quote: str, tmp_path: Path) -> None:
    path = tmp_path / "truth.csv"
    titles = [f"{quote}{title}{quote}" for title in HEADER.split(",")]
    path.write_text(f"{','.join(titles)}\n{ROW}\n")
    assert file_kind(path) == "truth.csv"


def test_too_many_rows_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(csv_file, "MOST_ROWS", 3)
    path = tmp_path / "truth.csv"
    rows = [f"{k},{k / 10},1{ROW[7:]}" for k in range(4)]
    path.write_text("\n".join([HEADER, *rows[:-1]]))
    assert len(CsvTruth(path).samples) == 3
    path.write_text("\n".join([HEADER, *rows]))
    with pytest.raises(TruthError, match=r"^truth\.csv line 5: there are more than 3 rows"):
        CsvTruth(path)


def test_more_ids_than_bodies_can_be_are_refused_in_little_memory(tmp_path: Path) -> None:
    rows = [f"{k},{k / 10},{k}{ROW[7:]}" for k in range(2001)]
    path = tmp_path / "truth.csv"
    path.write_text("\n".join([HEADER, *rows[:-1]]))
    tracemalloc.start()
    truth = CsvTruth(path)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert [each.id for each in truth.bodies(150.0)] == [1500]
    # A list of all frames for each id would take 32 MB alone.
    assert peak < 16e6
    path.write_text("\n".join([HEADER, *rows]))
    with pytest.raises(TruthError, match=r"^truth\.csv line 2002: there are more than 2000 ids"):
        CsvTruth(path)


cells = st.one_of(finite.map(repr), st.text("0123456789.-+eE,\"'\n \x00naif", max_size=6))


@given(rows=st.lists(st.lists(cells, min_size=12, max_size=16), max_size=4))
@settings(max_examples=200)
def test_any_rows_are_read_or_refused(
    rows: list[list[str]], tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.getbasetemp() / "any_truth.csv"
    path.write_text("\n".join([HEADER, *(",".join(row) for row in rows)]), encoding="utf-8")
    refusal = ""
    try:
        truth = CsvTruth(path)
    except TruthError as error:
        refusal = str(error)
    else:
        assert all(np.isfinite(b.position).all() for s in truth.samples for b in s.bodies)
    assert "\n" not in refusal


def test_refuses_unreadable_files_and_unwritable_paths(tmp_path: Path) -> None:
    with pytest.raises(TruthError, match="cannot be read"):
        CsvTruth(tmp_path / "absent.csv")
    (tmp_path / "binary.csv").write_bytes(b"\xff\xfe\xff")
    with pytest.raises(TruthError, match="must be UTF-8"):
        CsvTruth(tmp_path / "binary.csv")
    with pytest.raises(TruthError, match="cannot be written"):
        write_truth_csv(tmp_path / "absent" / "truth.csv", [])
