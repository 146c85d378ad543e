"""What goes in and out of the REST interface, as OpenAPI shows it."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, Field, StrictBool, StrictInt

from app.http.api.values import Finite, Identifier, In, Name, Spec

# --- status ---------------------------------------------------------------------------------


# --- sources and playback -------------------------------------------------------------------


class SourceChoice(In):
    source: Spec
    calibration: Identifier | None = Field(None, description="None: the source's own.")


class PlaybackChange(In):
    """What is given is changed."""

    paused: StrictBool | None = None
    rate: Annotated[Finite, Field(ge=0.1, le=4.0)] | None = None
    loop: StrictBool | None = None
    step: Annotated[StrictInt, Field(ge=0, le=1000)] = Field(
        0, description="Show so many further frames while paused."
    )
    restart: StrictBool = False
    seek: Annotated[StrictInt, Field(ge=0)] | None = Field(
        None, description="Go on from this frame of a recording, and show it also while paused."
    )


# --- pixels ---------------------------------------------------------------------------------


# --- parameters -----------------------------------------------------------------------------


class ParametersNow(BaseModel):
    revision: int = Field(description="Grows with every change but those of guard.* parameters.")
    guard_revision: int = Field(
        description="Grows with every change of a guard.* parameter since the server started."
    )
    values: dict[str, Any]
    preset: str | None = Field(description="The preset with exactly these values.")
    frame: int | None = Field(description="The first frame they act on, as far as known.")


class ParametersChanged(ParametersNow):
    notes: list[str] = Field(
        description="One sentence on each given parameter that does not act with the method."
    )


class ParameterEntry(BaseModel):
    """All that a form needs to know of one parameter."""

    name: str
    group: str
    group_help: str
    title: str
    help: str
    type: Literal["number", "integer", "boolean", "choice"]
    unit: str
    default: Any
    models: list[str] = Field(
        description="With which ego_motion.model it acts on what is observed."
    )
    cloud: bool = Field(
        False, description="Whether it acts with every model on the dense cloud that is shown."
    )
    minimum: float | None = None
    maximum: float | None = None
    step: float | None = None
    choices: list[str] | None = None


class Preset(BaseModel):
    name: str
    help: str
    values: dict[str, Any]
    built_in: bool


class PresetName(In):
    name: Name
    help: Annotated[str, Field(strict=True, max_length=300)] = ""
