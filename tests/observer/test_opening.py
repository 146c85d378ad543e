"""Texts that do not name a source are refused in one sentence."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from observer.errors import DynamicObserverError
from observer.opening import open_source, source_kind


@pytest.mark.parametrize(
    "spec",
    ["a" * 1000, "simulated:" + "a" * 1000, "/" + "a" * 1000 + ".mcap", "video:" + "a" * 1000],
)
def test_too_long_a_name_is_refused(spec: str) -> None:
    with pytest.raises(DynamicObserverError) as refused:
        open_source(spec)
    assert len(str(refused.value)) < 2000


@given(st.sampled_from(["", "simulated:", "video:", "coppeliasim:"]), st.text(max_size=40))
def test_an_unknown_source_is_refused(kind: str, name: str) -> None:
    with pytest.raises(DynamicObserverError):
        open_source(f"{kind}/no/such/place/{name}")


@pytest.mark.parametrize(
    ("spec", "kind"),
    [
        ("simulated:lab", "simulated"),
        ("SIMULATED:lab?seed=1", "simulated"),
        ("camera:0,1", "camera"),
        ("rtsp://a/1,rtsp://b/2", "network"),
        ("sbs:http://a/1", "network"),
        ("video:a.mp4", "video"),
        ("coppeliasim:h:1", "coppeliasim"),
        ("/runs/a/recording.MCAP", "recording"),
        ("/data/KITTI", "folder"),
        ("folder:x", None),
        ("nonsense:1", None),
    ],
)
def test_the_kind_of_a_source_is_known_without_opening_it(spec: str, kind: str | None) -> None:
    assert source_kind(spec) == kind
