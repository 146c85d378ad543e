"""What the server does, apart from how it is asked; ``Server`` is the door to it."""

from __future__ import annotations

from app.server.contracts import Engine, Listener
from app.server.errors import Conflict, FieldError, NotAvailable, NotThere
from app.server.server import Server

__all__ = [
    "Conflict",
    "Engine",
    "FieldError",
    "Listener",
    "NotAvailable",
    "NotThere",
    "Server",
]
