"""Motion-capture formats are declared once, and every list of them is complete."""

from __future__ import annotations

import re
from typing import get_args

import pytest

from observer.truth.files.known import FORMATS, CaptureKind, formats_in_words, names_in_words
from tools import ROOT


def test_every_reader_has_a_format() -> None:
    assert {each.kind for each in FORMATS} == set(get_args(CaptureKind))


@pytest.mark.parametrize(
    ("place", "paragraph"),
    [
        (
            "docs/pages/motion-capture.md",
            r"Files of these systems and formats are read:.*?The format is detected",
        ),
        ("static/app/runs/truth-picker.js", r'"[^"\n]*the format is detected automatically\."'),
    ],
)
def test_every_user_facing_list_names_every_format(place: str, paragraph: str) -> None:
    found = re.search(paragraph, (ROOT / place).read_text(), re.DOTALL)
    assert found is not None
    words = " ".join(found[0].split())
    assert [each.name for each in FORMATS if each.name not in words] == []


def test_names_and_formats_in_words() -> None:
    assert names_in_words().endswith("EuRoC, TUM or plain CSV")
    assert "Nexus (CSV of Trajectories)" in formats_in_words()
