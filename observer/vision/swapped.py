"""The sentence for a pair whose left and right images are swapped, and how to recognise it.

All depths from such a pair are wrong, so it is refused where other faults only degrade.
"""

from __future__ import annotations

from collections.abc import Iterable

_BEGIN = "left and right seem to be swapped"


def swapped_sentence(swapped: float, as_given: float) -> str:
    """Return the sentence.

    Args:
        swapped, as_given: share of the image with a stereo partner, in either order.
    """
    return (
        f"{_BEGIN}: {100 * swapped:.0f} % of the image has a stereo match in the swapped order and "
        f"{100 * as_given:.0f} % in this one"
    )


def says_swapped(reason: str | None) -> bool:
    """Return whether a reason says that left and right are swapped."""
    return reason is not None and reason.startswith(_BEGIN)


def swapped_reason(reasons: Iterable[str]) -> str | None:
    """Return the first of a frame's reasons that says so; None if none does."""
    return next((reason for reason in reasons if says_swapped(reason)), None)
