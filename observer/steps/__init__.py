"""The paper's method step by step on one frozen pair of frames, for study, teaching and print.

``observe_pair`` observes a pair, ``nine_steps`` returns what each step found; ``pictures`` draws it
and ``tables`` gives its data::

    from observer.opening import open_source
    from observer.parameters import preset
    from observer.steps import FrameReader, nine_steps, observe_pair
    from observer.steps.pictures import step_figure

    opened = open_source("simulated:lab")
    pair = observe_pair(FrameReader(opened.source), 40, preset("paper"), truth=opened.truth)
    for step in nine_steps(pair):
        print(step.number, step.title, step.numbers)
    step_figure(pair, 6, labelled=True).savefig("residual_flow.pdf")
"""

from observer.steps.nine_steps import COUNT, nine_steps
from observer.steps.pair import (
    FrameReader,
    ObservedPair,
    TrueSpeed,
    frames_before,
    observe_pair,
    usual_frame,
)
from observer.steps.paper_step import Number, PaperStep

__all__ = [
    "COUNT",
    "FrameReader",
    "Number",
    "ObservedPair",
    "PaperStep",
    "TrueSpeed",
    "frames_before",
    "nine_steps",
    "observe_pair",
    "usual_frame",
]
