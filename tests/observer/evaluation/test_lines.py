"""Lines of observations: read from files, checked, and refused by line and field."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from observer.errors import InputError
from observer.evaluation.evaluate import summarise
from observer.evaluation.lines import checked_lines, read_both
from observer.evaluation.tally import tally

from .hand_made import RIGHT, StraightTruth, evaluate, perfect


def test_lines_are_read_back_from_a_file(tmp_path: Path) -> None:
    truth = StraightTruth(RIGHT)
    path = tmp_path / "tracks.jsonl"
    lines = perfect(truth, 20)
    path.write_text("\n".join(json.dumps(each) for each in lines) + "\n\n")
    assert summarise([tally(read_both(path)[0], truth)]) == evaluate(lines, truth)


def test_refusal_names_the_line_number_in_the_file(tmp_path: Path) -> None:
    first, second = perfect(StraightTruth(RIGHT), 2)
    path = tmp_path / "tracks.jsonl"
    path.write_text(f"{json.dumps(second)}\n\n\n{json.dumps(first)}\n")
    with pytest.raises(InputError, match="line 4 has the time"):
        read_both(path)


def test_file_is_read_with_all_extra_fields(tmp_path: Path) -> None:
    lines = [{**each, "more": k} for k, each in enumerate(perfect(StraightTruth(RIGHT), 3))]
    path = tmp_path / "tracks.jsonl"
    path.write_text("".join(f"{json.dumps(each)}\n" for each in lines))
    checked, plain = read_both(path)
    assert checked == checked_lines(lines)
    assert [each["more"] for each in plain] == [0, 1, 2]


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "tracks.jsonl contains no lines"),
        ("{}\n", "line 1, frame is missing"),
        ("nonsense\n", "tracks.jsonl line 1 is not valid JSON"),
        ("[1]\n", "line 1, the line"),
        ('{"frame": 0}\n', "line 1, time is missing"),
        ("[" * 100_000, "not valid JSON"),
    ],
)
def test_bad_file_is_refused_naming_the_line(tmp_path: Path, text: str, sentence: str) -> None:
    path = tmp_path / "tracks.jsonl"
    path.write_text(text)
    with pytest.raises(InputError, match=sentence):
        read_both(path)


def test_missing_and_non_utf8_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"none\.jsonl cannot be read"):
        read_both(tmp_path / "none.jsonl")
    binary = tmp_path / "b.jsonl"
    binary.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="UTF-8"):
        read_both(binary)


@pytest.mark.parametrize(
    ("field", "value"),
    [("speed", -1.0), ("speed", float("nan")), ("position", [0, 1]), ("velocity_cov", [[1]])],
)
def test_bad_field_is_named(field: str, value: Any) -> None:
    truth = StraightTruth(RIGHT)
    lines = perfect(truth, 3)
    lines[1]["obstacles"][0][field] = value
    with pytest.raises(InputError, match=rf"line 2, obstacles\.0\.{field}"):
        evaluate(lines, truth)


def test_lines_out_of_order_are_refused_within_a_segment() -> None:
    truth = StraightTruth(RIGHT)
    lines = perfect(truth, 3)
    with pytest.raises(InputError, match=r"line 2 has the time 0\.1 s"):
        evaluate([lines[2], lines[1]], truth)
    lines[1]["segment"] = 1
    # Neither begins with frame 0, and the truth has no camera pose to locate them with.
    assert evaluate([lines[2], lines[1]], truth).frames_without_world == 2
