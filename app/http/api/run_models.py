"""What goes in and out of the routes of runs: kept, found again, compared with truth, drawn."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field

from app.http.api.robot_models import ProgrammeStart
from app.http.api.values import Changes, Finite, Identifier, In, Name, Spec, Tag, Text
from observer.truth.alignment.camera_on_body import FARTHEST_M, LARGEST_DEG

Track = Annotated[str, Field(pattern=r"^\d{1,9}[/:]\d{1,9}$")]
Body = Annotated[
    str, Field(strict=True, min_length=1, max_length=200, pattern=r"^[^\x00-\x1f\x7f]+$")
]


class RunStart(In):
    name: Name | None = None
    source: Spec | None = Field(None, description="None: what is open.")
    calibration: Identifier | None = Field(None, description="None: the source's own.")
    preset: Name | None = None
    parameters: Changes = Field(default_factory=dict, description="Made to the preset, if any.")
    programme: ProgrammeStart | None = Field(
        None, description="Driven from the run's beginning, and ended with it."
    )
    record: Literal["none", "jpeg", "lossless"] = Field(
        "jpeg", description="Which images its recording keeps; all else is always recorded."
    )


class RunChange(In):
    """What is given is changed."""

    name: Name | None = None
    tags: Annotated[list[Tag], Field(max_length=50)] | None = Field(
        None, description="All of them, in place of those before."
    )
    notes: Text | None = None


def _up_to(limit: float) -> Any:
    return Field(ge=-limit, le=limit)


class CameraOnBodyIn(In):
    """With all angles 0 it looks along the body's x and has the body's z above."""

    x_m: Annotated[Finite, _up_to(FARTHEST_M)]
    y_m: Annotated[Finite, _up_to(FARTHEST_M)]
    z_m: Annotated[Finite, _up_to(FARTHEST_M)]
    pan_deg: Annotated[Finite, _up_to(LARGEST_DEG["pan_deg"])]
    tilt_deg: Annotated[Finite, _up_to(LARGEST_DEG["tilt_deg"])]
    roll_deg: Annotated[Finite, _up_to(LARGEST_DEG["roll_deg"])]


class AlignStart(In):
    truth_id: Name | None = Field(
        None, description="None: the motion capture that was received live with the run."
    )
    observer: Body | None = Field(
        None, description="The body that carries the cameras; none: it is found out."
    )
    ignore: Annotated[list[Body], Field(max_length=200)] = Field(
        default_factory=list, description="Bodies that are neither observer nor obstacle."
    )
    matches: Annotated[dict[Track, Body | None], Field(max_length=500)] = Field(
        default_factory=dict,
        description="Which body a track (SEGMENT/NUMBER) is, null: none of them.",
    )
    expected_offset_s: Annotated[Finite, Field(ge=-1e12, le=1e12)] | None = Field(
        None,
        description="To be added to truth's times, to within 2 s; for motions that repeat "
        "themselves. None: it is found out.",
    )
    camera_on_body: CameraOnBodyIn | None = Field(
        None,
        description="Of the left camera, on the observer's body. None: it is found out, or as the "
        "rig says.",
    )


class RerunStart(In):
    name: Name | None = None
    preset: Name | None = None
    parameters: Changes = Field(
        default_factory=dict, description="Made to the preset, or to the run's own."
    )
