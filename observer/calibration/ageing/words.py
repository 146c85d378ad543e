"""States of the checks, as the server also reports them.

Its clients import this module, so it imports nothing that is slow to load.
"""

from __future__ import annotations

from typing import Literal

# Whether the cameras still converge as calibrated.
VergenceWord = Literal["unobserved", "consistent", "drifted"]
