"""Figure 12 of the paper: how two cameras give a depth, at a point of the detected obstacle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from app.reports.moments import Moment, moving_px
from observer.camera import as_gray
from observer.figures import BLUE, GREEN, INK, ORANGE, RED, plain_axes, show_image, show_stars
from observer.geometry import Float64Array
from observer.jsonl import ObstacleEntry, line_pose
from observer.types import BoxPx
from observer.vision.stereo import disparity_map

# Pixels: a point that the run matched lies this close to where it is looked up.
_SAME_PX = 0.5
# A disparity may differ from the median by this share of it.
_USUAL = 0.15
# Margin around an obstacle as a share of its size, and the least height as a share of the width.
_AROUND, _LEAST_HEIGHT = 0.6, 0.7
# The axes reach this much further than the point.
_BEYOND = 1.12


@dataclass(frozen=True, eq=False)
class Triangulated:
    """Point of an obstacle, seen by both cameras.

    Attributes:
        px: (N, 2) moving points of the obstacle in the left image whose disparities are known.
        disparities: (N,) pixels.
        chosen: index of the one that is triangulated.
        box_px: of the obstacle.
        focal_px, baseline_m: of the rectified pair.
        centre: x and z of the obstacle's centre as the run reported it, metres, camera frame; None
            if the camera's pose was unknown.
    """

    px: Float64Array
    disparities: Float64Array
    chosen: int
    box_px: BoxPx
    focal_px: float
    baseline_m: float
    centre: tuple[float, float] | None

    @property
    def disparity(self) -> float:
        """Return the disparity of the chosen point, pixels."""
        return float(self.disparities[self.chosen])

    @property
    def depth_m(self) -> float:
        """Return the depth of the chosen point, metres."""
        return self.focal_px * self.baseline_m / self.disparity


def triangulated(moment: Moment, obstacle: ObstacleEntry) -> Triangulated | None:
    """Return a point of the obstacle seen by both cameras; None if none has a disparity."""
    px = moving_px(moment)
    u0, v0, u1, v1 = obstacle["box_px"]
    inside = (px[:, 0] >= u0) & (px[:, 0] <= u1) & (px[:, 1] >= v0) & (px[:, 1] <= v1)
    px = px[inside]
    disparities = _disparities(moment, px)
    known = np.isfinite(disparities) & (disparities > 0)
    if not known.any():
        return None
    px, disparities = px[known], disparities[known]
    # Of the points with about the usual disparity, the one closest to the middle.
    usual = float(np.median(disparities))
    apart = np.linalg.norm(px - [(u0 + u1) / 2, (v0 + v1) / 2], axis=1)
    apart[np.abs(disparities - usual) > _USUAL * usual] = np.inf
    chosen = int(apart.argmin())
    camera = moment.camera
    return Triangulated(
        px,
        disparities,
        chosen,
        (u0, v0, u1, v1),
        camera.fx,
        camera.baseline,
        _centre(moment, obstacle),
    )


def stereo_figure(moment: Moment, found: Triangulated) -> Figure:
    """Draw (a) left and (b) right image with the obstacle's points, (c) the rays from above."""
    (begin, end), (top, bottom) = _cut(found, moment.trace["left"].shape)
    figure = Figure(
        figsize=(11.4, 4.0 * (bottom - top) / (end - begin) + 0.5),
        layout="constrained", facecolor="white",
    )  # fmt: skip
    left, right, plan = figure.subplots(1, 3, width_ratios=(1, 1, 0.75))
    u, v = found.px[found.chosen]
    shifted = found.px - np.stack([found.disparities, np.zeros(len(found.px))], axis=1)
    for axes, image, points, title in (
        (left, moment.trace["left"], found.px, "(a) left image"),
        (right, moment.trace["right"], shifted, "(b) right image"),
    ):
        show_image(axes, image)
        axes.set_xlim(begin, end)
        axes.set_ylim(bottom, top)
        axes.axhline(v, color=ORANGE, linewidth=1.0)
        show_stars(axes, points)
        axes.axvline(u, color=BLUE, linewidth=1.0, linestyle="-" if axes is left else "--")
        axes.set_xticks([])
        axes.set_yticks([])
        axes.set_title(title, fontsize=9)
    right.axvline(u - found.disparity, color=RED, linewidth=1.0)
    _between(right, u - found.disparity, u, v, f"d = {found.disparity:.1f} px")
    _plan(plan, moment, found, float(u))
    return figure


def _cut(
    found: Triangulated, shape: tuple[int, ...]
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the columns and rows around the obstacle that hold its points in both images."""
    u0, v0, u1, v1 = found.box_px
    margin = _AROUND * max(u1 - u0, v1 - v0)
    begin, end = max(u0 - found.disparity - margin, -0.5), min(u1 + margin, shape[1] - 0.5)
    half = max((v1 - v0) / 2 + margin / 2, _LEAST_HEIGHT * (end - begin) / 2)
    middle = min(max((v0 + v1) / 2, half - 0.5), shape[0] - half - 0.5)
    return (begin, end), (max(middle - half, -0.5), min(middle + half, shape[0] - 0.5))


def _between(axes: Axes, begin: float, end: float, row: float, words: str) -> None:
    axes.annotate(
        "", (begin, row), (end, row),
        arrowprops={"arrowstyle": "<->", "color": ORANGE, "lw": 1.4, "shrinkA": 0, "shrinkB": 0},
    )  # fmt: skip
    axes.annotate(
        words, ((begin + end) / 2, row), xytext=(0, 6), textcoords="offset points", ha="center",
        fontsize=8, color=ORANGE, bbox={"facecolor": "#000000", "alpha": 0.6, "lw": 0, "pad": 1.5},
    )  # fmt: skip


def _plan(axes: Axes, moment: Moment, found: Triangulated, u: float) -> None:
    """Draw the rays of both cameras to the point, seen from above; x is stretched."""
    depth, baseline = found.depth_m, found.baseline_m
    x = (u - moment.camera.cx) * depth / found.focal_px
    for origin, color, name in ((0.0, BLUE, "left"), (baseline, RED, "right")):
        axes.plot([origin, x], [0.0, depth], color=color, linewidth=1.3)
        axes.plot(origin, 0.0, "^", color=color, markersize=7, label=f"{name} camera")
    axes.plot(x, depth, "*", color=GREEN, markersize=11, markeredgecolor="#0b5d0b", label="point")
    if found.centre is not None:
        axes.plot(*found.centre, "s", color=INK, markersize=5, fillstyle="none",
                  label="reported centre")  # fmt: skip
    farthest = depth if found.centre is None else max(depth, found.centre[1])
    axes.set_ylim(-0.06 * farthest, _BEYOND * farthest)
    axes.margins(x=0.18)
    axes.tick_params(labelsize=8)
    axes.set_title(f"(c) from above: Z = f b / d = {depth:.2f} m", fontsize=9)
    axes.set_xlabel("x, m (right of the left camera)", fontsize=8)
    axes.set_ylabel("z, m (ahead)", fontsize=8)
    axes.legend(fontsize=7, frameon=False, loc="best")
    plain_axes(axes)


def _disparities(moment: Moment, px: Float64Array) -> Float64Array:
    """Return (N,) disparities as the run's method found them; NaN where it found none."""
    found = np.full(len(px), np.nan)
    rows = moment.trace.get("rows")
    if rows is not None:
        # The rigid method's own matches.
        for number, point in enumerate(px):
            apart = np.linalg.norm(rows.px - point, axis=1)
            if len(apart) and apart.min() < _SAME_PX:
                found[number] = rows.disparity[int(apart.argmin())]
        return found
    left, right = (as_gray(moment.trace[side]) for side in ("left", "right"))
    disparity = disparity_map(left, right, moment.parameters.stereo)
    height, width = disparity.shape
    column = np.clip(np.rint(px[:, 0]).astype(int), 0, width - 1)
    row = np.clip(np.rint(px[:, 1]).astype(int), 0, height - 1)
    found[:] = disparity[row, column]
    return found


def _centre(moment: Moment, obstacle: ObstacleEntry) -> tuple[float, float] | None:
    T_world_camera = line_pose(moment.line)
    if T_world_camera is None or obstacle["position"] is None:
        return None
    x, _, z = T_world_camera.inverse().apply(np.array([obstacle["position"]], np.float64))[0]
    return float(x), float(z)
