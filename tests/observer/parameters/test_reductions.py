"""Reduced processing leaves out what its description says, and nothing else."""

from __future__ import annotations

from itertools import pairwise

import pytest

from observer.navigation.parameters import AllParameters
from observer.parameters import Parameters
from observer.parameters.reductions import REDUCTIONS, Reduction, reduced, reductions


@pytest.mark.parametrize("reduction", REDUCTIONS)
def test_only_the_depth_rate_and_the_spacing_change(reduction: Reduction) -> None:
    full = AllParameters()
    changed = full.difference(reduced(full, reduction))
    assert changed.pop("klt_tracking.spacing_px") == reduction.spacing_px
    assert f"points every {reduction.spacing_px} px" in reduction.words
    if reduction.dense_rate_hz is not None:
        assert changed.pop("dense.rate_hz") == reduction.dense_rate_hz
        assert f"dense depth at {reduction.dense_rate_hz:g} Hz" in reduction.words
    assert not changed


def test_settings_already_below_the_reduction_are_unchanged() -> None:
    sparse = Parameters().changed({"dense.rate_hz": 0.0, "klt_tracking.spacing_px": 64})
    for reduction in REDUCTIONS:
        assert reduced(sparse, reduction) == sparse


def test_nothing_is_reduced_without_a_reduction() -> None:
    assert reduced(Parameters(), None) == Parameters()


def test_each_step_takes_less_time_than_the_one_before() -> None:
    shares = [1.0, *(step.time_share for step in REDUCTIONS)]
    assert all(later < earlier for earlier, later in pairwise(shares))
    assert reductions("rigid") == REDUCTIONS
    assert reductions("affine") == reductions("homography") == reductions("monocular") == ()
