"""Write numbers and words that the page shares with the code as its module to the standard output.

    python -m tools.packaging.page_facts

``tools/packaging/frontend.py types`` makes ``static/app/elements/facts.js`` from it.
"""

from __future__ import annotations

import json
import sys

from observer.guard.parameters import GuardParameters
from observer.intervals import SIGMAS_95
from observer.truth.counting import MOVING_MPS, VISIBLE_SHARE

# Name on the page -> its value and its meaning.
FACTS: dict[str, tuple[float | str, str]] = {
    "SIGMAS_95": (SIGMAS_95, "Half of the 95 % interval, in standard deviations."),
    "MOVING_MPS": (MOVING_MPS, "A true body that is faster counts as moving, m/s."),
    "VISIBLE_SHARE": (
        VISIBLE_SHARE,
        "A true body of which the camera sees this share or more is in sight, 0 to 1.",
    ),
    "SONAR_HALF_ANGLE_DEG": (
        GuardParameters().sonar_half_angle_deg,
        "Half the angle of a sonar's cone, until the guard's parameters are known.",
    ),
}


def page_facts() -> str:
    """Return the module's text, before prettier."""
    declared = [
        f"/** {meaning} */\nexport const {name} = {_literal(value)};\n"
        for name, (value, meaning) in FACTS.items()
    ]
    return "\n".join(
        ["/** Facts declared in the code: made by tools/packaging/page_facts.py. */\n", *declared]
    )


def _literal(value: float | str) -> str:
    return json.dumps(value, ensure_ascii=False) if isinstance(value, str) else f"{value:.15g}"


if __name__ == "__main__":
    sys.stdout.buffer.write(page_facts().encode())
