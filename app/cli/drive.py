"""``dynamic-observer drive``: play a programme of timed velocities on a running server."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from app.cli.progress import drawn_progress
from app.cli.running_server import (
    DEFAULT_SERVER,
    ServerAddress,
    Takeover,
    Token,
    TokenFile,
    ended_by_signals,
    summarized,
)
from app.contract.values import JsonObject
from observer.errors import InputError

if TYPE_CHECKING:
    from app.client.profile_drive import Watch
    from app.client.server_api import ServerApi
    from observer.motion_profiles.profile import MotionProfile


def drive(
    programme: Annotated[
        str | None,
        typer.Argument(help="Name of a programme, or a YAML file, which the server then stores."),
    ] = None,
    server: ServerAddress = DEFAULT_SERVER,
    token: Token = None,
    token_file: TokenFile = None,
    repeat: Annotated[int, typer.Option(help="Number of repetitions.")] = 1,
    reverse: Annotated[
        bool,
        typer.Option("--reverse", help="Drive the path in reverse, back to its starting point."),
    ] = False,
    takeover: Takeover = False,
    stop: Annotated[
        bool, typer.Option("--stop", help="Stop all robots and do nothing else.")
    ] = False,
    as_json: Annotated[
        bool,
        typer.Option("--json", help="Print a summary of the drive as one JSON object on stdout."),
    ] = False,
) -> None:
    """Run a programme on the robots of a server.

    The robots stop when this command ends. It takes control of the robots that the programme
    moves, arms them, and confirms ten times a second that you are present: Ctrl-C, a closed
    terminal or a lost connection stop the robots within 300 ms. This is a software stop, not a
    substitute for an emergency stop: keep the robots' own switch within reach.
    """
    from app.client.server_api import ServerApi, read_token

    if stop == (programme is not None):
        raise InputError("name a programme to run, or give only --stop")
    api = ServerApi(server, read_token(token, token_file))
    try:
        if stop:
            api.post("robots", "stop")
            typer.echo(
                "all robots are stopped; reset the stop on the page before driving again", err=True
            )
            return
        assert programme is not None
        with ended_by_signals():
            _play(api, programme, repeat, reverse, takeover, as_json)
    finally:
        api.close()


def programmes(
    name: Annotated[
        str | None,
        typer.Argument(help="Print the YAML of this programme, as a starting point for your own."),
    ] = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print one JSON list instead of text.")
    ] = False,
) -> None:
    """List the built-in programmes; a server may have more."""
    from observer.motion_profiles.library import library_text, load_profile, profile_names
    from observer.motion_profiles.playing import duration_s

    if name is not None:
        typer.echo(library_text(name), nl=False)
        return
    known = [load_profile(each) for each in profile_names()]
    if as_json:
        listed = [
            {
                "name": each.name,
                "title": each.title,
                "help": each.help,
                "roles": each.roles,
                "duration_s": duration_s(each),
            }
            for each in known
        ]
        typer.echo(json.dumps(listed, indent=2, allow_nan=False))
        return
    for each in known:
        typer.echo(f"{each.name}   ({duration_s(each):g} s, {' and '.join(each.roles)})")
        typer.echo(f"    {each.help}")


def _play(
    api: ServerApi, programme: str, repeat: int, reverse: bool, takeover: bool, as_json: bool
) -> None:
    from app.client.profile_drive import PlayRequest, ProfileDrive
    from observer.motion_profiles.playing import duration_s

    chosen = _chosen(api, programme)
    request = PlayRequest(
        chosen.name, chosen.roles, duration_s(chosen, repeat), repeat, reverse, takeover
    )
    with _shown(request.duration_s, repeat, chosen.roles) as watch:
        played = ProfileDrive(api, request, watch)
        with summarized(played.summary, "finished", as_json=as_json):
            played.run()
    typer.echo(f"{chosen.name} is finished; the robots are disarmed", err=True)


def _chosen(api: ServerApi, programme: str) -> MotionProfile:
    """Return the programme as the server knows it; upload it first if it is a file."""
    from observer.motion_profiles.library import read_profile
    from observer.motion_profiles.profile_file import profile_from_text, profile_text

    if "/" in programme or Path(programme).suffix in (".yaml", ".yml"):
        chosen = read_profile(Path(programme))
        api.post("programmes", body={"text": profile_text(chosen)})
        return chosen
    answer = api.get("programmes", programme)
    return profile_from_text(answer["text"], programme)


@contextmanager
def _shown(duration_s: float, repeat: int, roles: Sequence[str]) -> Iterator[Watch]:
    """Show the drive on stderr: a bar on a terminal, and each limiting reason once."""
    shown: set[str] = set()
    with drawn_progress() as progress:
        task = progress.add_task("starting", total=duration_s)

        def watch(playing: JsonObject, robots: JsonObject) -> None:
            words = ["gesture"] if playing["phase"] == "gesture" else []
            if repeat > 1:
                words.append(f"round {playing['round']} of {repeat}")
            for role in roles:
                facts = robots.get(role) or {}
                speed = (facts.get("report") or {}).get("speed_mps")
                words.append(f"{role} {'-' if speed is None else f'{speed:.2f} m/s'}")
                why = f"{role}: {facts['why']}" if facts.get("why") else None
                if why is not None and why not in shown:
                    shown.add(why)
                    progress.console.print(why, markup=False, highlight=False)
            progress.update(task, completed=playing["elapsed_s"], description=", ".join(words))

        yield watch
