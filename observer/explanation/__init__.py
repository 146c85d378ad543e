"""Reasons why any pixel counts as moving, as static, or as undecided.

``explain_pixel`` reads the full trace of one ``observe``. Of the method it reruns only the
grouping of points, so that it can say by how much another answer was missed.
"""

from __future__ import annotations

from observer.explanation.answer import PixelAnswer, PixelVerdict
from observer.explanation.pixel import explain_pixel

__all__ = ["PixelAnswer", "PixelVerdict", "explain_pixel"]
