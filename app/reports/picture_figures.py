"""Figures 9 to 11 and 13 to 16 of the paper, from frames of a run that were re-run."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import Polygon, Rectangle
from numpy.typing import NDArray

from app.reports.moments import Moment, is_moving, moving_px
from observer.camera import as_gray
from observer.exporting.clouds import Cloud
from observer.figures import (
    INK,
    RED,
    SKY,
    darkened,
    picture_axes,
    plain_axes,
    show_flow,
    show_image,
    show_stars,
)
from observer.geometry import BOX_CORNERS, Float64Array, Pose
from observer.jsonl import ObservationLine, ObstacleEntry, line_pose
from observer.obstacle_labels import obstacle_label
from observer.vision.stereo import disparity_map, point_cloud

_CLOUD_POINTS = 12_000
# Share of an obstacle's colour within its silhouette.
_TINT = 0.2
# Pairs of ``BOX_CORNERS`` that differ in one sign.
_EDGES = ((0, 1), (0, 2), (0, 4), (1, 3), (1, 5), (2, 3), (2, 6), (3, 7), (4, 5), (4, 6), (5, 7),
          (6, 7))  # fmt: skip


def transformation_figure(moment: Moment) -> Figure:
    """Draw (a) image at t, (b) at t+dt, (c) the latter after image transformation."""
    trace = moment.trace
    titles = ("(a) image at time t", "(b) image at time t+dt", "(c) after image transformation")
    figure, axes = picture_axes(titles, _size(moment), 3.6)
    images = (trace["previous_left"], trace["left"], trace["warped_left"])
    for each, image in zip(axes, images, strict=True):
        # Only the grey image of t is kept; a single colour scheme in all three makes them
        # comparable.
        show_image(each, as_gray(image))
    return figure


def flow_figure(shown: Sequence[tuple[Moment, str]]) -> Figure:
    """Draw features at t and their places at t+dt with the camera's motion compensated.

    Args:
        shown: one frame by one method or several, each with its title.
    """
    width = 6.4 if len(shown) == 1 else 4.8
    figure, found = picture_axes(tuple(title for _, title in shown), _size(shown[0][0]), width)
    for axes, (moment, _) in zip(found, shown, strict=True):
        _flow(axes, moment)
    return figure


def _flow(axes: Axes, moment: Moment) -> None:
    show_image(axes, darkened(moment.trace["previous_left"]))
    start, end = np.asarray(moment.trace["flow_px"]), np.asarray(moment.trace["flow_observed_px"])
    dynamic = np.asarray(moment.trace["dynamic"])
    for chosen, color, size in ((~dynamic, SKY, 1.5), (dynamic, RED, 2.5)):
        show_flow(axes, start[chosen], end[chosen], color, size)


def detection_figure(moment: Moment) -> Figure:
    """Draw the points that tell the obstacle from the static scene, and its box.

    The points are green stars, the box is red.
    """
    figure, (axes,) = picture_axes((_title(moment),), _size(moment), 6.4)
    show_image(axes, moment.trace["left"])
    show_stars(axes, moving_px(moment))
    _boxes(axes, moment.line)
    return figure


def false_points_figure(published: Moment, own: Moment) -> Figure:
    """Draw one frame by the published method and as the run observed it, false points in red."""
    titles = (
        f"{published.model}, as published: {len(published.false_px)} false",
        f"{own.model}, as in this run: {len(own.false_px)} false",
    )
    figure, axes = picture_axes(titles, _size(own), 4.8)
    for each, moment in zip(axes, (published, own), strict=True):
        show_image(each, moment.trace["previous_left"])
        show_stars(each, np.asarray(moment.trace["flow_px"])[np.asarray(moment.trace["dynamic"])])
        false = moment.false_px
        each.plot(*false.T, "o", color=RED, markersize=7, fillstyle="none", markeredgewidth=1.3)
    return figure


def cloud_figure(moment: Moment, obstacle: ObstacleEntry) -> Figure:
    """Draw (a) the obstacle in the image, (b) in the 3D cloud from above and from its left side."""
    corners = box_corners(moment.line, obstacle)
    points, colors = point_cloud(
        disparity_map(
            as_gray(moment.trace["left"]), as_gray(moment.trace["right"]), moment.parameters.stereo
        ),
        moment.trace["left"], moment.camera, moment.parameters.stereo, _CLOUD_POINTS,
    )  # fmt: skip
    figure = Figure(figsize=(10.8, 3.5), layout="constrained", facecolor="white")
    image, above, aside = figure.subplots(1, 3, width_ratios=(1.15, 1, 1))
    show_image(image, moment.trace["left"])
    _boxes(image, moment.line)
    image.set_xticks([])
    image.set_yticks([])
    image.set_title("(a) detected obstacle in the image", fontsize=9)
    _views(above, aside, points, colors, corners)
    return figure


def recorded_cloud_figure(cloud: Cloud, line: ObservationLine, obstacle: ObstacleEntry) -> Figure:
    """Draw (b) alone, for a run without images: the obstacle in a recorded cloud."""
    figure = Figure(figsize=(7.6, 3.5), layout="constrained", facecolor="white")
    above, aside = figure.subplots(1, 2)
    _views(above, aside, cloud.points, cloud.colors, box_corners(line, obstacle))
    return figure


def _views(
    above: Axes,
    aside: Axes,
    points: NDArray[np.float32],
    colors: NDArray[np.uint8],
    corners: Float64Array,
) -> None:
    """Draw points (N, 3) and the (8, 3) corners of a box, camera frame, from two sides."""
    depth = 1.6 * float(corners[:, 2].max()) + 0.5
    near = (points[:, 2] < depth) & (np.abs(points[:, 0]) < depth)
    shown, ink = points[near], colors[near] / 255.0
    for axes, pair, title in (
        (above, (0, 2), "(b) in the point cloud, from above"),
        (aside, (2, 1), "(b) in the point cloud, from the side"),
    ):
        axes.scatter(
            shown[:, pair[0]], shown[:, pair[1]], c=ink, s=2.5, linewidths=0, rasterized=True
        )
        lines = [corners[list(edge)][:, pair] for edge in _EDGES]
        axes.add_collection(LineCollection(lines, colors=RED, linewidths=1.5, zorder=4))
        axes.plot(0, 0, "^", color=INK, markersize=6, zorder=4)
        axes.set_title(title, fontsize=9)
        axes.set_aspect("equal", adjustable="datalim")
        plain_axes(axes)
    above.set_xlabel("x, m (right of the camera)")
    above.set_ylabel("z, m (ahead)")
    aside.set_xlabel("z, m (ahead)")
    aside.set_ylabel("y, m (down)")
    aside.invert_yaxis()


def box_corners(line: ObservationLine, obstacle: ObstacleEntry) -> Float64Array:
    """Return the (8, 3) corners of an obstacle's box with a known position, camera frame, m."""
    T_world_camera, position = line_pose(line), obstacle["position"]
    assert T_world_camera is not None
    assert position is not None
    T_camera_world = T_world_camera.inverse()
    turned = obstacle["orientation_wxyz"] or (1.0, 0.0, 0.0, 0.0)
    T_world_box = Pose.from_quaternion(turned, position)
    corners = T_world_box.apply(BOX_CORNERS * np.array(obstacle["size"]) / 2)
    return T_camera_world.apply(corners)


def _boxes(axes: Axes, line: ObservationLine) -> None:
    for entry in line["obstacles"]:
        if not is_moving(entry):
            continue
        # Older recordings contain no silhouettes.
        for polygon in entry.get("silhouette") or ():
            axes.add_patch(Polygon(polygon, facecolor=(RED, _TINT), edgecolor=RED, lw=0.9))
        u0, v0, u1, v1 = entry["box_px"]
        axes.add_patch(Rectangle((u0, v0), u1 - u0, v1 - v0, fill=False, edgecolor=RED, lw=1.8))
        axes.text(
            u0, v0 - 4, obstacle_label(entry["id"], entry["motion"], entry["speed"]),
            color=RED, fontsize=8,
            va="bottom", bbox={"facecolor": "#000000", "alpha": 0.55, "lw": 0, "pad": 1.5},
        )  # fmt: skip


def _title(moment: Moment) -> str:
    return f"frame {moment.line['frame']}, t = {moment.line['time']:.2f} s, {moment.model}"


def _size(moment: Moment) -> tuple[int, int]:
    height, width = moment.trace["left"].shape[:2]
    return width, height
