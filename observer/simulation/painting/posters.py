"""Painters of pictures, which give the walls texture."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

from observer.simulation.painting.canvas import Canvas, Float32Array

# Palettes (blue, green, red): paper first, then inks.
_PALETTES: tuple[tuple[tuple[int, int, int], ...], ...] = (
    ((226, 238, 244), (64, 74, 226), (150, 112, 40), (70, 178, 240), (62, 50, 40)),
    ((70, 52, 38), (96, 196, 244), (120, 214, 166), (226, 238, 240), (82, 92, 232)),
    ((210, 232, 238), (110, 140, 30), (60, 130, 238), (160, 200, 120), (50, 60, 80)),
    ((96, 62, 150), (230, 226, 240), (90, 200, 250), (190, 120, 60), (40, 26, 60)),
)


def _palette(canvas: Canvas) -> tuple[tuple[int, int, int], ...]:
    return _PALETTES[int(canvas.rng.integers(len(_PALETTES)))]


def rings(canvas: Canvas) -> Float32Array:
    """Concentric circles about a few points."""
    paper, *inks = _palette(canvas)
    image = canvas.filled(paper)
    rng, w, h = canvas.rng, canvas.width, canvas.height
    for _ in range(6):
        centre = (int(rng.uniform(0, w)), int(rng.uniform(0, h)))
        largest = rng.uniform(0.15, 0.42) * w
        for k in range(7):
            ink = inks[(k + int(rng.integers(2))) % len(inks)]
            cv2.circle(image, centre, round(largest * (1 - k / 7)), ink, -1, cv2.LINE_AA)
    return image


def blocks(canvas: Canvas) -> Float32Array:
    """Rectangles split again and again, with black bars between them."""
    paper, *inks = _palette(canvas)
    image = canvas.filled(paper)
    rng = canvas.rng
    bar = max(2, canvas.width // 60)
    stack = [(0, 0, canvas.width, canvas.height, 0)]
    while stack:
        x0, y0, x1, y1, depth = stack.pop()
        large = min(x1 - x0, y1 - y0) > canvas.width // 7
        if large and (depth < 3 or (depth < 6 and rng.random() < 0.92)):
            if x1 - x0 > y1 - y0:
                c = int(rng.uniform(0.3, 0.7) * (x1 - x0)) + x0
                stack += [(x0, y0, c, y1, depth + 1), (c, y0, x1, y1, depth + 1)]
            else:
                c = int(rng.uniform(0.3, 0.7) * (y1 - y0)) + y0
                stack += [(x0, y0, x1, c, depth + 1), (x0, c, x1, y1, depth + 1)]
            continue
        if rng.random() < 0.6:
            cv2.rectangle(image, (x0, y0), (x1, y1), inks[int(rng.integers(len(inks)))], -1)
        cv2.rectangle(image, (x0, y0), (x1, y1), (28, 28, 28), bar)
    return image


def city_map(canvas: Canvas) -> Float32Array:
    """A plan of streets: blocks at an angle, a river, a few roads."""
    rng, w, h = canvas.rng, canvas.width, canvas.height
    image = canvas.filled((222, 234, 238))
    angle = float(rng.uniform(-30, 30))
    turn = cv2.getRotationMatrix2D((w / 2, h / 2), angle, 1.0)
    cell = w // 9
    for y in range(-h // 2, 3 * h // 2, cell):
        for x in range(-w // 2, 3 * w // 2, cell):
            corners = np.array([[x, y], [x + cell, y], [x + cell, y + cell], [x, y + cell]], float)
            centre = corners.mean(axis=0)
            corners = centre + (corners - centre) * rng.uniform(0.62, 0.85)
            turned = cv2.transform(corners[None], turn)[0]
            tone = int(rng.uniform(150, 212))
            colour = (tone - 20, tone, tone + 12) if rng.random() < 0.8 else (120, 190, 130)
            cv2.fillPoly(image, [turned.astype(np.int32)], colour, cv2.LINE_AA)
    t = np.linspace(-0.1, 1.1, 30)
    bend = np.interp(t, np.linspace(-0.1, 1.1, 5), rng.uniform(0.2, 0.8, 5))
    river = np.stack([t * w, bend * h], axis=1).astype(np.int32)
    cv2.polylines(image, [river], False, (214, 168, 96), w // 12, cv2.LINE_AA)
    for _ in range(3):
        a = (int(rng.uniform(0, w)), 0)
        b = (int(rng.uniform(0, w)), h)
        cv2.line(image, a, b, (90, 170, 246), max(2, w // 45), cv2.LINE_AA)
    return image


def waves(canvas: Canvas) -> Float32Array:
    """Hills one behind the other under a sun."""
    paper, *inks = _palette(canvas)
    rng, w, h = canvas.rng, canvas.width, canvas.height
    image = canvas.filled(paper)
    sun = (int(rng.uniform(0.25, 0.75) * w), int(0.28 * h))
    cv2.circle(image, sun, w // 6, inks[0], -1, cv2.LINE_AA)
    x = np.arange(w)
    for k in range(7):
        base = h * (0.36 + 0.10 * k)
        wave = np.zeros(w)
        for n in range(1, 5):
            angle = x / w * 2 * np.pi * n * rng.uniform(0.6, 1.6) + rng.uniform(0, 6)
            wave += h * 0.035 / n * np.sin(angle)
        line = np.column_stack([x, base + wave]).astype(np.int32)
        shape = np.vstack([line, [[w, h], [0, h]]]).astype(np.int32)
        fade = 0.35 + 0.65 * k / 6
        ink = np.asarray(inks[(k + 1) % len(inks)]) * fade + np.asarray(paper) * (1 - fade) * 0.8
        cv2.fillPoly(image, [shape], tuple(float(c) for c in ink), cv2.LINE_AA)
    return image


def tag(canvas: Canvas) -> Float32Array:
    """A random square code, as on marked robots."""
    rng, w, h = canvas.rng, canvas.width, canvas.height
    image = canvas.filled((242, 244, 244))
    side = round(0.8 * min(w, h))
    x0, y0 = (w - side) // 2, (h - side) // 2
    n = 10
    bits = rng.random((n, n)) < 0.5
    bits[0], bits[-1], bits[:, 0], bits[:, -1] = True, True, True, True
    for (row, column), black in np.ndenumerate(bits):
        if black:
            a = (x0 + column * side // n, y0 + row * side // n)
            b = (x0 + (column + 1) * side // n - 1, y0 + (row + 1) * side // n - 1)
            cv2.rectangle(image, a, b, (24, 24, 24), -1)
    return image


def sign(canvas: Canvas) -> Float32Array:
    """The laboratory's sign."""
    w, h = canvas.width, canvas.height
    image = canvas.filled((110, 74, 30))
    cv2.rectangle(image, (0, 0), (w, round(0.2 * h)), (60, 180, 245), -1)
    for text, y, scale in (("ROBOTICS", 0.42, 1.0), ("LAB", 0.66, 1.7), ("room 017", 0.86, 0.7)):
        font = cv2.FONT_HERSHEY_DUPLEX
        size = cv2.getTextSize(text, font, 1.0, 2)[0]
        s = min(scale * h / 260, 0.9 * w / size[0])
        x = round((w - size[0] * s) / 2)
        thickness = max(1, round(2.2 * s))
        cv2.putText(
            image, text, (x, round(y * h)), font, s, (240, 240, 240), thickness, cv2.LINE_AA
        )
    return image


def checkerboard(canvas: Canvas) -> NDArray[np.uint8]:
    """Squares of a tenth of the height, black and white."""
    u = (np.arange(canvas.width) * 10 // canvas.height)[None, :]
    v = (np.arange(canvas.height) * 10 // canvas.height)[:, None]
    image = np.where(((u + v) % 2)[..., None] == 0, 235.0, 25.0)
    return canvas.finished(np.asarray(np.repeat(image, 3, axis=2), np.float32))


def framed(paint: Callable[[Canvas], Float32Array]) -> Callable[[Canvas], NDArray[np.uint8]]:
    """Return a painter that puts a narrow frame around the picture."""

    def painter(canvas: Canvas) -> NDArray[np.uint8]:
        image = paint(canvas)
        edge = max(2, canvas.px(0.018))
        cv2.rectangle(image, (0, 0), (canvas.width - 1, canvas.height - 1), (44, 48, 52), 2 * edge)
        return canvas.finished(image)

    return painter
