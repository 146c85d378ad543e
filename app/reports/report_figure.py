"""Figure of a report, made or missing."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from matplotlib.figure import Figure

Step = Callable[[int, int | None], None]


@dataclass(frozen=True, eq=False)
class ReportFigure:
    """Figure of the paper, redone or missing.

    Attributes:
        name: for files.
        number: as in the paper.
        title, caption: for people.
        figure: None where ``missing`` gives the reason in a sentence.
        kind: ``chart`` for lines and text, ``picture`` for mostly images.
    """

    name: str
    number: str
    title: str
    caption: str
    figure: Figure | None
    kind: Literal["chart", "picture"] = "picture"
    missing: str = ""
