"""What the server does, apart from how it is asked; ``Station`` is the door to it."""

from __future__ import annotations

from app.station.contracts import Engine, Listener
from app.station.errors import Conflict, FieldError, NotAvailable, NotThere
from app.station.service import Station

__all__ = [
    "Conflict",
    "Engine",
    "FieldError",
    "Listener",
    "NotAvailable",
    "NotThere",
    "Station",
]
