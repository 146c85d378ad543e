"""How a parameter is declared: a number or a choice with its bounds, unit, label and help."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar

from pydantic import BaseModel, ConfigDict, Field

ParameterValue = float | int | bool | str

# Of ego_motion.model, which chooses the method.
MODELS = ("rigid", "homography", "affine", "monocular")
# Those that track points by KLT over time, and those that use both images.
KLT: tuple[str, ...] = ("rigid", "monocular")
STEREO: tuple[str, ...] = ("rigid", "homography", "affine")
RIGID: tuple[str, ...] = ("rigid",)
PLANAR: tuple[str, ...] = ("homography", "affine")

# bool is no number here, and neither are NaN and the infinities.
Real = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Whole = Annotated[int, Field(strict=True)]
Flag = Annotated[bool, Field(strict=True)]


class Stage(BaseModel):
    """The parameters of one stage, frozen."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    # With which ego_motion.model the group acts on what is observed, and whether it acts with
    # every model on the dense cloud and the disparity that are shown.
    models: ClassVar[tuple[str, ...]] = MODELS
    cloud: ClassVar[bool] = False


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


def choice(default: Any, *, title: str, help: str, models: tuple[str, ...] | None = None) -> Any:
    """One of several values, or a switch; ``models`` as of ``number``."""
    extra: dict[str, Any] = {"unit": ""}
    if models is not None:
        extra["models"] = list(models)
    return Field(default=default, title=title, description=help, json_schema_extra=extra)
