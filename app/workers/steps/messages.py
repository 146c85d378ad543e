"""Messages to and from the worker: plain frozen dataclasses, sent as pickles."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from app.contract.parameters import ParameterValues
from app.contract.steps import MethodStep, StepFormat


@dataclass(frozen=True)
class Look:
    """Pair of frames to look at.

    Attributes:
        source: as ``observer.opening.open_source`` takes it. state: changes when its files change.
        frame: position in the source; None lets the worker choose one worth looking at.
        parameters: all that differ from their defaults, by dotted name.
        calibration_yaml: used instead of the source's own.
    """

    source: str
    state: str
    frame: int | None
    parameters: ParameterValues
    calibration_yaml: str | None


@dataclass(frozen=True)
class DrawStep:
    """Request for the file of one step, or, without a format, for the results of all steps.

    Attributes:
        number: number of the step, from 1. dark: for a page with a dark background; only for SVG.
        labelled: with title, formula and meaning.
    """

    look: Look
    number: int = 1
    format: StepFormat | None = None
    dark: bool = False
    labelled: bool = False


@dataclass(frozen=True)
class Steps:
    """Results of all steps; as in ``app.contract.steps.MethodSteps``."""

    frame: int
    frame_count: int | None
    first_frame: int
    time: float
    dt: float
    truth: bool
    steps: tuple[MethodStep, ...]


@dataclass(frozen=True)
class StepsAnswer:
    """Answer to every request: what was requested, or one sentence on why it was refused.

    A refusal is an answer too, so the process keeps running with its state.

    Attributes:
        result: None if refused. refused: the reason. place: the part of the request at fault.
    """

    result: Steps | bytes | None
    refused: str = ""
    place: Literal["source", "frame"] = "frame"
