"""How a parameter is declared: a number or a choice with its bounds, unit, label and help."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar

from pydantic import BaseModel, ConfigDict, Field

ParameterValue = float | int | bool | str

# Of the camera's own motion; by which of them a parameter is used is said where it is declared.
MODELS = ("rigid", "homography", "affine", "monocular")
# Those that follow points over time, and those that draw samples of matches.
KLT: tuple[str, ...] = ("rigid", "monocular")
SAMPLING: tuple[str, ...] = ("rigid", "homography", "affine")
PLANAR: tuple[str, ...] = ("homography", "affine")

# bool is no number here, and neither are NaN and the infinities.
Real = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Whole = Annotated[int, Field(strict=True)]
Flag = Annotated[bool, Field(strict=True)]


class Stage(BaseModel):
    """The parameters of one stage, frozen."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    # With which ego_motion.model the group acts.
    models: ClassVar[tuple[str, ...]] = MODELS


def number(
    default: float,
    *,
    ge: float,
    le: float,
    unit: str,
    title: str,
    help: str,
    step: float,
    models: tuple[str, ...] | None = None,
) -> Any:
    """A number; ``models`` where it acts with fewer models than its group."""
    extra: dict[str, Any] = {"unit": unit, "step": step}
    if models is not None:
        extra["models"] = list(models)
    return Field(
        default=default,
        ge=ge,
        le=le,
        title=title,
        description=help,
        json_schema_extra=extra,
    )


def choice(default: Any, *, title: str, help: str) -> Any:
    """One of several values, or a switch."""
    return Field(default=default, title=title, description=help, json_schema_extra={"unit": ""})
