"""Options of all commands that read a ground-truth file and assign its bodies."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated

import typer

from observer.errors import InputError
from observer.truth.files.known import AngleReading

if TYPE_CHECKING:
    from observer.geometry import Pose
    from observer.truth.alignment.choices import BodyRole

RateOption = Annotated[
    float | None,
    typer.Option(help="Frame rate of a file that does not state it (Tracker 3.5)."),
]
AnglesOption = Annotated[
    AngleReading | None,
    typer.Option(help="Meaning of Vicon's three angles, if it cannot be detected."),
]
ObserverOption = Annotated[
    str | None,
    typer.Option(metavar="BODY", help="The body that carries the cameras. [default: detected]"),
]
IgnoreOption = Annotated[
    list[str] | None,
    typer.Option(metavar="BODY", help="A body to ignore; repeatable."),
]
CameraOnBodyOption = Annotated[
    str | None,
    typer.Option(
        metavar="X,Y,Z,PAN,TILT,ROLL",
        help="Position of the left camera on the observer's body, metres and degrees in the axes "
        "of the body, for example 0.12,0.06,0.25,0,10,0. [default: estimated, or from the rig]",
    ),
]


def body_roles(observer: str | None, ignored: Sequence[str]) -> dict[str, BodyRole]:
    """Return the roles in the form that ``AlignmentChoices.roles`` takes.

    Raises:
        InputError: the observer is also on the list of ignored bodies.
    """
    roles: dict[str, BodyRole] = dict.fromkeys(ignored, "ignored")
    if observer is not None:
        if observer in roles:
            raise InputError(f"{observer} cannot be both --observer and --ignore; name it once")
        roles[observer] = "observer"
    return roles


def body_camera(camera_on_body: str | None) -> Pose | None:
    """Return ``T_body_camera`` in the form that ``AlignmentChoices`` takes.

    Raises:
        TruthError: its format is wrong.
    """
    from observer.truth.alignment.camera_on_body import CameraOnBody

    return None if camera_on_body is None else CameraOnBody.parse(camera_on_body).T_body_camera
