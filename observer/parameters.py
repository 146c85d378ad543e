"""Every tuning parameter, declared once: bounds, unit, label and help.

This declaration feeds the REST interface, the panel's form, the command line (``--set``) and the
documentation. Names are flat and dotted, as in ``ego_motion.ransac_threshold_px``.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from observer.errors import InputError, ParameterError
from observer.surf import surf_missing

ParameterValue = float | int | bool | str

# Of the camera's own motion; by which of them a parameter is used is said where it is declared.
MODELS = ("rigid", "homography", "affine", "one_camera")
# Those that follow points over time, and those that draw samples of matches.
_FOLLOWING: tuple[str, ...] = ("rigid", "one_camera")
_SAMPLING: tuple[str, ...] = ("rigid", "homography", "affine")
_PLANAR: tuple[str, ...] = ("homography", "affine")


def _number(
    default: float,
    *,
    ge: float,
    le: float,
    unit: str,
    title: str,
    help: str,
    step: float,
    models: tuple[str, ...] | None = None,
) -> Any:
    """A number; ``models`` where it acts with fewer models than its group."""
    extra: dict[str, Any] = {"unit": unit, "step": step}
    if models is not None:
        extra["models"] = list(models)
    return Field(
        default=default,
        ge=ge,
        le=le,
        title=title,
        description=help,
        json_schema_extra=extra,
    )


def _choice(default: Any, *, title: str, help: str) -> Any:
    return Field(default=default, title=title, description=help, json_schema_extra={"unit": ""})


# bool is no number here, and neither are NaN and the infinities.
Real = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Whole = Annotated[int, Field(strict=True)]
Flag = Annotated[bool, Field(strict=True)]


class _Stage(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")

    # With which ego_motion.model the group acts.
    models: ClassVar[tuple[str, ...]] = MODELS


class EgoMotionParameters(_Stage):
    """The camera's own motion, by RANSAC; the model decides how moving obstacles are found."""

    model: Literal["rigid", "homography", "affine", "one_camera"] = _choice(
        "rigid", title="Model",
        help="rigid is the motion in space, by stereo, and tells motion from parallax. The planar "
        "ones map image to image: affine has six parameters and is the paper's, homography has "
        "eight and also fits a plane seen in perspective. one_camera looks at the left image "
        "alone. Between rigid, one_camera and a planar one the next frame begins a new segment.",
    )
    ransac_threshold_px: Real = _number(
        1.2, ge=0.1, le=20.0, unit="px", step=0.1, title="RANSAC threshold",
        help="A match counts as background if the model explains it within this distance.",
        models=_SAMPLING,
    )
    ransac_iterations: Whole = _number(
        500, ge=10, le=10000, unit="iterations", step=10, title="RANSAC iterations",
        help="Most samples tried. Fewer are faster and may miss the background.",
        models=_SAMPLING,
    )
    min_inliers: Whole = _number(
        12, ge=4, le=500, unit="matches", step=1, title="Fewest inliers",
        help="With fewer background matches the camera's motion counts as lost.",
    )
    shared_error: Real = _number(
        0.02, ge=0.0, le=1.0, unit="", step=0.01, title="Shared error",
        help="Share of the noise that points have in common.", models=_FOLLOWING,
    )
    recover_frames: Whole = _number(
        5, ge=0, le=60, unit="frames", step=1, title="Recover within",
        help="While the camera's motion is lost, frames are compared with the last good one for "
        "this long; then all tracks end and a new segment begins.",
    )


class FollowingParameters(_Stage):
    """Following points from frame to frame, in both cameras or in one."""

    models = _FOLLOWING

    spacing_px: Whole = _number(
        18, ge=6, le=64, unit="px", step=1, title="Spacing",
        help="One point is followed in each square of this side.",
    )
    window_px: Whole = _number(
        13, ge=5, le=51, unit="px", step=2, title="Window",
        help="Side of the Lucas-Kanade window.",
    )
    min_texture: Real = _number(
        1.6, ge=0.0, le=20.0, unit="grey levels/px", step=0.1, title="Least texture",
        help="Points whose surroundings vary less than this in any one direction are left out.",
    )
    max_error: Real = _number(
        20.0, ge=1.0, le=100.0, unit="grey levels", step=1.0, title="Largest match error",
        help="Points whose surroundings differ more than this on average are left out.",
    )
    back_check_px: Real = _number(
        0.5, ge=0.05, le=10.0, unit="px", step=0.05, title="Backward check",
        help="A point followed forth and back must return within this distance.",
    )
    circle_px: Real = _number(
        1.0, ge=0.05, le=10.0, unit="px", step=0.05, title="Circle check",
        help="The two ways from the left image at t to the right one at t+dt must meet.",
    )
    row_px: Real = _number(
        3.0, ge=0.5, le=20.0, unit="px", step=0.5, title="Row tolerance",
        help="How far a match in the right image may lie off the row.",
    )
    noise_factor: Real = _number(
        1.5, ge=0.1, le=10.0, unit="", step=0.1, title="Noise factor",
        help="The noise of a followed position, relative to what texture and grey levels promise.",
    )
    noise_floor_px: Real = _number(
        0.06, ge=0.0, le=3.0, unit="px", step=0.01, title="Noise floor",
        help="Noise of a followed position that does not depend on texture.",
    )
    growth_noise: Real = _number(
        0.3, ge=0.0, le=2.0, unit="", step=0.05, title="Growth noise",
        help="Noise of a followed position by the growing or shrinking of its surroundings, as a "
        "share of how far they grow.",
    )
    skew_sigma_s: Real = _number(
        0.001, ge=0.0, le=0.1, unit="s", step=0.0005, title="Skew noise",
        help="One standard deviation of the time between the exposures of free-running cameras.",
    )


class EvidenceParameters(_Stage):
    """Which followed points move."""

    models = _FOLLOWING

    memory_s: Real = _number(
        0.5, ge=0.05, le=10.0, unit="s", step=0.05, title="Memory",
        help="How long sightings of a point count.",
    )
    radius_px: Real = _number(
        26.0, ge=4.0, le=200.0, unit="px", step=1.0, title="Neighbourhood",
        help="Points nearer than this, in the image and alike in depth, are judged together.",
    )
    false_alarms_per_frame: Real = _number(
        0.001, ge=1e-9, le=1.0, unit="", step=1e-9, title="False alarms",
        help="Declared rate of false alarms per frame over all points.",
    )
    shared_error: Real = _number(
        0.1, ge=0.0, le=1.0, unit="", step=0.05, title="Shared error",
        help="Share of the noise that neighbouring points have in common.",
    )
    disparity_bias_px: Real = _number(
        0.1, ge=0.0, le=5.0, unit="px", step=0.05, title="Disparity bias",
        help="One standard deviation of the error of a disparity that lasts from frame to frame, "
        "by calibration or by what is beside the point; it makes what is far from a fast camera "
        "seem to move.",
    )
    least_noise: Real = _number(
        1.0, ge=0.1, le=10.0, unit="", step=0.1, title="Least noise",
        help="The noise of the sightings is learnt from the background; it is taken for no less "
        "than this share of what texture and grey levels promise.",
    )
    min_sightings: Whole = _number(
        3, ge=2, le=30, unit="frames", step=1, title="Fewest sightings",
        help="Points seen in fewer frames are not judged.",
    )
    min_points: Whole = _number(
        3, ge=1, le=50, unit="points", step=1, title="Fewest points",
        help="Fewer neighbours that move alike are no evidence.",
    )


class ObstacleParameters(_Stage):
    """Obstacles as bodies over time."""

    models = _FOLLOWING

    acceleration_px: Real = _number(
        200.0, ge=1.0, le=5000.0, unit="px/s^2", step=10.0, title="Acceleration",
        help="One standard deviation of how strongly a manoeuvring obstacle accelerates.",
    )
    shared_error: Real = _number(
        0.1, ge=0.0, le=1.0, unit="", step=0.05, title="Shared error",
        help="Share of the noise that the points of an obstacle have in common.",
    )
    min_points: Whole = _number(
        3, ge=1, le=50, unit="points", step=1, title="Fewest points",
        help="An obstacle seen by fewer points is not seen.",
    )
    margin: Real = _number(
        0.15, ge=0.0, le=2.0, unit="", step=0.05, title="Margin",
        help="Points join an obstacle up to this share of its size outside its box.",
    )
    confirm_sigmas: Real = _number(
        5.0, ge=0.5, le=50.0, unit="standard deviations", step=0.5, title="Confirm above",
        help="How significant its velocity must be.",
    )
    confirm_hits: Whole = _number(
        3, ge=1, le=30, unit="frames", step=1, title="Confirm after",
        help="For how many frames.",
    )
    coast_s: Real = _number(
        1.5, ge=0.0, le=10.0, unit="s", step=0.1, title="Coast for",
        help="An obstacle that is not seen any more is kept for this long.",
    )
    stopped_below_mps: Real = _number(
        0.06, ge=0.0, le=5.0, unit="m/s", step=0.01, title="Stopped below",
        help="An obstacle slower than this counts as stopped.",
    )


class StereoParameters(_Stage):
    """Disparity and depth: of the planar models and, with every model, of the cloud that is
    shown. Rigid measures the disparity of its points alone, up to the largest one."""

    matcher: Literal["bm", "sgbm"] = _choice(
        "sgbm", title="Matcher",
        help="bm is block matching, fast and sparse; sgbm is semi-global matching, denser.",
    )
    max_disparity_px: Whole = _number(
        96, ge=16, le=256, unit="px", step=16, title="Largest disparity",
        help="Sets the nearest depth that can be measured; rounded up to a multiple of 16.",
    )
    block_px: Whole = _number(
        7, ge=5, le=31, unit="px", step=2, title="Block size",
        help="Side of the compared block; even values are rounded up.",
    )
    uniqueness_percent: Whole = _number(
        8, ge=0, le=50, unit="%", step=1, title="Uniqueness",
        help="How much better than the second best the best disparity must be.",
    )
    min_depth_m: Real = _number(
        0.2, ge=0.05, le=10.0, unit="m", step=0.05, title="Nearest depth",
        help="Points nearer than this are left out.",
    )
    max_depth_m: Real = _number(
        30.0, ge=0.5, le=200.0, unit="m", step=0.5, title="Farthest depth",
        help="Points farther than this are left out.",
    )


class FramesParameters(_Stage):
    """Planar models: which two frames are compared. Rigid follows from frame to frame."""

    models = _PLANAR

    interval: Whole = _number(
        2, ge=1, le=10, unit="frames", step=1, title="Pair distance",
        help="How many frames lie between t and t+dt. A longer distance makes slow obstacles "
        "visible and parallax worse.",
    )


class FeaturesParameters(_Stage):
    """Planar models: feature points on the image at t."""

    models = _PLANAR

    detector: Literal[
        "fast", "shi_tomasi", "harris", "brisk", "kaze", "mser", "orb", "surf"
    ] = _choice(
        "fast", title="Detector",
        help="Which feature points are used. The paper uses FAST; minimum eigenvalue is "
        "shi_tomasi and Harris-Stephens is harris. surf is installed by: "
        "pip install 'dynamic-observer[surf]'.",
    )
    max_count: Whole = _number(
        600, ge=50, le=4000, unit="points", step=50, title="Most features",
        help="The strongest points kept, spread over the image by the grid.",
    )
    grid_cells: Whole = _number(
        8, ge=1, le=32, unit="cells", step=1, title="Grid columns",
        help="The image is divided into this many columns of square cells, each with an equal "
        "share of the features; 1 keeps the strongest wherever they are.",
    )
    fast_threshold: Whole = _number(
        12, ge=2, le=100, unit="grey levels", step=1, title="FAST threshold",
        help="Least difference between a corner and the circle around it.",
    )
    quality: Real = _number(
        0.01, ge=0.0005, le=0.5, unit="", step=0.0005, title="Corner quality",
        help="Least corner measure of shi_tomasi and harris, relative to the strongest corner.",
    )


class MatchingParameters(_Stage):
    """Planar models: matching features between t and t+dt."""

    models = _PLANAR

    method: Literal["descriptor", "klt"] = _choice(
        "klt", title="Matching",
        help="descriptor compares feature values (ORB, or the detector's own); klt tracks each "
        "feature by Lucas-Kanade.",
    )
    ratio: Real = _number(
        0.85, ge=0.3, le=1.0, unit="", step=0.01, title="Ratio test",
        help="A match is kept if its distance is below this share of the second best one's.",
    )
    cross_check: Flag = _choice(
        True, title="Cross check",
        help="Keep only matches that are the best in both directions; with klt, track back.",
    )
    max_shift: Real = _number(
        0.25, ge=0.01, le=1.0, unit="image widths", step=0.01, title="Largest shift",
        help="Matches that move further than this between the two images are refused.",
    )


class OneCameraParameters(_Stage):
    """Depth from the left image alone, by travel and by where things touch the floor (one_camera).

    ``following.*`` and ``evidence.false_alarms_per_frame`` act here, too.
    """

    models = ("one_camera",)

    height_m: Real = _number(
        0.0, ge=0.0, le=100.0, unit="m", step=0.01, title="Height",
        help="Of the camera above the floor; 0 takes height and tilt as the source's rig tells "
        "them.",
    )
    tilt_deg: Real = _number(
        0.0, ge=-60.0, le=60.0, unit="deg", step=0.5, title="Tilt",
        help="How far the camera looks down; counts where one_camera.height_m is given.",
    )
    height_sigma: Real = _number(
        0.02, ge=0.0, le=0.5, unit="", step=0.005, title="Height uncertainty",
        help="One standard deviation of the height, as a share of it; sets the stated uncertainty.",
    )
    tilt_sigma_deg: Real = _number(
        0.2, ge=0.0, le=10.0, unit="deg", step=0.05, title="Tilt uncertainty",
        help="One standard deviation of the tilt; sets the stated uncertainty.",
    )
    odometry_sigma: Real = _number(
        0.02, ge=0.001, le=0.5, unit="", step=0.005, title="Odometry uncertainty",
        help="One standard deviation of driven ways, as a share of them.",
    )
    parallax_deg: Real = _number(
        0.6, ge=0.1, le=10.0, unit="deg", step=0.1, title="Parallax to start",
        help="Without odometry, depth is first told once points have shifted this far by travel "
        "alone.",
    )
    memory_s: Real = _number(
        1.0, ge=0.2, le=10.0, unit="s", step=0.1, title="Memory",
        help="Over how long a point must look as if it stood.",
    )
    farthest_m: Real = _number(
        6.0, ge=0.5, le=100.0, unit="m", step=0.5, title="Farthest floor",
        help="Obstacles that touch the floor farther away than this are left out.",
    )
    foot_sigma_px: Real = _number(
        2.0, ge=0.2, le=20.0, unit="px", step=0.1, title="Foot noise",
        help="One standard deviation of where an obstacle is seen to touch the floor.",
    )
    acceleration: Real = _number(
        0.4, ge=0.01, le=20.0, unit="m/s^2", step=0.05, title="Acceleration",
        help="One standard deviation of how strongly an obstacle accelerates.",
    )
    confirm_sigmas: Real = _number(
        4.0, ge=0.5, le=50.0, unit="standard deviations", step=0.5, title="Confirm above",
        help="How significant its velocity over the floor must be.",
    )


class FlowParameters(_Stage):
    """Planar models: residual motion by Lucas-Kanade between the image at t and the transformed
    one."""

    models = _PLANAR

    window_px: Whole = _number(
        15, ge=5, le=51, unit="px", step=2, title="Window",
        help="Side of the Lucas-Kanade window.",
    )
    pyramid_levels: Whole = _number(
        3, ge=0, le=6, unit="levels", step=1, title="Pyramid levels",
        help="Each level doubles the motion that can be followed.",
    )
    residual_threshold_px: Real = _number(
        2.0, ge=0.1, le=30.0, unit="px", step=0.1, title="Flow threshold",
        help="A feature whose residual motion exceeds this counts as dynamic.",
    )
    min_texture: Real = _number(
        1.6, ge=0.0, le=20.0, unit="grey levels/px", step=0.1, title="Least texture",
        help="Features whose surroundings vary less than this in any one direction are left out: "
        "along a straight edge the flow slides.",
    )
    max_error: Real = _number(
        20.0, ge=1.0, le=100.0, unit="grey levels", step=1.0, title="Largest match error",
        help="Features whose surroundings differ more than this on average are left out.",
    )
    match_brightness: Flag = _choice(
        True, title="Match brightness",
        help="Scale the second image to the brightness of the first, against flickering light "
        "and automatic exposure.",
    )
    back_check_px: Real = _number(
        0.7, ge=0.05, le=10.0, unit="px", step=0.05, title="Backward check",
        help="A feature tracked forth and back must return within this distance.",
    )


class MotionParameters(_Stage):
    """Planar models: from two positions of a dynamic feature to a velocity."""

    models = _PLANAR

    max_speed_mps: Real = _number(
        40.0, ge=0.1, le=100.0, unit="m/s", step=0.1, title="Highest speed",
        help="Faster displacements are taken for stereo errors and left out.",
    )
    disparity_sigma_px: Real = _number(
        0.2, ge=0.05, le=3.0, unit="px", step=0.05, title="Disparity noise",
        help="One standard deviation of a measured disparity; sets the stated uncertainty.",
    )
    pixel_sigma_px: Real = _number(
        0.3, ge=0.05, le=3.0, unit="px", step=0.05, title="Flow noise",
        help="One standard deviation of a tracked position; sets the stated uncertainty.",
    )
    shared_error: Real = _number(
        0.15, ge=0.0, le=1.0, unit="", step=0.05, title="Shared error",
        help="Share of the noise that neighbouring points have in common and that averaging "
        "cannot reduce; sets the stated uncertainty.",
    )
    turn_sigma_radps: Real = _number(
        0.4, ge=0.0, le=5.0, unit="rad/s", step=0.1, title="Unseen turning",
        help="One standard deviation of how fast an obstacle turns: the side that is seen then "
        "moves otherwise than the centre; sets the stated uncertainty.",
    )
    min_significance: Real = _number(
        3.0, ge=0.0, le=20.0, unit="standard deviations", step=0.5, title="Significance",
        help="Obstacles whose velocity stands out less than this against all known errors, "
        "parallax among them, are left out; 0 keeps all, as the paper does.",
    )


class ClusteringParameters(_Stage):
    """Planar models: dynamic points that belong together."""

    models = _PLANAR

    radius_m: Real = _number(
        0.3, ge=0.02, le=5.0, unit="m", step=0.01, title="Neighbour radius",
        help="Dynamic points nearer than this, after allowing for depth noise, are one obstacle.",
    )
    min_points: Whole = _number(
        4, ge=1, le=100, unit="points", step=1, title="Fewest points",
        help="Smaller groups are left out.",
    )


class TrackingParameters(_Stage):
    """Planar models: identities over time."""

    models = _PLANAR

    gate: Real = _number(
        0.6, ge=0.05, le=10.0, unit="m", step=0.05, title="Gate",
        help="A cluster farther than this from where a track is expected starts a new track.",
    )
    confirm_hits: Whole = _number(
        3, ge=1, le=30, unit="frames", step=1, title="Confirm after",
        help="A track is reported after this many sightings.",
    )
    coast_frames: Whole = _number(
        5, ge=0, le=60, unit="frames", step=1, title="Coast for",
        help="A track that is not seen any more is kept for this many frames.",
    )


class Parameters(_Stage):
    """All parameters of the method, one group per stage."""

    ego_motion: EgoMotionParameters = EgoMotionParameters()
    following: FollowingParameters = FollowingParameters()
    evidence: EvidenceParameters = EvidenceParameters()
    obstacles: ObstacleParameters = ObstacleParameters()
    one_camera: OneCameraParameters = OneCameraParameters()
    stereo: StereoParameters = StereoParameters()
    frames: FramesParameters = FramesParameters()
    features: FeaturesParameters = FeaturesParameters()
    matching: MatchingParameters = MatchingParameters()
    flow: FlowParameters = FlowParameters()
    motion: MotionParameters = MotionParameters()
    clustering: ClusteringParameters = ClusteringParameters()
    tracking: TrackingParameters = TrackingParameters()

    def flat(self) -> dict[str, ParameterValue]:
        """All values by dotted name, in the order of declaration."""
        return {
            f"{group}.{name}": value
            for group, values in self.model_dump().items()
            for name, value in values.items()
        }

    def changed(self, changes: Mapping[str, Any]) -> Self:
        """A copy with some values replaced, all or nothing.

        Args:
            changes: dotted name -> new value.

        Raises:
            ParameterError: naming every refused field and its range, or the extra that it needs
                and that is not installed; nothing is changed.
        """
        known = self.flat()
        problems = {
            name: f"there is no such parameter{_did_you_mean(name, known)}"
            for name in changes
            if name not in known
        }
        nested: dict[str, dict[str, Any]] = self.model_dump()
        for dotted, value in changes.items():
            if dotted in known:
                group, name = dotted.split(".")
                nested[group][name] = value
        try:
            result = type(self).model_validate(nested)
        except ValidationError as error:
            for detail in error.errors(include_url=False, include_context=False):
                dotted = ".".join(str(part) for part in detail["loc"][:2])
                problems[dotted] = describe_range(dotted)
        if nested["features"]["detector"] == "surf" and (missing := surf_missing()):
            problems["features.detector"] = missing
        if problems:
            raise ParameterError(problems)
        return result

    def difference(self, other: Parameters) -> dict[str, ParameterValue]:
        """The values of ``other`` that differ from these, by dotted name."""
        mine = self.flat()
        return {name: value for name, value in other.flat().items() if mine[name] != value}


def parameter_schema() -> list[dict[str, Any]]:
    """One entry per parameter, in order: what a form or a table needs to know of it.

    Keys: ``name, group, group_help, title, help, type`` (``number``, ``integer``, ``boolean``,
    ``choice``), ``unit, default, models`` (with which ``ego_motion.model`` it acts), and
    ``minimum, maximum, step`` or ``choices``.
    """
    entries: list[dict[str, Any]] = []
    for group, group_field in Parameters.model_fields.items():
        stage = group_field.annotation
        assert isinstance(stage, type)
        assert issubclass(stage, _Stage)
        for name, schema in stage.model_json_schema()["properties"].items():
            entry = {
                "name": f"{group}.{name}",
                "group": group,
                "group_help": " ".join((stage.__doc__ or "").split()),
                "title": schema["title"],
                "help": schema["description"],
                "unit": schema["unit"],
                "default": schema["default"],
                "models": schema.get("models", list(stage.models)),
            }
            if "enum" in schema:
                entry |= {"type": "choice", "choices": schema["enum"]}
            elif schema["type"] == "boolean":
                entry |= {"type": "boolean"}
            else:
                entry |= {
                    "type": schema["type"],
                    "minimum": schema["minimum"],
                    "maximum": schema["maximum"],
                    "step": schema["step"],
                }
            entries.append(entry)
    return entries


def describe_range(dotted: str) -> str:
    """One sentence that states which values a parameter takes."""
    for entry in parameter_schema():
        if entry["name"] != dotted:
            continue
        if entry["type"] == "choice":
            return f"must be one of {', '.join(entry['choices'])}"
        if entry["type"] == "boolean":
            return "must be true or false"
        kind = "a whole number" if entry["type"] == "integer" else "a finite number"
        unit = f" {entry['unit']}" if entry["unit"] else ""
        return f"must be {kind} from {entry['minimum']:g} to {entry['maximum']:g}{unit}"
    raise InputError(f"there is no parameter named {dotted!r}")


def _did_you_mean(name: str, known: Mapping[str, Any]) -> str:
    import difflib

    near = difflib.get_close_matches(name, known, n=1)
    return f"; did you mean {near[0]}?" if near else ""


# What is declared above is the best we have; the method exactly as published differs from it here.
_PRESETS: dict[str, dict[str, ParameterValue]] = {
    "paper": {
        "ego_motion.model": "affine",
        "ego_motion.ransac_threshold_px": 1.5,
        "frames.interval": 1,
        "features.detector": "fast",
        "matching.method": "descriptor",
        "flow.residual_threshold_px": 1.5,
        "flow.min_texture": 0.3,
        "flow.match_brightness": False,
        "motion.min_significance": 0.0,
    },
    "default": {},
}
PRESET_HELP: dict[str, str] = {
    "paper": "The method as published: FAST, descriptor matching, affine RANSAC, the transformed "
    "image's optical flow, raw displacement as velocity.",
    "default": "Motion in space: points followed in both cameras, the camera's motion with six "
    "degrees of freedom, evidence pooled over neighbours and time, obstacles as bodies.",
}


def preset(name: str) -> Parameters:
    """The parameters of a named preset.

    Raises:
        InputError: there is no such preset; the sentence lists those there are.
    """
    if name not in _PRESETS:
        raise InputError(f"there is no preset {name!r}; there are: {', '.join(_PRESETS)}")
    return Parameters().changed(_PRESETS[name])


def preset_names() -> tuple[str, ...]:
    """The presets' names, ``default`` last."""
    return tuple(_PRESETS)
