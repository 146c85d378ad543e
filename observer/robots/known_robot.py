"""Known facts about an ARCOS robot: its model, its settings, and the content of its packets."""

from __future__ import annotations

from collections.abc import Mapping

from observer.robots.config_reply import ConfigReply
from observer.robots.contract import RobotLimits, RobotPhase, RobotReport, Sent, SonarReading
from observer.robots.handshake import Identity
from observer.robots.models import SPECS, RobotSpec
from observer.robots.odometry import WheelOdometry
from observer.robots.robot_limits import limits_in_force
from observer.robots.robot_watch import RobotWatch
from observer.robots.sip import RobotStatus, decode_status

# Sonars 0 to 7 are the front array.
_SONAR_ARRAY = 8
# Age of the readings of sonars that have not reported yet: nobody takes one this old for news.
_NEVER_S = 10.0
# Fields of a report taken from the model, and from the newest status packet.
_OF_SPEC = ("model", "radius_m", "width_m", "length_m")
_OF_STATUS = (
    *("speed_mps", "turn_rate_radps", "motors_enabled", "stalled", "front_bumpers"),
    *("rear_bumpers", "stop_pressed", "charging", "temperature_c"),
)


class KnownRobot:
    """Known facts about a robot; the driver's lock guards them.

    Args:
        model: overrides what the robot reports; None: as reported.

    Attributes:
        spec: of the model it is driven as. limits: those in force. None while unknown.
    """

    def __init__(self, model: RobotSpec | None) -> None:
        self._model = model
        self.spec = model
        self.limits: RobotLimits | None = None
        self._identity: Identity | None = None
        self._config = ConfigReply()
        self._odometry: WheelOdometry | None = None
        self._moved = False
        self._sonars: dict[int, SonarReading] = {}

    @property
    def watchdog_s(self) -> float | None:
        """Return the time without a command after which its firmware stops it."""
        watchdog_ms = self._config.watchdog_ms
        return None if watchdog_ms is None else watchdog_ms / 1000

    def identify(self, identity: Identity) -> RobotSpec | None:
        """Take its identity; return the model it is driven as, None if that is unknown."""
        self._identity = identity
        self.spec = self._model or SPECS.get(identity.subtype)
        return self.spec

    def configure(self, config: ConfigReply) -> RobotLimits:
        """Take its settings; return the limits in force with them."""
        self._config = config
        self.limits = limits_in_force(self._known_spec, config)
        return self.limits

    def begin_session(self, now: float) -> None:
        """Continue the odometry at the same place, with sonars silent until they report."""
        spec = self._known_spec
        if self._odometry is None or self._odometry.spec != spec:
            self._odometry = WheelOdometry(spec)
            self._moved = False
        self._odometry.rebaseline()
        fitted = self._config.front_sonar, self._config.rear_sonar
        self._sonars = {
            index: SonarReading(index, pose.x, pose.y, pose.heading, None, now - _NEVER_S)
            for index, pose in enumerate(spec.sonars)
            if fitted[index // _SONAR_ARRAY]
        }

    def decode(self, payload: bytes) -> RobotStatus:
        """Decode a status packet.

        Raises:
            ValueError: it is damaged.
        """
        front, rear = self._config.front_bumpers, self._config.rear_bumpers
        return decode_status(payload, self._known_spec, front or 0, rear or 0)

    def take(self, status: RobotStatus, now: float) -> None:
        """Take a status packet of the session."""
        assert self._odometry is not None
        self._odometry.add(status.raw_x, status.raw_y, status.raw_heading, now)
        self._moved = True
        for index, range_m in status.ranges_m.items():
            pose = self._known_spec.sonars[index]
            self._sonars[index] = SonarReading(index, pose.x, pose.y, pose.heading, range_m, now)

    def report(
        self,
        phase: RobotPhase,
        trouble: str | None,
        watch: RobotWatch,
        sent: Sent | None,
        counters: Mapping[str, int],
        now: float,
    ) -> RobotReport:
        """Return a report; the arguments are what its driver knows of the connection."""
        identity = self._identity
        jumps = {} if self._odometry is None else {"odometry_jumps": self._odometry.jumps}
        # Without a packet nothing is known yet of its state in this session.
        silent = phase is RobotPhase.CONNECTED and watch.status is None
        return RobotReport(
            phase=RobotPhase.CONNECTING if silent else phase,
            trouble=trouble,
            fault=watch.fault,
            warnings=(*watch.warnings(now), *self._warnings(phase)),
            received=watch.received,
            name=identity.name or None if identity else None,
            subtype=identity.subtype or None if identity else None,
            odometry=self._odometry.place if self._odometry and self._moved else None,
            battery_v=watch.battery_v,
            battery=watch.battery,
            sonars=tuple(self._sonars[each] for each in sorted(self._sonars)),
            watchdog_s=self.watchdog_s,
            limits=self.limits,
            sent=sent,
            counters={**counters, **jumps},
            **{name: getattr(self.spec, name) for name in _OF_SPEC if self.spec},
            **{name: getattr(watch.status, name) for name in _OF_STATUS if watch.status},
        )

    def _warnings(self, phase: RobotPhase) -> list[str]:
        warnings, spec, identity, config = [], self.spec, self._identity, self._config
        if spec is not None and identity is not None and identity.subtype != spec.model:
            warnings.append(
                f"it identifies itself as {identity.subtype!r} but is driven as {spec.model}"
            )
        protection = {"bumpers": config.front_bumpers, "watchdog": config.watchdog_ms}
        unknown = [name for name, value in protection.items() if value is None]
        if phase is RobotPhase.CONNECTED and unknown:
            warnings.append(f"it did not report its settings: {' and '.join(unknown)} unknown")
        return warnings

    @property
    def _known_spec(self) -> RobotSpec:
        assert self.spec is not None
        return self.spec
