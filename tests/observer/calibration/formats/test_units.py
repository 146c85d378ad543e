"""Units of length: what users type, and which units a refusal suggests."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from observer.calibration.formats.recognition import named_file, read_any
from observer.calibration.formats.units import (
    UnitUnclear,
    implausible,
    metres,
    parse_unit,
    unit_words,
)
from observer.errors import CalibrationError


@pytest.mark.parametrize(
    ("said", "length", "words"),
    [
        ("m", 1.0, "metres"),
        (" cm ", 0.01, "centimetres"),
        ("mm", 0.001, "millimetres"),
        ("in", 0.0254, "inches"),
        ("25mm", 0.025, "units of 25 mm"),
        ("22.5 mm", 0.0225, "units of 22.5 mm"),
        ("1in", 0.0254, "units of 25.4 mm"),
    ],
)
def test_common_unit_spellings_are_parsed(said: str, length: float, words: str) -> None:
    unit = parse_unit(said)
    assert metres(unit) == pytest.approx(length)
    assert unit_words(unit) == words


@pytest.mark.parametrize(
    "said", ["", "25", "mm25", "km", "0mm", "-25mm", "1e3mm", "nan mm", "0.mm"]
)
def test_invalid_unit_is_refused(said: str) -> None:
    with pytest.raises(CalibrationError, match="is not known; use m, cm, mm or in, or the"):
        parse_unit(said)


@given(st.text(max_size=20) | st.from_regex(r"\d{0,30}\.?\d{0,30} ?(m|mm|cm|in)", fullmatch=True))
def test_any_text_is_parsed_as_a_length_or_refused(said: str) -> None:
    try:
        unit = parse_unit(said)
    except CalibrationError:
        return
    assert metres(unit) > 0


@pytest.mark.parametrize(
    ("baseline", "expected"),
    [
        (71.9, "if the file is in millimetres (71.9 mm), say --unit mm; if in centimetres (719 mm),"
               " say --unit cm"),
        (1500.0, "if the file is in millimetres (1.5 m), say --unit mm"),
        (3.0, "say --unit cm; if in squares of a board of 25 mm, say --unit 25mm"),
        (9000.0, "no unit of length gives a plausible baseline; if the file is in squares of a "
                 "board of 25 mm, say --unit 25mm"),
    ],
)  # fmt: skip
def test_refusal_suggests_plausible_units(baseline: float, expected: str) -> None:
    problem = implausible(baseline, "m")
    assert problem.startswith(
        f"T gives a baseline of {baseline:g} m when read in metres, which is out"
    )
    asked = UnitUnclear(problem, baseline, "m").asking("say --unit {}")
    assert str(asked).startswith(f"{problem}; ")
    assert str(asked).endswith(expected)


def test_each_caller_names_its_own_control() -> None:
    unclear = UnitUnclear("too wide", 120.0, "m")
    assert "(120 mm), set unit='mm'; if in c" in str(unclear)
    assert "(120 mm), set unit to mm; if in c" in str(unclear.asking("set unit to {}"))
    assert "unit=" not in str(unclear.asking("set unit to {}"))


def test_third_party_pair_in_millimetres_needs_an_explicit_unit(shared_data: Path) -> None:
    folder = shared_data / "wild" / "calibrations" / "opencv_millimetres"
    files = [named_file(folder / f"{name}.yml") for name in ("intrinsics", "extrinsics")]
    refused = "T gives a baseline of 60.7472 m when read in metres, which is outside"
    with pytest.raises(CalibrationError, match=re.escape(refused)) as caught:
        read_any(files, size=(1280, 960))
    assert isinstance(caught.value, UnitUnclear)
    assert "millimetres (60.7 mm), set unit='mm'" in str(caught.value)
    made = read_any(files, size=(1280, 960), unit="mm").calibration
    assert made.baseline == pytest.approx(0.0607, abs=1e-4)
    assert made.K1[0, 0] == pytest.approx(832.9, abs=0.1)
