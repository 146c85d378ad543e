"""``dynamic-observer systemd-unit``: print a unit with which systemd starts the server."""

from __future__ import annotations

import getpass
import sys
from collections.abc import Iterator, Sequence
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
from app.cli.storage_options import DataOption, chosen_settings
from app.settings import ENVIRONMENT_PREFIX, Settings
from observer.errors import InputError

# Groups whose members may use cameras and serial ports, if the system has them.
_DEVICE_GROUPS = ("video", "dialout")
# Settings that are options of ``serve`` in the unit.
_ON_COMMAND_LINE = {
    "source", "host", "port", "data", "token_file", "allowed_hosts", "tls_cert", "tls_key", "truth",
    "strict",
}  # fmt: skip
_FILE = "/etc/systemd/system/dynamic-observer.service"


def systemd_unit(
    source: Annotated[
        str | None, typer.Argument(help="What the server opens first. [default: simulated:lab]")
    ] = None,
    host: HostOption = None,
    port: PortOption = None,
    data: DataOption = None,
    token_file: Annotated[
        Path | None,
        typer.Option(
            help="Keeps the links valid across restarts. [default: a file in the data folder]"
        ),
    ] = None,
    allowed_host: AllowedHostOption = None,
    tls_cert: TlsCertOption = None,
    tls_key: TlsKeyOption = None,
    user: Annotated[
        str | None, typer.Option(help="User that runs the server. [default: you]")
    ] = None,
) -> None:
    """Print a systemd unit for this installation.

    The unit starts its server at boot.
    """
    if user is not None and data is None:
        data = _data_folder_of(user)
    settings = chosen_settings(
        source=source, host=host, port=port, data=data, token_file=token_file,
        allowed_hosts=tuple(allowed_host) if allowed_host else None,
        tls_cert=tls_cert, tls_key=tls_key,
    )  # fmt: skip
    typer.echo("\n".join(_lines(settings, user or getpass.getuser())))


def _data_folder_of(user: str) -> Path:
    """Return the folder in which ``serve`` keeps another user's data."""
    import pwd

    try:
        home = pwd.getpwnam(user).pw_dir
    except (KeyError, ValueError):
        raise InputError(
            f"there is no user {user[:40]!r} on this computer; give one that exists, or the data "
            f"folder with --data"
        ) from None
    return Path(home) / ".local" / "share" / "dynamic-observer"


def _lines(settings: Settings, user: str) -> Iterator[str]:
    if not user.isprintable() or any(c.isspace() or c in "%:/" for c in user) or not user:
        raise InputError(f"{user[:40]!r} is not a user name; give one as whoami prints it")
    yield f"# To install it, write this text to {_FILE}, then:"
    yield "#   sudo systemctl daemon-reload"
    yield "#   sudo systemctl enable --now dynamic-observer"
    yield f"# The links, as {user}: dynamic-observer link --data {settings.data}"
    yield "# The log: journalctl -u dynamic-observer"
    yield ""
    yield "[Unit]"
    yield "Description=Dynamic Observer"
    yield "Wants=network-online.target"
    yield "After=network-online.target"
    yield ""
    yield "[Service]"
    yield f"User={user}"
    groups = _device_groups()
    if groups:
        yield f"SupplementaryGroups={' '.join(groups)}"
    for assignment in _environment(settings):
        yield f"Environment={_quoted(assignment)}"
    # In command lines alone, $ begins a variable.
    yield f"ExecStart={' '.join(_quoted(w).replace('$', '$$') for w in _command(settings))}"
    yield "Restart=on-failure"
    yield "RestartSec=2"
    # The robots stop first, the run is closed, the engine ends.
    yield "TimeoutStopSec=15"
    # The drive loop needs real-time priority; a viewer takes several connections.
    yield "LimitRTPRIO=1"
    yield "LimitNOFILE=16384"
    yield "NoNewPrivileges=yes"
    yield "ProtectSystem=full"
    yield ""
    yield "[Install]"
    yield "WantedBy=multi-user.target"


def _command(settings: Settings) -> Iterator[str]:
    """Yield the words of the command line that serves with these settings."""
    script = Path(sys.executable).with_name("dynamic-observer")
    yield from (str(script),) if script.is_file() else (sys.executable, "-m", "app.cli")
    yield from ("serve", settings.source, "--no-browser")
    yield from ("--host", settings.host, "--port", str(settings.port))
    yield from ("--data", str(settings.data))
    yield from ("--token-file", str(_absolute(settings.token_file or settings.data / "token")))
    for name in settings.allowed_hosts:
        yield from ("--allowed-host", name)
    if settings.tls_cert is not None and settings.tls_key is not None:
        yield from ("--tls-cert", str(_absolute(settings.tls_cert)))
        yield from ("--tls-key", str(_absolute(settings.tls_key)))
    if settings.truth is not None:
        yield from ("--truth", settings.truth)
    if settings.strict:
        yield "--strict"


def _environment(settings: Settings) -> Iterator[str]:
    """Yield an assignment for each given setting that is not on the command line.

    The database is among them: everyone can read command lines, and its URL may hold a password.
    """
    for name in sorted(settings.model_fields_set - _ON_COMMAND_LINE):
        value = getattr(settings, name)
        if value is not None:
            yield f"{ENVIRONMENT_PREFIX}{name.upper()}={value}"


def _absolute(path: Path) -> Path:
    return path.expanduser().absolute()


def _quoted(word: str) -> str:
    """Quote a word of a setting: systemd.syntax(7), Quoting; % begins a specifier."""
    if not word.isprintable():
        raise InputError(f"a systemd unit cannot hold {word[:80]!r}; give it another name")
    escaped = word.replace("\\", "\\\\").replace("%", "%%")
    if any(c in word for c in " '\";\\") or not word:
        escaped = escaped.replace('"', '\\"')
        return f'"{escaped}"'
    return escaped


def _device_groups() -> Sequence[str]:
    try:
        import grp
    except ImportError:
        return ()
    present = {group.gr_name for group in grp.getgrall()}
    return tuple(name for name in _DEVICE_GROUPS if name in present)
