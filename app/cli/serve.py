"""``dynamic-observer serve``: serve the panel, the viewer and REST."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from app.cli.server_options import (
    AllowedHostOption,
    HostOption,
    PortOption,
    TlsCertOption,
    TlsKeyOption,
)
from app.cli.storage_options import DatabaseOption, DataOption, chosen_settings


def serve(
    source: Annotated[
        str | None, typer.Argument(help="What to open first. [default: simulated:lab]")
    ] = None,
    host: HostOption = None,
    port: PortOption = None,
    data: DataOption = None,
    database: DatabaseOption = None,
    truth: Annotated[
        str | None,
        typer.Option(
            help="Live motion capture, as vrpn:HOST or vicon-udp:PORT; saved for the next start."
        ),
    ] = None,
    token_file: Annotated[
        Path | None, typer.Option(help="File that keeps the sign-in token across restarts.")
    ] = None,
    allowed_host: AllowedHostOption = None,
    tls_cert: TlsCertOption = None,
    tls_key: TlsKeyOption = None,
    no_browser: Annotated[
        bool,
        typer.Option(
            "--no-browser",
            help="Do not open the page in a browser. By default it opens if the server is started "
            "from a terminal on a desktop, never over SSH.",
        ),
    ] = False,
    strict: Annotated[
        bool,
        typer.Option(
            "--strict",
            help="Exit with code 1 if the source, the rig or any other setting cannot be used. "
            "Without this option the server starts, and the page names the problem.",
        ),
    ] = False,
) -> None:
    """Serve the web page and print the link to open."""
    from app.http.own_browser import at_desktop
    from app.http.run_server import run

    settings = chosen_settings(
        source=source,
        host=host,
        port=port,
        data=data,
        database=database,
        truth=truth,
        token_file=token_file,
        allowed_hosts=tuple(allowed_host) if allowed_host else None,
        tls_cert=tls_cert,
        tls_key=tls_key,
        strict=strict or None,
    )
    raise typer.Exit(run(settings, browser=not no_browser and at_desktop()))
