"""Development tools that are not part of the wheel.

Attributes:
    ROOT: the repository's folder.
"""

from __future__ import annotations

from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
