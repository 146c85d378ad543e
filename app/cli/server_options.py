"""Options of the commands that start the server, or have it started."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

HostOption = Annotated[str | None, typer.Option(help="Address to listen on. [default: 127.0.0.1]")]
PortOption = Annotated[int | None, typer.Option(help="Port to listen on. [default: 8080]")]
AllowedHostOption = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME", help="Another host name by which browsers may reach the server; repeatable."
    ),
]
TlsCertOption = Annotated[Path | None, typer.Option(help="Certificate chain, PEM.")]
TlsKeyOption = Annotated[Path | None, typer.Option(help="Private key, PEM.")]
