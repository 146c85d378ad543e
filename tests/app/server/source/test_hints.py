"""Sentences that list what can be opened name every kind that there is."""

from __future__ import annotations

from pathlib import Path

import pytest

from app.server.errors import FieldError
from app.server.source.hints import source_entries
from app.server.source.opening import check_spec
from observer.errors import SourceError
from observer.opening import open_source

KINDS = ("simulated:", "camera:", "rtsp:", "video:", "coppeliasim:")


def test_every_kind_can_be_chosen_and_is_named_in_every_hint() -> None:
    specs = [entry.spec for entry in source_entries()]
    with pytest.raises(FieldError) as refused:
        check_spec("")
    page = Path(__file__).resolve().parents[4] / "static" / "app" / "sources" / "source-picker.js"
    for kind in KINDS:
        assert any(spec.startswith(kind) for spec in specs), kind
        assert kind in str(refused.value), kind
        assert kind in page.read_text(), kind
    with pytest.raises(SourceError) as unknown:
        open_source("nonsense:1")
    assert "coppeliasim:HOST:PORT" in str(unknown.value)
