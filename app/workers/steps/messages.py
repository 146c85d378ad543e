"""Messages to and from the worker: plain frozen dataclasses, sent as pickles."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

from app.contract.steps import MethodStep, StepFormat


@dataclass(frozen=True)
class Look:
    """Pair of frames to look at.

    Attributes:
        source: as ``observer.opening.open_source`` takes it. state: changes with its files.
        frame: position in the source; None for one that is worth looking at.
        parameters: all that differ from the declared ones, by dotted name.
        calibration_yaml: used instead of the source's own.
    """

    source: str
    state: str
    frame: int | None
    parameters: Mapping[str, Any]
    calibration_yaml: str | None


@dataclass(frozen=True)
class DrawStep:
    """Request for the file of one step; without a format, for what all steps found.

    Attributes:
        number: of the step, from 1. dark: for a page with a dark ground; only of pictures.
        labelled: with title, formula and meaning.
    """

    look: Look
    number: int = 1
    format: StepFormat | None = None
    dark: bool = False
    labelled: bool = False


@dataclass(frozen=True)
class Steps:
    """What all steps found; as in ``app.contract.steps.MethodSteps``."""

    frame: int
    frame_count: int | None
    first_frame: int
    time: float
    dt: float
    truth: bool
    steps: tuple[MethodStep, ...]


@dataclass(frozen=True)
class StepsAnswer:
    """Answer to every request: what was asked for, or one sentence why it cannot be had.

    A refusal is an answer, too, so that the process goes on with what it keeps.

    Attributes:
        result: None where it was refused. refused: why. place: what of the request was wrong.
    """

    result: Steps | bytes | None
    refused: str = ""
    place: Literal["source", "frame"] = "frame"
