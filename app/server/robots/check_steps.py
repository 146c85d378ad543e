"""Steps of a guided check: the user's action, the expected stop, the promised figures."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

from app.contract.drive import StoppedEvent
from app.contract.robots import CheckStep, StopMeasured
from app.server.robots.stop_figures import stop_figures
from observer.rig.rig import Role

# Time limit between the cause of a stop and the zero velocity on the robot's port.
PROMISED_MS = 300.0
# A stop from a lower speed proves nothing.
MOVING_MPS = 0.1

_CAUSES = {
    "guard": "the guard's decision",
    "sight": "the last good frame",
    "expired": "the operator's last command",
    "lease": "the operator's last command",
}


@dataclass(frozen=True)
class Step(CheckStep):
    """State of a step.

    Attributes:
        kinds: kinds of ``StoppedEvent`` that the step tests; it ignores stops of other kinds.
    """

    kinds: tuple[str, ...]

    def with_stop(
        self, event: StoppedEvent, at: str, operator: str | None, margin_m: float | None
    ) -> Step:
        """Return the step after a stop.

        Args:
            margin_m: clearance that the guard keeps from everything; None if unknown.
        """
        before = event.before_mps
        if event.kind not in self.kinds:
            wanted = " or ".join(self.kinds)
            told = (
                f"this stop does not count for this step ({event.kind}, not {wanted}): "
                f"{event.sentence}"
            )
            return replace(self, told=told)
        if before is None or abs(before) < MOVING_MPS:
            speed = "at an unknown speed" if before is None else f"at {before:.2f} m/s"
            told = f"it stopped {speed}; it must be driving at {MOVING_MPS:g} m/s or more"
            return replace(self, told=told)
        figures = stop_figures(event)
        passed, verdict = judged(event.kind, figures, margin_m)
        return replace(
            self,
            state="passed" if passed else "failed",
            kind=event.kind,
            sentence=event.sentence,
            at=at,
            operator=operator,
            figures=figures,
            verdict=verdict,
            told=None,
        )


def _step(name: str, title: str, instruction: str, *kinds: str) -> Step:
    """Return a step that waits for a stop, with all facts of the stop unknown."""
    of_stop = [each.name for each in fields(CheckStep)[4:]]
    return Step(name, title, instruction, "waiting", **dict.fromkeys(of_stop), kinds=kinds)


_WALK_IN = _step(
    "walk_in",
    "Walk in",
    "Drive straight ahead at 0.2 to 0.3 m/s through free space, and keep driving while somebody "
    "steps in front of the robot, at least 1.5 m away.",
    "guard",
)
_COVER_LENS = _step(
    "cover_lens",
    "Cover a lens",
    "Arm again if necessary, drive at 0.2 to 0.3 m/s, and keep driving while somebody covers one "
    "lens with a hand.",
    "sight",
)
_UNPLUG = _step(
    "unplug",
    "Unplug a camera",
    "Uncover the lens, arm again, drive at 0.2 to 0.3 m/s, and keep driving while somebody "
    "unplugs one camera.",
    "sight",
)
_CLOSE_BROWSER = _step(
    "close_browser",
    "Close the browser",
    "With everything plugged in, arm again, drive at 0.2 to 0.3 m/s, and close this page while "
    "driving. Then reopen it: the check continues.",
    "expired",
    "lease",
)
_STEPS: dict[Role, tuple[Step, ...]] = {
    "observer": (_WALK_IN, _COVER_LENS, _UNPLUG, _CLOSE_BROWSER),
    # The obstacle has no cameras; its guard uses sonar.
    "obstacle": (_WALK_IN, _CLOSE_BROWSER),
}


def steps_of(role: Role) -> list[Step]:
    """Return the steps of a role, in order."""
    return list(_STEPS[role])


def judged(kind: str, figures: StopMeasured, margin_m: float | None) -> tuple[bool, str]:
    """Compare a stop with the promise; return the verdict and one sentence that explains it.

    Args:
        kind: kind of ``StoppedEvent``. margin_m: clearance that the guard keeps from everything, if
            known.
    """
    zero, stood, left = figures.zero_ms, figures.stood_ms, figures.separation_m
    cause = _CAUSES.get(kind, "its cause")
    if zero is None:
        return False, f"no stop command was sent after {cause}"
    soon = f"stop command sent {zero:.0f} ms after {cause}"
    if zero > PROMISED_MS:
        return False, f"{soon}, later than the limit of {PROMISED_MS:.0f} ms"
    if stood is None:
        return False, f"{soon}, but the robot did not report standstill"
    way = "" if figures.distance_m is None else f" and {figures.distance_m:.2f} m"
    rest = (
        f"{soon} (limit {PROMISED_MS:.0f} ms); "
        f"the robot came to a standstill after {stood:.0f} ms{way}"
    )
    if left is None:
        return True, rest
    if kind == "guard" and margin_m is not None and left < margin_m:
        return (
            False,
            f"{rest}, {left:.2f} m from the obstacle: less than the margin of {margin_m:.2f} m",
        )
    return True, f"{rest}, {left:.2f} m from the obstacle"
