"""Pictures of the nine steps, as figures for the web page and for print."""

from __future__ import annotations

import textwrap
from collections.abc import Callable
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from numpy.typing import NDArray

from observer.camera import as_gray
from observer.figures import (
    GREY,
    INK,
    ORANGE,
    RED,
    SKY,
    bare_axes,
    darkened,
    picture_axes,
    plain_axes,
    show_flow,
    show_image,
    show_stars,
)
from observer.number_format import count_of
from observer.obstacle_labels import obstacle_label
from observer.steps.formulas import text
from observer.steps.image_steps import differences
from observer.steps.nine_steps import one_step
from observer.steps.pair import ObservedPair
from observer.steps.paper_step import PaperStep
from observer.steps.space_steps import shown_obstacles, true_speed_of
from observer.types import Obstacle, TrackState
from observer.vision.stereo import sample_disparity

# Inches: width of a whole figure in print.
_WIDTH = 9.6
# Grey levels: a difference drawn white in pictures of differences.
_WHITE = 64
# Views from above: depth shown, relative to the farthest dynamic point.
_BEYOND = 1.5
_LEAST_DEPTH_M = 1.5
# Views from above: half the width shown, relative to that depth.
_ASIDE = 0.65
_WRAPPED = 120
_INLIER = "#3fd46a"


def step_figure(pair: ObservedPair, number: int, *, labelled: bool = False) -> Figure:
    """Draw one step of an observed pair.

    Args:
        number: of the step, from 1.
        labelled: with the step's title, formula and meaning, for a figure that stands alone.

    Raises:
        ValueError: there is no such step.
    """
    step = one_step(pair, number)
    figure = _nothing(pair, step.missing) if step.missing else _DRAWN[number - 1](pair)
    for axes in figure.axes:
        for image in axes.images:
            # Store the image in its own size, not resampled to the figure's resolution.
            image.set_interpolation("none")
    if labelled:
        _label(figure, pair, step)
    return figure


def _label(figure: Figure, pair: ObservedPair, step: PaperStep) -> None:
    figure.suptitle(f"{step.number}. {step.title}", fontsize=12, color=INK)
    lines = [
        text(step.formula),
        *textwrap.wrap(step.caption, _WRAPPED),
        f"Frame {pair.frame}, t + dt = {pair.trace['time']:.3f} s, dt = {pair.dt:.3f} s, "
        f"{pair.parameters.ego_motion.model}",
    ]
    width, height = figure.get_size_inches()
    figure.set_size_inches(width, height + 0.35 + 0.2 * len(lines))
    figure.supxlabel("\n".join(lines), fontsize=8.5, color=INK)


def _nothing(pair: ObservedPair, sentence: str) -> Figure:
    figure, (axes,) = picture_axes(("",), _size(pair), _WIDTH / 1.5)
    show_image(axes, darkened(as_gray(pair.trace["left"])))
    axes.text(
        0.5, 0.5, textwrap.fill(sentence, 60), transform=axes.transAxes, ha="center", va="center",
        fontsize=11, color="white", bbox={"facecolor": "#000000", "alpha": 0.7, "lw": 0, "pad": 6},
    )  # fmt: skip
    return figure


def _images(pair: ObservedPair) -> Figure:
    trace = pair.trace
    titles = ("(a) left, t", "(b) right, t", "(c) left, t+dt", "(d) right, t+dt")
    figure, found = picture_axes(titles, _size(pair), _WIDTH / 2, columns=2)
    names = ("previous_left", "previous_right", "left", "right")
    for axes, name in zip(found, names, strict=True):
        # Of t only grey images are kept; showing all in grey makes them comparable.
        image = as_gray(trace[name])
        show_image(axes, image)
        axes.axhline(image.shape[0] / 2, color=ORANGE, linewidth=1.0)
    return figure


def _features(pair: ObservedPair) -> Figure:
    figure, (axes,) = picture_axes(("left image, t",), _size(pair), _WIDTH)
    show_image(axes, pair.trace["previous_left"])
    show_stars(axes, pair.trace["features_px"])
    return figure


def _matches(pair: ObservedPair) -> Figure:
    figure, (axes,) = picture_axes(("left image, t+dt",), _size(pair), _WIDTH)
    matches = pair.trace["matches"]
    show_image(axes, darkened(as_gray(pair.trace["left"])))
    show_flow(axes, matches.previous, matches.current, SKY, 2.5)
    return figure


def _ego_motion(pair: ObservedPair) -> Figure:
    matches, inliers = pair.trace["matches"], pair.trace["ego_motion"].inliers
    title = f"{inliers.sum()} inliers, {(~inliers).sum()} outliers"
    figure, (axes,) = picture_axes((title,), _size(pair), _WIDTH)
    show_image(axes, darkened(as_gray(pair.trace["left"])))
    for chosen, color in ((inliers, _INLIER), (~inliers, ORANGE)):
        show_flow(axes, matches.previous[chosen], matches.current[chosen], color, 2.5)
    return figure


def _transformation(pair: ObservedPair) -> Figure:
    titles = (
        "(a) image at t+dt",
        "(b) after image transformation",
        "(c) difference from t, before",
        "(d) difference from t, after",
    )
    figure, found = picture_axes(titles, _size(pair), _WIDTH / 2, columns=2)
    before, after, valid = differences(pair)
    show_image(found[0], as_gray(pair.trace["left"]))
    show_image(found[1], pair.trace["warped_left"])
    for axes, difference in zip(found[2:], (before, np.where(valid, after, 0.0)), strict=True):
        shown = (difference * (255 / _WHITE)).clip(0, 255).astype(np.uint8)
        show_image(axes, shown)
    return figure


def _flow(pair: ObservedPair) -> Figure:
    trace = pair.trace
    dynamic = trace["dynamic"]
    title = f"{dynamic.sum()} of {len(dynamic)} features are dynamic"
    figure, (axes,) = picture_axes((title,), _size(pair), _WIDTH)
    show_image(axes, darkened(trace["previous_left"]))
    start, end = trace["flow_px"], trace["flow_observed_px"]
    for chosen, color, marker in ((~dynamic, SKY, 1.5), (dynamic, RED, 3.0)):
        show_flow(axes, start[chosen], end[chosen], color, marker)
    return figure


def _stereo(pair: ObservedPair) -> Figure:
    trace = pair.trace
    figure, image, above = _with_plan(pair)
    disparity = np.ma.masked_invalid(trace["disparity"])
    bare_axes(image, "(a) disparity, t")
    colors = colormaps["turbo"].with_extremes(bad="#181818")
    drawn = image.imshow(disparity, cmap=colors, vmin=0)
    bar = figure.colorbar(drawn, ax=image, location="bottom", fraction=0.06, pad=0.02, aspect=40)
    bar.ax.tick_params(labelsize=8, colors=INK)
    bar.set_label("disparity, px", fontsize=8, color=INK)
    if "dynamic" in trace:
        px = trace["flow_px"][trace["dynamic"]]
        image.plot(*px.T, "o", color=RED, markersize=3, markeredgecolor="white",
                   markeredgewidth=0.4, linestyle="none")  # fmt: skip
    _plan(above, pair, "(b) features from above, t")
    return figure


def _displacement(pair: ObservedPair) -> Figure:
    motions = pair.trace["motions"]
    figure, spread, above = _with_plan(pair, equal=True)
    speed = np.linalg.norm(motions.velocity, axis=1)
    plain_axes(spread)
    spread.set_title("(a) speeds of the dynamic points", fontsize=9, color=INK)
    if len(speed):
        high = max(1.0, float(np.percentile(speed, 95)) * 1.2)
        spread.hist(speed.clip(0, high), bins=24, range=(0, high), color=RED, zorder=2)
    for body in pair.truth or ():
        if body.track_id is not None:
            spread.axvline(body.speed_mps, color=INK, linewidth=1.4, linestyle="--", zorder=3)
            spread.annotate(
                f"true, {body.name}", (body.speed_mps, 1), xycoords=("data", "axes fraction"),
                xytext=(3, -10), textcoords="offset points", fontsize=8, color=INK,
            )  # fmt: skip
    spread.set_xlabel("speed, m/s", fontsize=8, color=INK)
    spread.set_ylabel("points", fontsize=8, color=INK)
    spread.tick_params(labelsize=8)
    _plan(above, pair, "(b) motion in one second, from above")
    if len(speed):
        begin, way = motions.points_previous, motions.velocity
        above.quiver(
            begin[:, 0], begin[:, 2], way[:, 0], way[:, 2], angles="xy", scale_units="xy", scale=1,
            color=RED, width=0.003, zorder=4,
        )  # fmt: skip
    return figure


def _obstacles(pair: ObservedPair) -> Figure:
    shown = shown_obstacles(pair)
    title = f"left image, t+dt: {count_of(len(shown), 'obstacle')}"
    figure, (axes,) = picture_axes((title,), _size(pair), _WIDTH)
    show_image(axes, pair.trace["left"])
    motions = pair.trace["motions"]
    show_stars(axes, motions.px_current)
    for one in pair.observation.obstacles:
        if one.points:
            _box(axes, one, true_speed_of(pair, one.id))
    return figure


def _box(axes: Axes, one: Obstacle, true: float | None) -> None:
    new = one.state is TrackState.TENTATIVE
    color = "white" if new else RED
    u0, v0, u1, v1 = one.box_px
    axes.add_patch(
        Rectangle((u0, v0), u1 - u0, v1 - v0, fill=False, edgecolor=color, lw=1.8,
                  linestyle="--" if new else "-")
    )  # fmt: skip
    if new:
        return
    label = obstacle_label(one.id, one.motion, one.speed) + (
        "" if true is None else f" (true {true:.2f})"
    )
    axes.text(
        u0, v0 - 4, label, color=color, fontsize=10, va="bottom",
        bbox={"facecolor": "#000000", "alpha": 0.55, "lw": 0, "pad": 1.5},
    )  # fmt: skip


# --- views from above --------------------------------------------------------------------------


def _with_plan(pair: ObservedPair, *, equal: bool = False) -> tuple[Figure, Axes, Axes]:
    """Make a figure with axes for a picture or chart and, to its right, for a view from above."""
    width, height = _size(pair)
    ratio = 1.0 if equal else 1.7
    figure = Figure(
        figsize=(_WIDTH, max(3.4, _WIDTH * ratio / (ratio + 1) * height / width + 0.9)),
        layout="constrained", facecolor="white",
    )  # fmt: skip
    left, right = figure.subplots(1, 2, width_ratios=(ratio, 1))
    return figure, left, right


def _plan(axes: Axes, pair: ObservedPair, title: str) -> None:
    """Draw the features whose depth is known from above: x to the right, z ahead, metres."""
    trace = pair.trace
    px = trace["features_px"].astype(np.float64)
    known = sample_disparity(trace["disparity"], px)
    there = np.isfinite(known) & (known > 0)
    points: NDArray[Any] = pair.camera.triangulate(px[there], known[there])
    moving = trace["motions"].points_previous if "motions" in trace else np.empty((0, 3))
    # The range follows the moving points; without any, the static ones.
    farthest = moving[:, 2].max(initial=0.0)
    if not len(moving) and len(points):
        farthest = np.median(points[:, 2])
    depth = max(_LEAST_DEPTH_M, _BEYOND * float(farthest))
    axes.plot(points[:, 0], points[:, 2], "o", color=GREY, markersize=2, linestyle="none")
    axes.plot(moving[:, 0], moving[:, 2], "o", color=RED, markersize=3, linestyle="none", zorder=3)
    axes.plot(0, 0, "^", color=INK, markersize=7, zorder=4)
    axes.set_ylim(-0.05 * depth, depth)
    axes.set_xlim(-_ASIDE * depth, _ASIDE * depth)
    axes.set_aspect("equal", adjustable="box")
    axes.set_title(title, fontsize=9, color=INK)
    axes.set_xlabel("x, m (right)", fontsize=8, color=INK)
    axes.set_ylabel("z, m (ahead)", fontsize=8, color=INK)
    axes.tick_params(labelsize=8)
    plain_axes(axes)


def _size(pair: ObservedPair) -> tuple[int, int]:
    height, width = pair.trace["left"].shape[:2]
    return width, height


_DRAWN: tuple[Callable[[ObservedPair], Figure], ...] = (
    _images,
    _features,
    _matches,
    _ego_motion,
    _transformation,
    _flow,
    _stereo,
    _displacement,
    _obstacles,
)
