"""Pictures of a report: the paper's figures 9 to 16 from one frame of the run, or why not.

Pictures use the run's own method and parameters. Where only the published method has such a step,
the picture says so.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from matplotlib.figure import Figure

from app.reports.gathering import Gathered
from app.reports.moments import CANDIDATES, Moment, Moments, most_significant
from app.reports.picture_figures import (
    cloud_figure,
    detection_figure,
    false_points_figure,
    flow_figure,
    recorded_cloud_figure,
    transformation_figure,
)
from app.reports.report_figure import ReportFigure, Step
from app.reports.stereo_figure import Triangulated, stereo_figure, triangulated
from observer.errors import DynamicObserverError
from observer.exporting.clouds import Cloud, recorded_clouds
from observer.jsonl import ObservationLine, ObstacleEntry
from observer.number_format import format_number
from observer.recording.payloads import RunFacts
from observer.recording.reader import Recording
from observer.recording.source import RecordingSource
from observer.sources.contract import SIMULATED_KINDS

_TITLES = {
    "9": "Image transformation in simulation",
    "10": "Image transformation in real-time application",
    "11": "Optic flow between two frames",
    "12": "Stereo vision principle",
    "13": "Dynamic obstacle detected in simulation",
    "14": "Dynamic obstacle detected in real-time application",
    "15": "Static points classified as moving",
    "16": "Detected obstacle in the 3D point cloud",
}
# Figures that the paper has once of a simulated and once of a real environment.
_TWINS = (("9", "10"), ("13", "14"))
_STEPS = 5
_NOT_OBSERVED = "The images of the chosen frame could not be processed again."
_ONE_CAMERA = (
    "The run used only the left camera (ego_motion.model is monocular), and this figure needs both."
)

_Made = tuple[str, Figure | None, str]


def pictures(
    path: Path, gathered: Gathered, facts: RunFacts, progress: Step
) -> tuple[ReportFigure, ...]:
    """Return figures 9 to 16 in their order; each that is missing has the reason."""
    made = _made(path, gathered, progress)
    # The paper's figures 9 and 13 are of a simulated world, 10 and 14 of a real one.
    simulated = str(facts.info.get("kind")) in SIMULATED_KINDS
    kind = "a simulator" if simulated else "not a simulator"
    for pair in _TWINS:
        shown, other = pair if simulated else pair[::-1]
        if made[shown][1] is not None:
            reason = f"The source of this run, {facts.source}, is {kind}: figure {shown} shows it."
            made[other] = "", None, reason
    return tuple(
        ReportFigure(f"figure{number}", number, title, caption, figure, missing=missing)
        for number, title in _TITLES.items()
        for caption, figure, missing in (made[number],)
    )


def _made(path: Path, gathered: Gathered, progress: Step) -> dict[str, _Made]:
    try:
        source = RecordingSource(path)
    except DynamicObserverError as error:
        return {**_all_missing(f"{error}."), "16": _recorded_cloud(path, str(error))}
    try:
        moments = Moments(source, gathered)
        position = moments.most_significant()
        if position is None:
            return _all_missing("No moving obstacle was detected in this run.")
        progress(1, _STEPS)
        own = moments.own(position)
        progress(2, _STEPS)
        published = moments.published(position)
        progress(3, _STEPS)
        false = moments.most_false()
        progress(4, _STEPS)
        false_own = None if false is None else moments.own(false.position)
        progress(5, _STEPS)
    finally:
        source.close()
    transformation, detection = _transformation(own, published), _detection(own)
    return {
        "9": transformation,
        "10": transformation,
        "11": _flow(own, published),
        "12": _stereo(own),
        "13": detection,
        "14": detection,
        "15": _false_points(false, false_own),
        "16": _cloud(own),
    }


def _all_missing(reason: str) -> dict[str, _Made]:
    return dict.fromkeys(_TITLES, ("", None, reason))


def _transformation(own: Moment | None, published: Moment | None) -> _Made:
    moment = own if own is not None and own.is_planar else published
    if own is None or moment is None or "warped_left" not in moment.trace:
        return "", None, _NOT_OBSERVED
    dt_ms = 1e3 * (moment.trace["time"] - moment.trace["previous_time"])
    by = f"using the {moment.model} transformation of this run"
    if moment is not own:
        by = (
            "using the affine transformation of the published method (preset paper), with which "
            f"these two frames were re-run: the {own.model} method of this run does not warp the "
            "image"
        )
    return (
        f"{_chosen(moment)} The image at t+dt, {dt_ms:.0f} ms later, is warped onto the image at "
        f"t {by}. Black marks areas without data.",
        transformation_figure(moment), "",
    )  # fmt: skip


def _flow(own: Moment | None, published: Moment | None) -> _Made:
    if own is None:
        return "", None, _NOT_OBSERVED
    shown = [(own, f"{own.model}, as in this run")] if own.has_flow else []
    if published is not None and not own.is_planar:
        shown.append((published, f"{published.model}, as published"))
    if not shown:
        return "", None, _NOT_OBSERVED
    more = ""
    if not own.is_planar:
        more = " The same two frames were re-run with the published method (preset paper)."
    if not own.has_flow:
        more += f" The {own.model} method of this run has no such image."
    return (
        f"{_chosen(own)} Each line leads from a feature of the image at t to its position at "
        f"t+dt, with the camera's own motion compensated: blue counts as static, red as moving."
        f"{more}",
        flow_figure(shown), "",
    )  # fmt: skip


def _stereo(own: Moment | None) -> _Made:
    if own is None:
        return "", None, _NOT_OBSERVED

    def draw(obstacle: ObstacleEntry) -> _Made:
        found = triangulated(own, obstacle)
        if found is None:
            reason = "No moving point of the obstacle has a disparity in the chosen frame."
            return "", None, reason
        return _stereo_caption(own, obstacle, found), stereo_figure(own, found), ""

    return _of_obstacle(own, draw)


def _stereo_caption(own: Moment, obstacle: ObstacleEntry, found: Triangulated) -> str:
    centre = "."
    if found.centre is not None:
        centre = f", and the run reported the obstacle's centre {found.centre[1]:.2f} m ahead."
    return (
        f"{_chosen(own)} Stars are points of obstacle {obstacle['id']} in both images, on the same "
        f"row; the one with the lines has the disparity d = {found.disparity:.2f} px between them. "
        f"With the focal length f = {found.focal_px:.1f} px and the baseline b = "
        f"{1e3 * found.baseline_m:.1f} mm, it is Z = f b / d = {found.depth_m:.2f} m ahead{centre} "
        "In the top view, x is stretched."
    )


def _detection(own: Moment | None) -> _Made:
    if own is None:
        return "", None, _NOT_OBSERVED
    return (
        f"{_chosen(own)} Green stars are the feature points that move, the red box is the "
        f"detected obstacle with its number and speed, as the run reported it.",
        detection_figure(own), "",
    )  # fmt: skip


def _false_points(published: Moment | None, own: Moment | None) -> _Made:
    if published is None or own is None:
        return "", None, _NOT_OBSERVED
    moving = "truly moves" if published.by_truth else "the run reported as moving"
    if not own.has_flow:
        reason = f"The {own.model} method of this run does not compare features of two frames."
        return "", None, reason
    return (
        f"Frame {published.line['frame']}, t = {published.line['time']:.2f} s: of up to "
        f"{CANDIDATES} frames spread over those with a moving obstacle, the one with the most "
        "false points by the published method. Green stars count as moving; red circles mark those "
        f"on nothing that {moving}. Left: the affine model of the preset paper; right: the same "
        f"frame by the {own.model} model of this run.",
        false_points_figure(published, own), "",
    )  # fmt: skip


def _cloud(own: Moment | None) -> _Made:
    if own is None:
        return "", None, _NOT_OBSERVED

    def draw(obstacle: ObstacleEntry) -> _Made:
        position = obstacle["position"]
        assert position is not None
        return (
            f"{_chosen(own)} The stereo camera is at the origin (triangle); the red box is "
            f"obstacle {obstacle['id']}, {obstacle['range']:.2f} m away, at "
            f"({', '.join(format_number(each, 2) for each in position)}) m in the world of its "
            "segment.",
            cloud_figure(own, obstacle), "",
        )  # fmt: skip

    return _of_obstacle(own, draw, placed=True)


def _recorded_cloud(path: Path, reason: str) -> _Made:
    """Draw the obstacle in one of the run's clouds, which are recorded even without images.

    Args:
        reason: why there are no images.
    """
    found: list[tuple[Cloud, ObservationLine, ObstacleEntry]] = []
    with Recording(path) as recording:
        lines = {(line["frame"], line["time"]): line for line in recording.lines()}
        for _, cloud in recorded_clouds(recording):
            line = lines.get((cloud.index, cloud.time))
            obstacle = None if line is None else most_significant(line)
            if line is None or line["pose"] is None or obstacle is None:
                continue
            if obstacle["position"] is not None:
                found.append((cloud, line, obstacle))
    if not found:
        return (
            "",
            None,
            f"{reason}, and no point cloud of a frame with a moving obstacle was recorded.",
        )
    cloud, seen, moving = max(found, key=lambda each: each[2]["significance"])
    return (
        f"Frame {seen['frame']}, t = {seen['time']:.2f} s, the most significant detection among "
        "the frames with a recorded point cloud. The stereo camera is at the origin (triangle); "
        f"the red box is obstacle {moving['id']}, {moving['range']:.2f} m away. (a), the image, "
        "was not recorded.",
        recorded_cloud_figure(cloud, seen, moving), "",
    )  # fmt: skip


def _of_obstacle(
    own: Moment, draw: Callable[[ObstacleEntry], _Made], *, placed: bool = False
) -> _Made:
    """Draw what needs both cameras and the most significant obstacle.

    Args:
        placed: the obstacle's place in the world is needed as well.
    """
    if own.is_monocular:
        return "", None, _ONE_CAMERA
    obstacle = most_significant(own.line)
    if obstacle is None:
        return "", None, _NOT_OBSERVED
    if placed and (own.line["pose"] is None or obstacle["position"] is None):
        return "", None, "The camera pose was unknown in this frame."
    return draw(obstacle)


def _chosen(moment: Moment) -> str:
    return (
        f"Frame {moment.line['frame']}, t = {moment.line['time']:.2f} s, the frame with the most "
        "significant detection."
    )
