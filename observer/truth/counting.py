"""True bodies that count in comparisons: those that move where the camera can see them.

Evaluation, reports and the page share these limits. The command line's help imports them, so this
imports nothing.
"""

from __future__ import annotations

MOVING_MPS = 0.05
"""A true body that is faster counts as moving, m/s."""
VISIBLE_SHARE = 0.5
"""A true body of which the camera sees this share or more is in sight, 0 to 1."""
