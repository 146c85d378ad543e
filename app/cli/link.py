"""``dynamic-observer link``: the links of a running server, with a QR code for a phone."""

from __future__ import annotations

import io
import json
import sys
from typing import Annotated

import typer

from app.cli.storage_options import DataOption, chosen_settings

# White on black whatever the terminal's colours: not every phone reads an inverted code.
_WHITE_ON_BLACK = "\x1b[97;40m"
_PLAIN = "\x1b[0m"


def link(
    data: DataOption = None,
    read_only: Annotated[
        bool,
        typer.Option("--read-only", help="Show read-only links instead of operator links."),
    ] = False,
    qr: Annotated[bool, typer.Option("--qr/--no-qr", help="Draw a QR code.")] = True,
    as_json: Annotated[bool, typer.Option("--json", help="Print the links as JSON.")] = False,
) -> None:
    """Print links that sign in to a running server.

    The first one that works on other computers is also drawn as a QR code.
    """
    from app.addresses import ONLY_HERE, token_link
    from app.client.announced import find_server

    server = find_server(chosen_settings(data=data).data)
    address = server.address
    token = server.read_only_token if read_only else server.token
    others = [token_link(each, token) for each in address.elsewhere]
    here = token_link(address.here, token)
    if as_json:
        links = {"access": "read_only" if read_only else "operator", "here": here, "others": others}
        typer.echo(json.dumps(links, indent=2))
        return
    can = "watch and stop the robots" if read_only else "watch, change everything and drive"
    typer.echo(f"Anyone with one of these links can {can}.\n")
    for each in others:
        typer.echo(f"  {each}")
    typer.echo(f"  {here}   (this computer only)")
    if not others:
        typer.echo(f"\n{ONLY_HERE.format(host=server.host)}")
    elif qr:
        typer.echo(f"\n{_drawn(others[0])}")


def _drawn(text: str) -> str:
    """Return a QR code in block characters; empty if the output cannot encode them."""
    import segno

    file = io.StringIO()
    segno.make(text, error="l", micro=False).terminal(out=file, border=2, compact=True)
    lines = file.getvalue().splitlines()
    try:
        "".join(lines).encode(sys.stdout.encoding or "ascii")
    except UnicodeEncodeError:
        return ""
    if not sys.stdout.isatty():
        return "\n".join(lines)
    return "\n".join(f"{_WHITE_ON_BLACK}{line}{_PLAIN}" for line in lines)
