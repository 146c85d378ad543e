"""Tests of numbers in texts for people."""

from __future__ import annotations

import pytest

from observer.number_format import format_number


@pytest.mark.parametrize(
    ("value", "digits", "signed", "shown"),
    [
        (-0.126, 2, False, "−0.13"),
        (0.126, 2, False, "0.13"),
        (0.126, 2, True, "+0.13"),
        (-3.2, 0, True, "−3"),
        (-0.004, 2, False, "0.00"),
        (-0.004, 2, True, "+0.00"),
    ],
)
def test_a_minus_is_a_true_one_and_a_rounded_zero_has_none(
    value: float, digits: int, signed: bool, shown: str
) -> None:
    assert format_number(value, digits, signed=signed) == shown
