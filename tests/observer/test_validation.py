"""Pydantic's validation errors in plain words."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import pytest
from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator

from observer.validation import validation_words, with_name


class Asked(BaseModel):
    model_config = ConfigDict(extra="forbid")

    name: Annotated[str, Field(min_length=1, max_length=5)] = "a"
    code: Annotated[str, Field(min_length=3, pattern=r"^[a-z]+$")] = "abc"
    count: Annotated[int, Field(ge=1, lt=10)] = 1
    speed: Annotated[float, Field(gt=0.1, le=2.5, allow_inf_nan=False)] = 1.0
    kind: Literal["fast", "slow"] = "fast"
    sure: bool = True
    rows: Annotated[list[int], Field(min_length=1, max_length=2)] = [1]
    must: int = 0

    @field_validator("must")
    @classmethod
    def _even(cls, value: int) -> int:
        if value % 2:
            raise ValueError("must be even")
        return value


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ({"name": ""}, "name must not be empty"),
        ({"name": "abcdef"}, "name must have at most 5 characters"),
        ({"name": 3}, "name must be text"),
        ({"code": "ab"}, "code must have at least 3 characters"),
        ({"code": "AB!"}, "code has characters that are not allowed here"),
        ({"count": 0}, "count must be at least 1"),
        ({"count": 10}, "count must be less than 10"),
        ({"count": "many"}, "count must be a whole number"),
        ({"speed": 0.1}, "speed must be greater than 0.1"),
        ({"speed": 2.6}, "speed must be at most 2.5"),
        ({"speed": float("nan")}, "speed must be a finite number"),
        ({"speed": "fast"}, "speed must be a number"),
        ({"kind": "odd"}, "kind must be 'fast' or 'slow'"),
        ({"sure": "perhaps"}, "sure must be true or false"),
        ({"rows": []}, "rows must not be empty"),
        ({"rows": [1, 2, 3]}, "rows must have at most 2 entries"),
        ({"rows": 1}, "rows must be a list"),
        ({"must": 3}, "must must be even"),
        ({"other": 1}, "other is not a known key"),
    ],
)
def test_an_error_states_the_valid_values(given: dict[str, Any], expected: str) -> None:
    with pytest.raises(ValidationError) as caught:
        Asked.model_validate(given)
    (error,) = caught.value.errors()
    assert with_name(str(error["loc"][0]), validation_words(error)) == expected


def test_a_missing_value_is_reported() -> None:
    class Needs(BaseModel):
        time: float

    with pytest.raises(ValidationError) as caught:
        Needs.model_validate({})
    assert validation_words(caught.value.errors()[0]) == "is missing"


def test_an_unknown_error_type_has_no_developer_wording() -> None:
    error = {"type": "date_type", "msg": "Input should be a valid date"}
    assert validation_words(error) == "must be a valid date"


def test_a_sentence_is_prefixed_with_the_name() -> None:
    assert with_name("speed", "no such file") == "speed: no such file"
    assert with_name("", "must be even") == "must be even"
