"""The paper's method step by step, on one frozen pair of frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

from app.contract.parameters import ParameterValues
from app.contract.values import means

StepFormat = Literal["png", "svg", "pdf", "csv"]


@dataclass(frozen=True)
class StepNumber:
    name: str
    value: Annotated[float | None, means("null: unknown.")]
    unit: str
    digits: Annotated[int, means("Decimal places worth showing.")]


@dataclass(frozen=True)
class MethodStep:
    number: Annotated[int, means("From 1 to 9.")]
    key: Annotated[str, means("Name for files and scripts.")]
    title: str
    text: Annotated[str, means("One or two sentences.")]
    caption: Annotated[str, means("What the colours in its picture mean.")]
    formula: Annotated[Sequence[str], means("MathML, one for each part of the formula.")]
    formula_text: Annotated[str, means("The formula as one line of text.")]
    numbers: Annotated[Sequence[StepNumber], means("Figures of this pair.")]
    parameters: Annotated[Sequence[str], means("Names of the parameters used in this step.")]
    missing: Annotated[str | None, means("Why it has no result in this frame.")]


@dataclass(frozen=True)
class MethodSteps:
    """All nine steps and the settings they were made with; pictures' addresses take the same."""

    source: Annotated[str, means("Text that opens it.")]
    frame: Annotated[int, means("Position in the source of the image at t+dt, from 0.")]
    frame_count: Annotated[int | None, means("Number of frames of the source; null if unknown.")]
    first_frame: Annotated[
        int, means("First processed frame; processing starts early so that tracks are confirmed.")
    ]
    time: Annotated[float, means("Time of the image at t+dt, on the source's clock, s.")]
    dt: Annotated[float, means("Time between the two images, s.")]
    preset: str
    preset_values: Annotated[ParameterValues, means("All values of the preset.")]
    values: Annotated[ParameterValues, means("All values in use.")]
    models: Annotated[Sequence[str], means("Values of ego_motion.model that have these steps.")]
    truth: Annotated[bool, means("Whether there is ground truth.")]
    steps: Sequence[MethodStep]
