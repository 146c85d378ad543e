"""Messages of the server on the sockets ``/api/live`` and ``/api/drive``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

from app.contract.events import LiveLine
from app.contract.journal import LogEntry
from app.contract.robots import RobotsNow, WheelSpeed
from app.contract.status import EngineWord, Status
from app.contract.values import means
from observer.rig.rig import Role
from observer.truth.matching import TrueBodyEntry

# Seconds: each socket carries a message at least this often, so that silence means a loss.
HEARTBEAT_S = 0.2

# --- /api/live -------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class StatusMessage(Status):
    """State of everything: at every change, and twice a second."""

    type: Literal["status"] = "status"


@dataclass(frozen=True, kw_only=True)
class RobotsTold(RobotsNow):
    """Part of ``RobotsMessage`` that is the same for all pages."""

    type: Literal["robots"] = "robots"


@dataclass(frozen=True, kw_only=True)
class RobotsMessage(RobotsTold):
    """Everything about driving, ten times a second while there are robots."""

    wheels: Annotated[Sequence[WheelSpeed], means("Speeds since the last message, oldest first.")]


@dataclass(frozen=True)
class ObservationTold:
    """Part of ``ObservationMessage`` that is the same for all pages."""

    sequence: Annotated[int, means("Counted by the server over all engines, from 1.")]
    line: LiveLine
    truth: Sequence[TrueBodyEntry]
    type: Literal["observation"] = "observation"


@dataclass(frozen=True, kw_only=True)
class ObservationMessage(ObservationTold):
    """A frame was observed; the client answers with ``painted`` and its sequence."""

    age_ms: Annotated[float, means("Time from its reception to the sending of this message.")]


@dataclass(frozen=True)
class HeartbeatMessage:
    """The server's heartbeat."""

    time: Annotated[float, means("The host's monotonic clock, s.")]
    observation_age_s: float | None
    engine: EngineWord
    type: Literal["heartbeat"] = "heartbeat"


@dataclass(frozen=True)
class LogMessage:
    """Something has happened that a user should know."""

    entries: Annotated[Sequence[LogEntry], means("Oldest first; `/api/log` has the earlier ones.")]
    type: Literal["log"] = "log"


LiveMessage = StatusMessage | RobotsMessage | ObservationMessage | HeartbeatMessage | LogMessage

# --- /api/drive ------------------------------------------------------------------------------


@dataclass(frozen=True)
class OperatorMessage:
    """First message: the operator's name as others see it."""

    name: str
    type: Literal["operator"] = "operator"


LinkQuality = Literal["good", "slow", "lost"]


@dataclass(frozen=True)
class LinkMessage:
    """Speed of this connection."""

    quality: LinkQuality
    rtt_ms: float | None
    delay_ms: float | None
    sentence: Annotated[str | None, means("Why the robots are stopped; null while they are not.")]
    type: Literal["link"] = "link"


@dataclass(frozen=True)
class PingMessage:
    """To be answered at once by ``pong``."""

    id: int
    type: Literal["ping"] = "ping"


@dataclass(frozen=True)
class LeaseMessage:
    """Answer to taking or releasing a role: its driver has changed, or has not."""

    role: Role
    state: Literal["yours", "refused", "lost"]
    lease: str | None = None
    holder: Annotated[str | None, means("Who has control.")] = None
    sentence: str | None = None
    type: Literal["lease"] = "lease"


@dataclass(frozen=True)
class SentMessage:
    """Velocity that was really sent for one command."""

    role: Role
    sequence: int
    speed_mps: float
    turn_rate_radps: float
    limited_by: str | None
    age_ms: float | None
    type: Literal["sent"] = "sent"


@dataclass(frozen=True)
class RefusedMessage:
    """A command, or a stop, that was not carried out."""

    role: Role | None
    sequence: int | None
    sentence: str
    type: Literal["refused"] = "refused"


DriveMessage = (
    OperatorMessage | LinkMessage | PingMessage | LeaseMessage | SentMessage | RefusedMessage
)
