"""The worker's side: observes a pair, reports its steps and draws them."""

from __future__ import annotations

from collections import OrderedDict
from contextlib import closing
from dataclasses import dataclass

from app.contract.steps import MethodStep, StepNumber
from app.contract.values import filled
from app.runtime.jobs import Report
from app.workers.steps.messages import DrawStep, Look, Steps, StepsAnswer
from observer.calibration.formats.opencv_file import read_calibration
from observer.errors import DynamicObserverError
from observer.opening import OpenedSource, open_source
from observer.parameters import Parameters
from observer.steps import (
    FrameReader,
    ObservedPair,
    PaperStep,
    nine_steps,
    observe_pair,
    usual_frame,
)
from observer.steps.formulas import mathml, text

# Pairs kept: about 5 MB each for the lab's images.
_MOST_PAIRS = 6


@dataclass
class _Open:
    """The open source.

    Attributes:
        key: source and state it was opened with. usual: frame to look at first; None if not known
            yet.
    """

    key: tuple[str, str]
    opened: OpenedSource
    reader: FrameReader
    usual: int | None = None


class StepsWork:
    """Keeps the source open and caches the pairs looked at last."""

    def __init__(self) -> None:
        """Start without a source and with an empty cache."""
        self._open: _Open | None = None
        self._pairs: OrderedDict[str, ObservedPair] = OrderedDict()

    def do(self, job: DrawStep, _: Report) -> StepsAnswer:
        """Answer one request."""
        try:
            place = self._place(job.look)
        except DynamicObserverError as error:
            return StepsAnswer(None, str(error), "source")
        try:
            return StepsAnswer(self._made(job, place))
        except DynamicObserverError as error:
            return StepsAnswer(None, str(error), "frame")

    def _made(self, job: DrawStep, place: _Open) -> Steps | bytes:
        pair = self._pair(job.look, place)
        if job.format is None:
            return Steps(
                frame=pair.frame,
                frame_count=place.opened.source.info.frame_count,
                first_frame=pair.first,
                time=float(pair.trace["time"]),
                dt=pair.dt,
                truth=pair.truth is not None,
                steps=tuple(map(_step_message, nine_steps(pair))),
            )
        return _file(pair, job)

    def _pair(self, look: Look, place: _Open) -> ObservedPair:
        frame = look.frame
        if frame is None:
            if place.usual is None:
                place.usual = usual_frame(place.opened.source)
            frame = place.usual
        key = repr((place.key, frame, sorted(look.parameters.items()), look.calibration_yaml))
        if key not in self._pairs:
            calibration = None
            if look.calibration_yaml is not None:
                calibration = read_calibration(look.calibration_yaml, name="the calibration")
            self._pairs[key] = observe_pair(
                place.reader,
                frame,
                Parameters().changed(look.parameters),
                calibration=calibration,
                truth=place.opened.truth,
            )
        self._pairs.move_to_end(key)
        while len(self._pairs) > _MOST_PAIRS:
            self._pairs.popitem(last=False)
        return self._pairs[key]

    def _place(self, look: Look) -> _Open:
        key = look.source, look.state
        if self._open is None or self._open.key != key:
            self._close()
            opened = open_source(look.source)
            try:
                self._open = _Open(key, opened, FrameReader(opened.source))
            except BaseException:
                opened.source.close()
                raise
        return self._open

    def _close(self) -> None:
        if self._open is None:
            return
        robots = self._open.opened.robots
        with closing(self._open.opened.source):
            if robots is not None:
                robots.close()
        self._open = None


def _step_message(step: PaperStep) -> MethodStep:
    return filled(
        MethodStep,
        step,
        formula=mathml(step.formula),
        formula_text=text(step.formula),
        numbers=tuple(filled(StepNumber, number) for number in step.numbers),
    )


def _file(pair: ObservedPair, job: DrawStep) -> bytes:
    # Loading Matplotlib takes as long as observing a pair, and pictures may never be requested.
    from observer.figures import dark_svg, figure_bytes
    from observer.steps.pictures import step_figure
    from observer.steps.tables import step_table

    assert job.format is not None
    if job.format == "csv":
        return step_table(pair, job.number).encode()
    figure = step_figure(pair, job.number, labelled=job.labelled)
    name = f"step-{job.number}"
    if job.dark and job.format == "svg":
        return dark_svg(figure, name)
    return figure_bytes(figure, name, job.format)
