"""Sources that can be chosen, as reported to clients."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from app.contract.calibrating import BoardFacts
from app.contract.values import means

SourceGroup = Literal["simulated", "cameras", "recordings", "folders"]


@dataclass(frozen=True)
class SourceEntry:
    spec: Annotated[str, means("Text that opens it.")]
    title: str
    help: str
    group: SourceGroup
    template: Annotated[
        bool, means("Whether the words in capitals in the spec are placeholders.")
    ] = False
    picture: Annotated[
        bool, means("Whether ``GET /api/sources/picture.jpg`` has a picture of it.")
    ] = False
    board: Annotated[
        BoardFacts | None,
        means(
            "The board that is shown to its cameras, if the source is for practising calibration."
        ),
    ] = None
    recent: Annotated[
        int | None,
        means(
            "Rank among the recently opened sources, 0 is the most recent; null: not one of them."
        ),
    ] = None
