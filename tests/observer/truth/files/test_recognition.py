"""Files are recognised by their content, and no content causes a crash."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from observer.errors import TruthError
from observer.truth.csv_file import write_truth_csv
from observer.truth.files.recognition import file_kind, read_capture
from observer.truth.sampled import TruthSample

from .conftest import DEVICES, Read, nexus_csv, places, tracker_csv

TRACKER = tracker_csv({"robot": (np.full((20, 3), 0.1), places(20)),
                       "cart": (np.full((20, 3), 0.2), places(20, seed=1))})  # fmt: skip
MOTIVE = (
    "Format Version,1.23,Take Name,a walk,Export Frame Rate,100.0,Rotation Type,{turn},"
    "Length Units,Meters,Coordinate Space,Global\n\n"
    ",Type" + ",Rigid Body" * 7 + "\n,Name" + ",cup" * 7 + "\n,ID" + ",7" * 7 + "\n"
)
FILES = (
    TRACKER,
    DEVICES + nexus_csv({"a": places(20), "b": places(20)}),
    "t,x,y,z,qx,qy,qz,qw\n" + "".join(f"{k},1,2,3,0,0,0,1\n" for k in range(20)),
    "t,body,x_mm,y_mm,z_mm\n" + "".join(f"{k},b{k % 2},1,2,3\n" for k in range(20)),
    "# TUM\n" + "".join(f"{k} 1 2 3 0 0 0 1\n" for k in range(20)),
    MOTIVE.format(turn="Quaternion") + ",,Rotation,Rotation,Rotation,Rotation,Position,Position,"
    "Position\nFrame,Time (Seconds),X,Y,Z,W,X,Y,Z\n"
    + "".join(f"{k},{k / 100},0,0,0,1,1,2,3\n" for k in range(20)),
    MOTIVE.format(turn="ZYX") + ",,Rotation,Rotation,Rotation,Position,Position,Position\n"
    "Frame,Time (Seconds),X,Y,Z,X,Y,Z\n"
    + "".join(f"{k},{k / 100},10,20,30,1,2,3\n" for k in range(20)),
    "#timestamp [ns], p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], "
    "q_RS_z []\n"
    + "".join(f"{1403636579763555584 + k * 5000192},1,2,3,1,0,0,0\n" for k in range(20)),
)
KINDS = (
    "vicon csv", "vicon csv", "plain csv", "plain csv", "tum", "motive csv", "motive csv",
    "plain csv",
)  # fmt: skip
# Pieces that mean something to one of the readers.
PIECES = (
    "Objects", "Trajectories", "Segments", "Devices", "Model Outputs", "Frame", "Sub Frame", "RX",
    "RY", "RZ", "RW", "TX", "TY", "TZ", "X", "Y", "Z", "mm", "rad", "deg", "100", "0", "1", "2",
    "-3.5", "nan", "inf", "1e308", "1e999", "", " ", "t", "x", "y", "z", "qx", "qy", "qz", "qw",
    "Format Version", "Type", "Name", "ID", "Rigid Body", "Rotation", "Position", "Time", "W",
    "Rotation Type", "Quaternion", "XYZ", "Length Units", "Meters", "PathFileType", "#timestamp",
    "p_RS_R_x [m]", "q_RS_w []", "1403636579763555584", "body", ",", ";", "\n", "\r\n", "\"", "#",
    ":", "\x00", "\ufeff", "é", "x_mm", "[ft]",
)  # fmt: skip


@pytest.mark.parametrize(("content", "kind"), list(zip(FILES, KINDS, strict=True)))
def test_recognises_by_content(tmp_path: Path, content: str, kind: str) -> None:
    path = tmp_path / "misleading.c3d"
    path.write_text("\n \r\n" + content if kind != "tum" else content, encoding="utf-8")
    assert file_kind(path) == kind
    assert read_capture(path).bodies


def test_own_truth_csv_is_recognised(tmp_path: Path) -> None:
    path = tmp_path / "t,x,y,z.csv"
    write_truth_csv(path, [TruthSample(0, 0.0, ())])
    assert file_kind(path) == "truth.csv"
    with pytest.raises(TruthError, match="it needs no alignment"):
        read_capture(path)


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (b"", "upload: the file is empty; supported are Vicon Tracker (CSV of Obj"),
        (b" \r\n\r\n", "upload: the file is empty"),
        (b",,,\r\n" * 400, "upload: the file contains only empty lines"),
        (b"PK\x03\x04 xlsx", "upload: this is a ZIP archive or a spreadsheet; unpack it, or save"),
        ("x\n".encode("utf-16-le"), "upload: the file is neither text nor C3D; supported are"),
        (b"\x89PNG\0\0\0", "upload: the file is neither text nor C3D; supported are"),
        (b"Lorem ipsum\n", "not a known motion-capture format (it starts with 'Lorem ipsum'); sup"),
        (b"1 " * 12, "not a known motion-capture format (it starts with '1 1 1"),
        (b"x" * 3_000_000, "upload line 1: the line is longer than 1048576 characters"),
    ],
)
def test_refusal_states_what_the_file_is(read: Read, content: bytes, expected: str) -> None:
    with pytest.raises(TruthError) as caught:
        read(content)
    assert expected in str(caught.value)
    assert str(caught.value).count("\n") == 0


def test_unreadable_path_is_refused(tmp_path: Path) -> None:
    for path in (tmp_path / "absent.csv", tmp_path, Path("a\0b")):
        for read in (read_capture, file_kind):
            with pytest.raises(TruthError, match="cannot be read: "):
                read(path)


def captured_or_refused(path: Path, content: bytes) -> None:
    path.write_bytes(content)
    try:
        capture = read_capture(path, rate_hz=100)
    except TruthError as error:
        sentence = str(error)
    else:
        sentence = ""
    assert "\n" not in sentence
    assert len(sentence) < 600
    if sentence:
        return
    for name, body in capture.bodies.items():
        assert name == body.name.strip()
        assert len(body.times)


@settings(max_examples=200)
@given(st.data())
def test_modified_file_gives_a_truth_error_or_a_capture(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    content = data.draw(st.sampled_from(FILES)).encode()
    for _ in range(data.draw(st.integers(1, 4))):
        first, length = data.draw(st.integers(0, len(content))), data.draw(st.integers(0, 30))
        piece = data.draw(st.one_of(st.sampled_from(PIECES).map(str.encode), st.binary(max_size=6)))
        content = content[:first] + piece + content[first + length :]
    captured_or_refused(tmp_path_factory.getbasetemp() / "changed", content)


@settings(max_examples=200)
@given(
    st.one_of(
        st.tuples(st.sampled_from(["", ","]), st.lists(st.sampled_from(PIECES))).map(
            lambda drawn: drawn[0].join(drawn[1]).encode()
        ),
        st.binary(),
    )
)
def test_any_content_gives_a_truth_error_or_a_capture(
    tmp_path_factory: pytest.TempPathFactory, content: bytes
) -> None:
    captured_or_refused(tmp_path_factory.getbasetemp() / "any", content)


@pytest.mark.parametrize(
    "content",
    [
        "Trajectories\n100\n,," + "a,,," * 80_000 + "\nFrame,Sub Frame" + ",X,Y,Z" * 80_000
        + "\n,," + "mm,mm,mm," * 80_000 + "\n1,0\n",
        "Trajectories\n100\n" + "," * 1_000_000 + "\n" + "," * 1_000_000 + "\n",
        "t,x,y,z\n" + ",,,\n" * 200_000,
        "t,x,y,z,body\n" + "".join(f"{k},1,2,3,{k}\n" for k in range(5000)),
        MOTIVE.format(turn="Quaternion") + "," * 500_000 + "\nFrame,Time" + ",X" * 400_000 + "\n",
        "Format Version,1.23,Length Units,Meters\n,Type" + ",Rigid Body" * 90_000 + "\n,Name"
        + "".join(f",{k // 3}" for k in range(90_000)) + "\n," + ",Position" * 90_000
        + "\nFrame,Time" + ",X,Y,Z" * 30_000 + "\n0,0\n",
        "# comment\n" * 200_000,
    ],
)  # fmt: skip
def test_content_crafted_to_be_slow_is_refused_quickly(read: Read, content: str) -> None:
    begin = time.process_time()
    with pytest.raises(TruthError):
        read(content)
    assert time.process_time() - begin < 3
