"""Options for reading a truth file and assigning its bodies, for all commands that take one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from observer.errors import InputError

if TYPE_CHECKING:
    from observer.geometry import Pose
    from observer.truth.alignment.choices import BodyRole

# Same as ``observer.truth.files.angles.AngleReading``, whose import takes half a second.
AngleReading = Literal["helical", "euler_xyz"]
RateOption = Annotated[
    float | None,
    typer.Option(help="Samples per second of a file that does not tell (Tracker 3.5)."),
]
AnglesOption = Annotated[
    AngleReading | None,
    typer.Option(help="How Vicon's three angles are meant, where that cannot be found out."),
]
ObserverOption = Annotated[
    str | None,
    typer.Option(metavar="BODY", help="The body that carries the cameras; else found out."),
]
IgnoreOption = Annotated[
    list[str] | None,
    typer.Option(metavar="BODY", help="A body to leave out; may be given more than once."),
]
CameraOnBodyOption = Annotated[
    str | None,
    typer.Option(
        metavar="X,Y,Z,PAN,TILT,ROLL",
        help="Where the left camera sits on the observer's body, metres and degrees in the "
        "body's axes, as in 0.12,0.06,0.25,0,10,0; else found out, or as the rig says.",
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
