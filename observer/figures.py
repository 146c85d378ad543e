"""Appearance and output of figures, for print and web pages: equal data give equal bytes.

No pyplot state is used. Text and axes are drawn in one ink colour, which a page replaces with its
own, so that charts are legible on light and dark backgrounds.
"""

from __future__ import annotations

import io
from typing import Any, Literal

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.text import Text
from numpy.typing import NDArray

from observer.geometry import Float64Array
from observer.obstacle_colors import MOVING_HEX
from observer.types import Image

INK = "#1b1d21"
GRID = "#dfe2e6"
# The same for a dark background.
_LIGHT_INK, _DARK_GRID = "#e5efeb", "#33413d"
GREEN, RED, GREY = "#2bd42b", MOVING_HEX, "#9aa0a6"
# Of notes in a figure: grey as well, but dark enough to be read.
DARK_GREY = "#5a5a5a"
# After Okabe and Ito: distinguishable to colour-blind people, and on a dark background.
BLUE, ORANGE, PURPLE, TEAL, SKY = "#1f7fc4", "#D55E00", "#CC79A7", "#009E73", "#56B4E9"
SERIES = (BLUE, ORANGE, TEAL, PURPLE, SKY)
FORMATS = ("png", "svg", "pdf")
_DPI = 150
_STYLE: Any = {"svg.fonttype": "none", "font.family": "sans-serif"}


def picture_axes(
    titles: tuple[str, ...], size: tuple[int, int], width: float, columns: int | None = None
) -> tuple[Figure, list[Axes]]:
    """Make axes for pictures of this width and height, pixels, without ticks.

    Args:
        width: of each on paper, inches. columns: of a grid that the titles fill; None: one row.
    """
    columns = columns or len(titles)
    rows = -(-len(titles) // columns)
    figsize = (width * columns, rows * (width * size[1] / size[0] + 0.34))
    figure = Figure(figsize=figsize, layout="constrained", facecolor="white")
    found = list(figure.subplots(rows, columns, squeeze=False).flat)
    for axes, title in zip(found, titles, strict=True):
        bare_axes(axes, title)
    return figure, found


def bare_axes(axes: Axes, title: str) -> None:
    """Give axes that show a picture their title, and neither ticks nor frame."""
    axes.set_title(title, fontsize=9, color=INK)
    axes.set_xticks([])
    axes.set_yticks([])
    for spine in axes.spines.values():
        spine.set_visible(False)


def show_image(axes: Axes, image: Image) -> None:
    """Show a grey or BGR image; pixel centres have integer coordinates."""
    rgb: NDArray[np.uint8] = (
        np.repeat(image[..., None], 3, axis=2) if image.ndim == 2 else image[..., ::-1]
    )
    axes.imshow(rgb, interpolation="nearest")
    axes.set_xlim(-0.5, image.shape[1] - 0.5)
    axes.set_ylim(image.shape[0] - 0.5, -0.5)


def show_stars(axes: Axes, px: Float64Array) -> None:
    """Mark pixels (N, 2) by green stars, as the paper does."""
    axes.plot(*np.asarray(px).T, "*", color=GREEN, markersize=5, markeredgewidth=0.4,
              markeredgecolor="#0b5d0b", linestyle="none")  # fmt: skip


def show_flow(
    axes: Axes, start: NDArray[Any], end: NDArray[Any], color: str, marker_size: float = 1.5
) -> None:
    """Draw the paths of points (N, 2), pixels, each from a dot at its start."""
    segments = np.stack([start, end], axis=1)
    axes.add_collection(LineCollection(list(segments), colors=color, linewidths=1.2))
    axes.plot(*np.asarray(start).T, "o", color=color, markersize=marker_size, linestyle="none")


def darkened(image: Image) -> Image:
    """Return a picture on which marks stand out."""
    return np.asarray(np.asarray(image) * 0.55, dtype=np.uint8)


def plain_axes(axes: Axes, lines: Literal["x", "y", "both"] = "both") -> None:
    """Give the axes two spines, and a grid along these directions."""
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    for side in ("left", "bottom"):
        axes.spines[side].set_color(INK)
    axes.tick_params(colors=INK, length=3)
    axes.grid(True, axis=lines, color=GRID, linewidth=0.7, zorder=0)
    axes.set_axisbelow(True)


def figure_bytes(figure: Figure, name: str, format_: str) -> bytes:
    """Return the file of a figure, without a date in it.

    Args:
        name: of the figure; parts of an SVG are numbered by it, so that several fit on one page.
        format_: one of ``FORMATS`` or ``jpg``.
    """
    file = io.BytesIO()
    dates: dict[str, dict[str, Any]] = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}
    more: dict[str, Any] = {"pil_kwargs": {"quality": 88}} if format_ == "jpg" else {}
    for text in figure.findobj(Text):
        assert isinstance(text, Text)
        if text.get_color() == "black":
            text.set_color(INK)
    with mpl.rc_context({**_STYLE, "svg.hashsalt": name}):
        figure.savefig(file, format=format_, dpi=_DPI, metadata=dates.get(format_), **more)
    return file.getvalue()


def themed_svg(figure: Figure, name: str) -> str:
    """Return an SVG element that takes ink and grid from the surrounding page."""
    text = _transparent_svg(figure, name)
    text = text[text.index("<svg") :]
    return text.replace(INK, "currentColor").replace(GRID, "var(--grid)")


def dark_svg(figure: Figure, name: str) -> bytes:
    """Return the file of a transparent SVG for a dark background."""
    return (
        _transparent_svg(figure, name).replace(INK, _LIGHT_INK).replace(GRID, _DARK_GRID).encode()
    )


def _transparent_svg(figure: Figure, name: str) -> str:
    figure.patch.set_alpha(0.0)
    for axes in figure.axes:
        axes.patch.set_alpha(0.0)
    text = figure_bytes(figure, name, "svg").decode()
    figure.patch.set_alpha(1.0)
    return text
