"""Write numbers and words that the page shares with the code as its module to the standard output.

    python -m tools.packaging.page_facts

``tools/packaging/frontend.py types`` makes ``static/app/elements/facts.js`` from it.
"""

from __future__ import annotations

import json
import sys

from app.contract.comparing import COMPARISON_TAG
from app.contract.drive import COMMAND_FRESH_S, FARTHEST_GOAL_M
from app.contract.journal import LOG_LENGTH
from app.contract.parameters import LONGEST_PRESET_HELP, PRESET_FORMAT
from app.contract.sockets import HEARTBEAT_S
from app.contract.status import FASTEST_RATE, SLOWEST_RATE, STALE_AFTER_S
from app.contract.values import LONGEST_NAME
from app.http.gate.access import WATCHING_ONLY
from app.http.gate.security import SESSION_OVER
from observer.calibration.ageing.row_drift import WARN_PX
from observer.calibration.boards.board import (
    A4_COLUMNS,
    A4_ROWS,
    A4_SQUARE_MM,
    MAX_SIDE_CORNERS,
    MAX_SQUARE_MM,
    MIN_SIDE_CORNERS,
    MIN_SQUARE_MM,
)
from observer.calibration.boards.printing import BAR_MM
from observer.evaluation.gaps import GAP_STEPS
from observer.guard.parameters import GuardParameters
from observer.intervals import SIGMAS_95
from observer.obstacle_colors import OBSTACLE_RGB
from observer.occupancy import BLOCKED, FREE, STATES
from observer.robots.models import SPECS
from observer.truth.counting import MOVING_MPS, VISIBLE_SHARE

# Name on the page -> its value and its meaning.
FACTS: dict[str, tuple[float | str | dict[str, str], str]] = {
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
    "COMMAND_FRESH_S": (
        COMMAND_FRESH_S,
        "The server stops a robot after this long without a sign of its operator, s.",
    ),
    "HEARTBEAT_S": (HEARTBEAT_S, "The server sends something on a socket at least this often, s."),
    "STALE_AFTER_S": (STALE_AFTER_S, "What is shown is stale after this time, s."),
    "LOG_LENGTH": (LOG_LENGTH, "Number of entries of the log that the server keeps."),
    "OBSTACLE_COLOURS": (
        {state: "#" + bytes(rgb).hex() for state, rgb in OBSTACLE_RGB.items()},
        "Colour of an obstacle by its state, in every image and view of the scene.",
    ),
    "ROBOT_MODELS": (
        {model: f"{spec.title}, {spec.variant}" for model, spec in SPECS.items()},
        "Robot models whose constants are known, and their names for people.",
    ),
    "FARTHEST_GOAL_M": (FARTHEST_GOAL_M, "The server rejects a goal farther away, metres."),
    "MAP_STATES": (STATES, "Number of states of a cell of a local map, from 0."),
    "MAP_FREE": (FREE, "State of a free cell of a local map."),
    "MAP_BLOCKED": (BLOCKED, "State of a blocked cell of a local map."),
    "MIN_SIDE_CORNERS": (MIN_SIDE_CORNERS, "Minimum inner corners of a board in each direction."),
    "MAX_SIDE_CORNERS": (MAX_SIDE_CORNERS, "Maximum inner corners of a board in each direction."),
    "MIN_SQUARE_MM": (MIN_SQUARE_MM, "Minimum side of a board's squares, mm."),
    "MAX_SQUARE_MM": (MAX_SQUARE_MM, "Maximum side of a board's squares, mm."),
    "A4_COLUMNS": (A4_COLUMNS, "Inner corners across of a board that fits on A4."),
    "A4_ROWS": (A4_ROWS, "Inner corners down of a board that fits on A4."),
    "A4_SQUARE_MM": (A4_SQUARE_MM, "Side of its squares, mm."),
    "BAR_MM": (BAR_MM, "Length of the bar printed beside a calibration board, mm."),
    "ROW_WARN_PX": (WARN_PX, "The server warns of a higher epipolar error, px."),
    "SLOWEST_RATE": (SLOWEST_RATE, "Lowest playback rate, times the recorded speed."),
    "FASTEST_RATE": (FASTEST_RATE, "Highest playback rate, times the recorded speed."),
    "GAP_STEPS": (GAP_STEPS, "No curve is drawn over a stretch this many times its usual step."),
    "COMPARISON_TAG": (COMPARISON_TAG, "Tag of the runs that a comparison of methods keeps."),
    "PRESET_FORMAT": (PRESET_FORMAT, "First field of a preset's file."),
    "LONGEST_NAME": (LONGEST_NAME, "Maximum number of characters in a name."),
    "LONGEST_PRESET_HELP": (
        LONGEST_PRESET_HELP,
        "Maximum number of characters in the description of a preset.",
    ),
    "SESSION_OVER": (SESSION_OVER, "A socket whose session has ended is closed with this code."),
    "WATCHING_ONLY": (WATCHING_ONLY, "Notice for a browser with read-only access."),
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


def _literal(value: float | str | dict[str, str]) -> str:
    if isinstance(value, float | int):
        return f"{value:.15g}"
    return json.dumps(value, ensure_ascii=False)


if __name__ == "__main__":
    sys.stdout.buffer.write(page_facts().encode())
