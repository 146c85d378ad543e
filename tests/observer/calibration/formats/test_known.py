"""Formats are declared once, and every list of them is complete."""

from __future__ import annotations

import re
from typing import get_args

import pytest

from observer.calibration.formats.known import (
    FORMATS,
    FileKind,
    formats_in_words,
    tools,
    tools_in_words,
)
from tools import ROOT


def test_every_file_kind_is_declared_once() -> None:
    assert set(FORMATS) == set(get_args(FileKind))
    assert len(tools()) == len(set(tools()))


@pytest.mark.parametrize(
    ("place", "paragraph"),
    [
        ("docs/pages/calibration.md", r"## From other tools\n\n.*?\n\n"),
        (
            "static/app/calibration/calibration-panel.js",
            r'"[^"\n]*the format is detected automatically\.[^"\n]*"',
        ),
    ],
)
def test_every_user_facing_list_names_every_tool(place: str, paragraph: str) -> None:
    found = re.search(paragraph, (ROOT / place).read_text(), re.DOTALL)
    assert found is not None
    assert [tool for tool in tools() if tool not in found[0]] == []


def test_files_of_one_tool_are_listed_together() -> None:
    assert "ROS (camera_info of both cameras; ost.txt)" in formats_in_words()
    assert formats_in_words().count("KITTI") == 1
    assert tools_in_words().startswith("OpenCV, ROS, ")
