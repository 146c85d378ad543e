"""``dynamic-observer go``: send the observer to a goal, on a running server."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
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

if TYPE_CHECKING:
    from app.client.goal_drive import Watch


def go(
    ahead_m: Annotated[float, typer.Argument(help="Metres ahead of the robot's current pose.")],
    left_m: Annotated[
        float, typer.Argument(help="Metres to its left; negative: to its right.")
    ] = 0.0,
    server: ServerAddress = DEFAULT_SERVER,
    token: Token = None,
    token_file: TokenFile = None,
    risk: Annotated[
        float | None,
        typer.Option(
            help="Accepted probability of a contact with tracked obstacles per metre. [default: "
            "the server's parameter navigation.risk_per_metre]"
        ),
    ] = None,
    takeover: Takeover = False,
    as_json: Annotated[
        bool,
        typer.Option("--json", help="Print a summary of the drive as one JSON object on stdout."),
    ] = False,
) -> None:
    """Send the observer to a goal.

    It stops when this command ends. The robot drives around obstacles, and the guard limits it
    as when it is driven by hand. The command takes control of the observer, arms it, and
    confirms ten times a second that you are present: Ctrl-C, a closed terminal or a lost
    connection stop the robot within 300 ms. This assists attentive operators and was tested in
    simulation only; keep the robot's own switch within reach. Put two dashes before a negative
    number, as in: go -- 2.0 -0.5
    """
    from app.client.goal_drive import GoalDrive, GoalRequest
    from app.client.server_api import ServerApi, read_token

    api = ServerApi(server, read_token(token, token_file))
    try:
        with ended_by_signals(), _shown() as watch:
            drive = GoalDrive(api, GoalRequest(ahead_m, left_m, risk, takeover), watch)
            with summarized(drive.summary, "reached", as_json=as_json):
                drive.run()
    finally:
        api.close()
    typer.echo("the goal is reached; the robot is disarmed", err=True)


@contextmanager
def _shown() -> Iterator[Watch]:
    """Show the drive on stderr: the distance left on a terminal, and each new sentence."""
    shown: str | None = None
    with drawn_progress() as progress:
        task = progress.add_task("starting", total=None)

        def watch(goal: JsonObject) -> None:
            nonlocal shown
            distance, sentence = goal["distance_m"], goal["sentence"]
            if _without_numbers(sentence) != shown:
                shown = _without_numbers(sentence)
                progress.console.print(sentence, markup=False, highlight=False)
            words = "place unknown" if distance is None else f"{distance:.1f} m left"
            progress.update(task, description=words)

        yield watch


def _without_numbers(sentence: str) -> str:
    return "".join(each for each in sentence if not each.isdigit())
