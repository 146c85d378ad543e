"""The server's functions, independent of the web layer; ``Server`` is their entry point."""

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
