"""Sources that can be chosen, as they are told."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from app.contract.calibrating import BoardFacts
from app.contract.values import means

SourceGroup = Literal["simulated", "cameras", "recordings", "folders"]


@dataclass(frozen=True)
class SourceEntry:
    spec: Annotated[str, means("The text that opens it.")]
    title: str
    help: str
    group: SourceGroup
    template: Annotated[
        bool, means("Whether the words in capitals of the spec stand for what is to be typed.")
    ] = False
    picture: Annotated[
        bool, means("Whether it can be seen at ``GET /api/sources/picture.jpg``.")
    ] = False
    board: Annotated[
        BoardFacts | None,
        means("The board that is shown to its cameras: it is there to be calibrated."),
    ] = None
    recent: Annotated[
        int | None, means("Place among the sources opened lately, 0 is the last; None: of none.")
    ] = None
