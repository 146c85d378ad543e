"""File in the data folder by which commands on the same computer find a running server.

It holds the token and is therefore readable by its owner only, like the token file. It is written
when the server has started and deleted when it ends.
"""

from __future__ import annotations

import contextlib
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import structlog
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from app.addresses import ServerAddress
from app.settings import is_every_address
from observer.errors import InputError
from observer.whole_files import whole_file

log = structlog.get_logger(__name__)

# In the data folder; backups leave it out.
ANNOUNCED_FILE = "server.json"
_MOST_BYTES = 64 * 1024
_WAIT_S = 1.0


class AnnouncedServer(BaseModel):
    """Running server as described by its file.

    Attributes:
        host, port, tls, allowed_hosts: as ``ServerAddress`` has them.
        token, read_only_token: of operators, and of the newest read-only link.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    host: str
    port: int = Field(ge=1, le=65535)
    tls: bool
    allowed_hosts: tuple[str, ...]
    token: str
    read_only_token: str

    @property
    def address(self) -> ServerAddress:
        """Return where it listens."""
        return ServerAddress(self.host, self.port, self.tls, self.allowed_hosts)

    def answers(self) -> bool:
        """Return whether somebody listens there."""
        host = "localhost" if is_every_address(self.host) else self.host
        try:
            with socket.create_connection((host, self.port), timeout=_WAIT_S):
                return True
        except OSError:
            return False


@contextmanager
def announced(folder: Path, server: AnnouncedServer) -> Iterator[Callable[[AnnouncedServer], None]]:
    """Let commands find the server during the context; if they cannot, serving still goes on.

    Yields a function that rewrites the file when the server has changed.
    """
    file = folder / ANNOUNCED_FILE

    def tell(server: AnnouncedServer) -> None:
        try:
            with whole_file(file, private=True) as part:
                part.write_text(server.model_dump_json(), encoding="utf-8")
        except OSError as error:
            log.warning("server_not_announced", file=str(file), reason=str(error))

    tell(server)
    try:
        yield tell
    finally:
        with contextlib.suppress(OSError):
            file.unlink()


def find_server(folder: Path) -> AnnouncedServer:
    """Return the server that keeps its data in a folder.

    Raises:
        InputError: none is running there, or its file cannot be read.
    """
    try:
        with (folder / ANNOUNCED_FILE).open("rb") as file:
            server = AnnouncedServer.model_validate_json(file.read(_MOST_BYTES))
    except FileNotFoundError:
        raise InputError(_none(folder)) from None
    except OSError as error:
        raise InputError(
            f"{folder / ANNOUNCED_FILE} cannot be read ({error.strerror}); ask as the user who "
            f"started the server"
        ) from None
    except ValidationError:
        raise InputError(
            f"{folder / ANNOUNCED_FILE} is damaged; restart the server, which rewrites it"
        ) from None
    if not server.answers():
        # It ended without a chance to delete the file.
        raise InputError(_none(folder))
    return server


def _none(folder: Path) -> str:
    return (
        f"no server is running with the data folder {folder}; start one with dynamic-observer "
        f"serve, or name its folder with --data"
    )
