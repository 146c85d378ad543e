"""Commands and signs of presence of a lease holder, and their expiry."""

from __future__ import annotations

import math

from app.contract.drive import COMMAND_FRESH_S
from app.runtime.errors import ProcessRefused

Velocity = tuple[float, float]
ZERO: Velocity = (0.0, 0.0)


class Consent:
    """Consent of one role's operator. It reads no clock: the caller passes the time.

    A command or a sign of presence is valid for ``COMMAND_FRESH_S`` after it was issued. Once one
    has expired, a latch holds: no velocity is accepted until the operator has let go, so a link
    that recovers while a key is held restarts nothing. Letting go is a command with zero velocity,
    or being present for ``COMMAND_FRESH_S`` without any velocity.

    Attributes:
        present: a command or sign of presence has not expired.
        released: the latch does not hold.
    """

    def __init__(self) -> None:
        self._sequence: int | None = None
        self._issued = -math.inf
        self._velocity = ZERO
        self._velocity_issued = -math.inf
        # The newest command asked for motion, even if that velocity has been dropped since.
        self._held = False
        self._quiet_since: float | None = None
        self.present = False
        self.released = True

    @property
    def velocity(self) -> Velocity:
        """Return the requested velocity, m/s and rad/s; the caller decides if it may be driven."""
        return self._velocity

    @property
    def sign(self) -> float | None:
        """Return the issue time of the valid velocity, or else of the newest sign of presence.

        None if none was sent yet; after ``withdraw`` it is the newer of the two.
        """
        moment = self._issued if self._velocity == ZERO else self._velocity_issued
        return moment if math.isfinite(moment) else None

    def take(self, sequence: int, issued: float, velocity: Velocity | None, now: float) -> float:
        """Accept a command, or with no velocity a sign of presence.

        Returns:
            Its age, seconds.

        Raises:
            ProcessRefused: it is too old, not the newest, or not finite; nothing was changed.
        """
        numbers = (issued, *(velocity or ()))
        if not all(math.isfinite(number) for number in numbers):
            raise ProcessRefused(
                "the time and velocities of a command must be finite numbers", "input"
            )
        # A command dated in the future would stay valid for too long.
        issued = min(issued, now)
        age = now - issued
        if age >= COMMAND_FRESH_S:
            raise ProcessRefused(
                f"the command is {1000 * age:.0f} ms old; "
                f"it must arrive within {1000 * COMMAND_FRESH_S:.0f} ms",
                "state",
            )
        if self._sequence is not None and sequence <= self._sequence:
            raise ProcessRefused(
                f"the sequence number {sequence} of the command must be greater than the last "
                f"one, {self._sequence}",
                "state",
            )
        self._sequence = sequence
        self._issued = max(self._issued, issued)
        self.present = True
        if velocity is not None:
            self._velocity, self._velocity_issued = velocity, issued
            self._held = velocity != ZERO
            if velocity == ZERO:
                self.released = True
        if self._velocity != ZERO:
            self._quiet_since = None
        elif self._quiet_since is None:
            self._quiet_since = now
        elif now - self._quiet_since >= COMMAND_FRESH_S:
            self._held, self.released = False, True
        return age

    def expire(self, now: float) -> bool:
        """Expire everything too old; return true if anything expired."""
        moved = self._velocity != ZERO and now - self._velocity_issued >= COMMAND_FRESH_S
        left = self.present and now - self._issued >= COMMAND_FRESH_S
        if left:
            self.present = False
        if moved or left:
            self.withdraw()
        return moved or left

    def withdraw(self) -> None:
        """Drop the velocity; a new one is accepted only once the operator has let go."""
        self._velocity = ZERO
        self._quiet_since = None
        self.released = False

    def arm(self) -> None:
        """Note the arming: only an operator who has not let go since the last velocity must do so.

        A held key repeats its velocity only now and then, and not at all over a link that is down.
        """
        self.released = not self._held
