"""``dynamic-observer programmes``."""

from __future__ import annotations

import json

import pytest

from app.cli import main
from observer.errors import InputError
from observer.motion_profiles.profile_file import profile_from_text


def test_programmes_are_listed_and_printed(capsys: pytest.CaptureFixture[str]) -> None:
    def said(*arguments: str) -> str:
        with pytest.raises(SystemExit) as left:
            main(["programmes", *arguments])
        assert not left.value.code
        return capsys.readouterr().out

    assert "figure17_a   (14 s, observer and obstacle)" in said()
    listed = {each["name"]: each for each in json.loads(said("--json"))}
    assert listed["rig_turn"]["roles"] == ["observer"]
    assert listed["rig_turn"]["duration_s"] == 19
    assert profile_from_text(said("figure17_b")).name == "figure17_b"
    with pytest.raises(SystemExit) as left:
        main(["programmes", "none"])
    assert left.value.code == 2
    with pytest.raises(InputError, match="no name"):
        profile_from_text("steps: {observer: [{seconds: 1}]}")
