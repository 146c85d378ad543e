"""Declaration of a parameter: a number or a choice with its bounds, unit, label and help."""

from __future__ import annotations

import ast
import inspect
import sys
from collections.abc import Iterator, Mapping
from functools import cache
from itertools import pairwise
from typing import Annotated, Any, ClassVar, Literal, get_args

from pydantic import BaseModel, ConfigDict, Field

ParameterValue = float | int | bool | str

# Values of ego_motion.model, which chooses the method.
Model = Literal["rigid", "homography", "affine", "monocular"]
MODELS: tuple[Model, ...] = get_args(Model)
# Methods that track points by KLT over time, and methods that use both images.
KLT: tuple[str, ...] = ("rigid", "monocular")
STEREO: tuple[str, ...] = ("rigid", "homography", "affine")
RIGID: tuple[str, ...] = ("rigid",)
PLANAR: tuple[str, ...] = ("homography", "affine")

# Booleans, NaN and infinities do not count as numbers here.
Real = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Whole = Annotated[int, Field(strict=True)]
Flag = Annotated[bool, Field(strict=True)]


class Stage(BaseModel):
    """The parameters of one stage, frozen; the docstring under each is the help people read."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    # Values of ego_motion.model with which the group affects observations, and whether with every
    # model it affects the displayed dense cloud and disparity.
    models: ClassVar[tuple[str, ...]] = MODELS
    cloud: ClassVar[bool] = False


def number(
    default: float,
    *,
    ge: float,
    le: float,
    title: str,
    step: float,
    unit: str = "",
    models: tuple[str, ...] | None = None,
    basic: bool = False,
) -> Any:
    """Declare a number; give ``models`` if it has an effect with fewer models than its group.

    ``basic``: it is among the eight that a form shows first for each method, from which a newcomer
    learns most.
    """
    extra: dict[str, Any] = {"unit": unit, "step": step}
    if models is not None:
        extra["models"] = list(models)
    if basic:
        extra["basic"] = True
    return Field(default=default, ge=ge, le=le, title=title, json_schema_extra=extra)


def choice(
    default: Any, *, title: str, labels: Mapping[str, str] | None = None, basic: bool = False
) -> Any:
    """Declare one of several values, or a switch; ``basic`` as in ``number``.

    ``labels``: what a form calls each of the values; None for a switch.
    """
    extra: dict[str, Any] = {"unit": "", "basic": True} if basic else {"unit": ""}
    if labels is not None:
        extra["labels"] = dict(labels)
    return Field(default=default, title=title, json_schema_extra=extra)


@cache
def helps(module: str) -> dict[tuple[str, str], str]:
    """Return the docstrings under the fields of a module's stages, by class and field.

    They are read from the source on first use, because pydantic's ``use_attribute_docstrings``
    would slow down every import.
    """
    return {
        (stage.name, name): " ".join(text.split())
        for stage in ast.parse(inspect.getsource(sys.modules[module])).body
        if isinstance(stage, ast.ClassDef)
        for pair in pairwise(stage.body)
        for name, text in _documented(*pair)
    }


def _documented(field: ast.stmt, below: ast.stmt) -> Iterator[tuple[str, str]]:
    match field, below:
        case ast.AnnAssign(target=ast.Name(id=name)), ast.Expr(value=ast.Constant(value=str(text))):
            yield name, text
