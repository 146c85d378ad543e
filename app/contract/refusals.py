"""Answers to refused requests: every refusal is a sentence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

from app.contract.values import means


@dataclass(frozen=True)
class Problem:
    loc: Annotated[
        Sequence[str | int], means("Location in the request, such as body and the field's name.")
    ]
    msg: Annotated[str, means("What is wrong and what would be right.")]
    type: str


@dataclass(frozen=True)
class Problems:
    """Values that were refused; nothing was changed."""

    detail: Sequence[Problem]


@dataclass(frozen=True)
class Refused:
    """Reason for a refusal, in one sentence."""

    detail: str
