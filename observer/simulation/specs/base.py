"""Base of all scenario classes: strict keys, and bounded numbers."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

Fraction = Annotated[float, Field(ge=0, le=1)]
Positive = Annotated[float, Field(gt=0, le=1000)]
Finite = Annotated[float, Field(ge=-1000, le=1000)]
Degrees = Annotated[float, Field(ge=-3600, le=3600)]


class Spec(BaseModel):
    """Frozen model that refuses unknown keys, so that a misspelt key is an error."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class SineSpec(Spec):
    """``amplitude sin(2 pi t / period + phase)``."""

    amplitude: float = Field(0.0, ge=-1000, le=1000)
    period_s: Positive = 10.0
    phase_deg: Degrees = 0.0
