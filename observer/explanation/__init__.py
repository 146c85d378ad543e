"""Reasons why any pixel counts as moving, as standing, or as neither.

``explain_pixel`` reads what one ``observe`` left in a full trace and runs nothing of the method
again but the grouping of points, so that it can say by how much an answer was missed.
"""

from __future__ import annotations

from observer.explanation.answer import PixelAnswer, PixelVerdict
from observer.explanation.pixel import explain_pixel

__all__ = ["PixelAnswer", "PixelVerdict", "explain_pixel"]
