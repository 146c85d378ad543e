"""The paper's method step by step, on one frozen pair of frames."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from app.contract.values import means

StepFormat = Literal["png", "svg", "pdf", "csv"]


@dataclass(frozen=True)
class StepNumber:
    name: str
    value: Annotated[float | None, means("None: not known.")]
    unit: str
    digits: Annotated[int, means("Worth showing after the point.")]


@dataclass(frozen=True)
class MethodStep:
    number: Annotated[int, means("From 1 to 9.")]
    key: Annotated[str, means("For files and scripts.")]
    title: str
    text: Annotated[str, means("One or two sentences.")]
    caption: Annotated[str, means("What the colours in its picture mean.")]
    formula: Annotated[Sequence[str], means("As MathML, one for each of its parts.")]
    formula_text: Annotated[str, means("The same as one line of text.")]
    numbers: Annotated[Sequence[StepNumber], means("Of this pair.")]
    parameters: Annotated[Sequence[str], means("Names of those that act in this step.")]
    missing: Annotated[str | None, means("Why it has no result in this frame.")]


@dataclass(frozen=True)
class MethodSteps:
    """All nine steps, and what they were observed with; the same for each picture's address."""

    source: Annotated[str, means("The text that names it.")]
    frame: Annotated[int, means("Position in the source of the image of t+dt, from 0.")]
    frame_count: Annotated[int | None, means("Of the source; None where it is not known.")]
    first_frame: Annotated[
        int, means("From it on frames were observed, so that tracks are confirmed.")
    ]
    time: Annotated[float, means("Of the image of t+dt, on the source's clock, s.")]
    dt: Annotated[float, means("Between the two images, s.")]
    preset: str
    preset_values: Annotated[Mapping[str, Any], means("All values of the preset.")]
    values: Annotated[Mapping[str, Any], means("All values in use.")]
    models: Annotated[Sequence[str], means("Values of ego_motion.model that have these steps.")]
    truth: Annotated[bool, means("Whether there is ground truth.")]
    steps: Sequence[MethodStep]
