"""Texts that name no source are refused in one sentence."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from observer.errors import DynamicObserverError
from observer.opening import open_source


@pytest.mark.parametrize(
    "spec",
    ["a" * 1000, "simulated:" + "a" * 1000, "/" + "a" * 1000 + ".mcap", "video:" + "a" * 1000],
)
def test_a_name_that_is_too_long_is_refused(spec: str) -> None:
    with pytest.raises(DynamicObserverError) as refused:
        open_source(spec)
    assert len(str(refused.value)) < 2000


@given(st.sampled_from(["", "simulated:", "video:", "coppeliasim:"]), st.text(max_size=40))
def test_whatever_names_no_source_is_refused(kind: str, name: str) -> None:
    with pytest.raises(DynamicObserverError):
        open_source(f"{kind}/no/such/place/{name}")
