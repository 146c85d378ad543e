"""Painters of things: crates, cardboard boxes, cabinets, the P3-DX."""

from __future__ import annotations

import math
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from observer.simulation.painting.canvas import (
    Canvas,
    Colour,
    Float32Array,
    mix,
    smoothstep,
    spread,
)


def _bottom_shade(canvas: Canvas, depth: float = 0.35) -> Float32Array:
    """Darker towards the floor."""
    above = canvas.size_m[1] - canvas.rows()
    return np.asarray(
        np.ones((1, canvas.width), np.float32) * (1 - depth * np.exp(-above / 0.12)), np.float32
    )


def _sides(canvas: Canvas) -> list[slice]:
    """Return the column ranges of the four sides of a box, around which the texture runs."""
    length = canvas.material.number("length", 0.5)
    width = canvas.material.number("width", 0.5)
    ends = np.cumsum([length, width, length, width]) * canvas.density
    edges = [0, *(round(float(e)) for e in ends)]
    edges[-1] = canvas.width
    return [slice(a, b) for a, b in pairwise(edges)]


def _boards(canvas: Canvas, board_m: float, base: Colour) -> Float32Array:
    """Horizontal boards of wood."""
    image = canvas.filled(base)
    grain = canvas.noise(0.25, 0.006) + 0.7 * canvas.noise(0.6, 0.015)
    step = max(3, canvas.px(board_m))
    tone = np.zeros((canvas.height, 1), np.float32)
    for top in range(0, canvas.height, step):
        tone[top : top + step] = canvas.rng.normal(0, 9)
    image += spread(9 * grain + tone + 6 * canvas.cloud(0.2, 3))
    gap = np.zeros((canvas.height, canvas.width), np.float32)
    for top in range(step, canvas.height - 1, step):
        gap[top : top + 2] = 1
    return mix(image, (30, 45, 60), 0.8 * gap)


def crate_side(canvas: Canvas) -> NDArray[np.uint8]:
    """Boards in a frame with a diagonal brace on every side."""
    image = _boards(canvas, 0.09, (96, 146, 186))
    frame_tone = canvas.noise(0.3, 0.008) * 7
    for side in _sides(canvas):
        w = side.stop - side.start
        beam = max(3, canvas.px(0.055))
        mask = np.zeros((canvas.height, w), np.uint8)
        cv2.line(mask, (0, canvas.height), (w, 0), 255, beam, cv2.LINE_AA)
        edge = beam
        mask[:edge], mask[-edge:], mask[:, :edge], mask[:, -edge:] = 255, 255, 255, 255
        soft = mask.astype(np.float32) / 255
        rim = np.clip(cv2.GaussianBlur(soft, (0, 0), 2.5) - soft, 0, 1)
        region = image[:, side]
        region = mix(region, (28, 40, 55), np.clip(1.4 * rim, 0, 0.8))
        colour = np.array([116, 168, 206], np.float32) + frame_tone[:, side, None]
        region = mix(region, np.asarray(colour, np.float32), soft)
        for cx in (edge / 2, w - edge / 2):
            for cy in (edge / 2, canvas.height - edge / 2):
                cv2.circle(region, (round(cx), round(cy)), 3, (50, 56, 60), -1, cv2.LINE_AA)
        image[:, side] = region
    return canvas.finished(image, _bottom_shade(canvas))


def crate_top(canvas: Canvas) -> NDArray[np.uint8]:
    """Boards."""
    return canvas.finished(_boards(canvas, 0.09, (110, 160, 200)))


def cardboard_side(canvas: Canvas) -> NDArray[np.uint8]:
    """Brown paper with tape, a label and printed marks."""
    rng = canvas.rng
    image = canvas.filled((112, 158, 192))
    image += spread(3 * canvas.noise(0.004, 0.2) + 4 * canvas.cloud(0.15, 3))
    for k, side in enumerate(_sides(canvas)):
        w, h = side.stop - side.start, canvas.height
        region = np.ascontiguousarray(image[:, side])
        tape = canvas.px(0.05)
        ends = (w // 2 - tape // 2, 0), (w // 2 + tape // 2, canvas.px(0.09))
        cv2.rectangle(region, *ends, (140, 182, 208), -1)
        if k % 2 == 0:
            lw, lh = int(0.32 * w), int(0.34 * h)
            x, y = int(rng.uniform(0.06, 0.2) * w), int(rng.uniform(0.4, 0.55) * h)
            cv2.rectangle(region, (x, y), (x + lw, y + lh), (238, 240, 240), -1)
            for row in range(4):
                yy = y + int(lh * (0.14 + 0.14 * row))
                end = x + int(lw * rng.uniform(0.5, 0.9))
                cv2.line(region, (x + lw // 12, yy), (end, yy), (60, 60, 60), max(1, lh // 28))
            bars = rng.random(28) < 0.5
            for bar in np.flatnonzero(bars):
                bx = x + lw // 12 + int(bar * lw * 0.8 / 28)
                a, b = (bx, y + int(0.68 * lh)), (bx + max(1, lw // 40), y + int(0.92 * lh))
                cv2.rectangle(region, a, b, (30, 30, 30), -1)
        s = min(w, h)
        _this_way_up(region, int(0.80 * w), int(0.62 * h), int(0.13 * s))
        image[:, side] = region
    return canvas.finished(image, _bottom_shade(canvas))


def _this_way_up(region: Float32Array, x: int, y: int, s: int) -> None:
    ink = (56, 70, 92)
    for dx in (-s, s // 3):
        cv2.rectangle(region, (x + dx + s // 4, y - s // 3), (x + dx + s // 2, y + s), ink, -1)
        foot, tip = y - s // 4, (x + dx + 3 * s // 8, y - s)
        arrow = [(x + dx - s // 8, foot), tip, (x + dx + 7 * s // 8, foot)]
        cv2.fillPoly(region, [np.array(arrow, np.int32)], ink, cv2.LINE_AA)
    cv2.rectangle(region, (x - s, y + s + s // 4), (x + 5 * s // 4, y + s + s // 2), ink, -1)


def cardboard_top(canvas: Canvas) -> NDArray[np.uint8]:
    """Brown paper with a strip of tape."""
    image = canvas.filled((126, 172, 206))
    image += spread(4 * canvas.cloud(0.15, 3))
    mid = canvas.width // 2
    tape = canvas.px(0.03)
    image[:, mid - tape : mid + tape] = (150, 192, 216)
    image[:, mid : mid + 1] = (80, 112, 140)
    return canvas.finished(image)


def cabinet_side(canvas: Canvas) -> NDArray[np.uint8]:
    """A blue-grey steel cabinet with drawers, handles and labels."""
    image = canvas.filled((142, 118, 92))
    image += spread(3 * canvas.cloud(0.3, 3))
    for side in _sides(canvas):
        w, h = side.stop - side.start, canvas.height
        region = np.ascontiguousarray(image[:, side])
        n = max(1, round(h / canvas.density / 0.25))
        for k in range(n):
            top, bottom = round(h * k / n), round(h * (k + 1) / n)
            inset = canvas.px(0.012)
            front = (inset, top + inset), (w - inset, bottom - inset)
            cv2.rectangle(region, *front, (168, 142, 112), -1)
            cv2.rectangle(region, *front, (84, 70, 54), 1)
            y, left, right = (top + bottom) // 2, w // 2 - w // 8, w // 2 + w // 8
            cv2.rectangle(region, (left, y - 3), (right, y + 3), (215, 218, 220), -1)
            cv2.rectangle(region, (left, y + 4), (right, y + 6), (70, 60, 48), -1)
            lx, ly = w // 10, top + (bottom - top) // 4
            cv2.rectangle(region, (lx, ly), (lx + w // 6, ly + h // (6 * n)), (235, 238, 238), -1)
        image[:, side] = region
    return canvas.finished(image, _bottom_shade(canvas))


def cabinet_top(canvas: Canvas) -> NDArray[np.uint8]:
    """Steel."""
    return canvas.finished(canvas.filled((176, 150, 122)) + spread(3 * canvas.cloud(0.2, 3)))


def robot_side(canvas: Canvas) -> NDArray[np.uint8]:
    """The P3-DX from the side: red body, black band with gold sonar discs, black deck."""
    rng = canvas.rng
    image = canvas.filled((34, 30, 186))
    image += spread(4 * canvas.cloud(0.08, 3) + 2.5 * canvas.noise(0.004, 0.004))
    h, w = canvas.height, canvas.width
    deck, band = round(0.07 * h), round(0.36 * h)
    image[deck:band] = (38, 36, 36)
    image[:deck] = (26, 25, 25)
    cv2.line(image, (0, band), (w, band), (90, 84, 210), 1)
    # Real sonars sit at the front and the back, 8 each; all around looks the same from afar.
    n = max(8, round(w / canvas.density / 0.085))
    r = round(0.105 * h)
    for k in range(n):
        centre = (round((k + 0.5) * w / n), (deck + band) // 2 + 1)
        cv2.circle(image, centre, r + 2, (70, 72, 74), -1, cv2.LINE_AA)
        cv2.circle(image, centre, r, (70, 168, 214), -1, cv2.LINE_AA)
        cv2.circle(image, centre, round(0.55 * r), (110, 205, 240), 1, cv2.LINE_AA)
    # Screws, a seam and a few scratches; without them no features are found on the paint.
    for k in range(n):
        u = round((k + 0.1) * w / n)
        cv2.line(image, (u, band + 3), (u, h), (22, 20, 128), 1, cv2.LINE_AA)
        cv2.circle(image, (u + 8, band + 10), 2, (150, 150, 160), -1, cv2.LINE_AA)
        cv2.circle(image, (u + 8, h - 10), 2, (150, 150, 160), -1, cv2.LINE_AA)
    # The name appears before and behind the wheels, on the front and on the back.
    for share in (0.015, 0.25, 0.365, 0.52, 0.75, 0.87):
        x = round(share * w)
        scale = 0.0036 * h
        at, font = (x, round(0.68 * h)), cv2.FONT_HERSHEY_DUPLEX
        cv2.putText(image, "P3-DX", at, font, scale, (240, 240, 245), 2, cv2.LINE_AA)
    for _ in range(24):
        x, y = int(rng.integers(0, w)), int(rng.integers(band, h))
        dx, dy = rng.integers(-14, 15, 2)
        cv2.line(image, (x, y), (x + int(dx), y + int(dy)), (70, 66, 214), 1, cv2.LINE_AA)
    return canvas.finished(image, _bottom_shade(canvas, 0.45))


def robot_deck(canvas: Canvas) -> NDArray[np.uint8]:
    """The black plate on top, with a grid of holes and a stop button."""
    image = canvas.filled((52, 50, 50))
    image += spread(3 * canvas.noise(0.01, 0.01))
    step = max(6, canvas.px(0.05))
    for y in range(step // 2, canvas.height, step):
        for x in range(step // 2, canvas.width, step):
            cv2.circle(image, (x, y), max(1, step // 9), (120, 118, 116), -1, cv2.LINE_AA)
    centre = (canvas.width // 2, round(canvas.height * 0.8))
    cv2.circle(image, centre, canvas.px(0.03), (60, 200, 235), -1, cv2.LINE_AA)
    cv2.circle(image, centre, canvas.px(0.02), (40, 40, 220), -1, cv2.LINE_AA)
    return canvas.finished(image)


def dark_robot(canvas: Canvas) -> NDArray[np.uint8]:
    """Dark and weakly textured: the difficult robot of the benchmark."""
    image = canvas.filled((48, 46, 46))
    image += spread(3.4 * canvas.cloud(0.10, 4))
    h, w = canvas.height, canvas.width
    if canvas.material.kind.endswith("side"):
        band = round(0.36 * h)
        image[:band] -= 9
        n = max(8, round(w / canvas.density / 0.085))
        for k in range(n):
            centre = (round((k + 0.5) * w / n), band // 2)
            cv2.circle(image, centre, round(0.10 * h), (56, 58, 60), -1, cv2.LINE_AA)
    return canvas.finished(image, _bottom_shade(canvas, 0.4))


def scanner_payload(canvas: Canvas) -> NDArray[np.uint8]:
    """A laser scanner: blue housing with a black window."""
    image = canvas.filled((150, 84, 30)) + spread(3 * canvas.cloud(0.05, 2))
    h = canvas.height
    image[round(0.25 * h) : round(0.6 * h)] = (30, 28, 26)
    return canvas.finished(image)


def scanner_lid(canvas: Canvas) -> NDArray[np.uint8]:
    """The scanner from above."""
    return canvas.finished(canvas.filled((168, 100, 44)))


def wheel_disc(canvas: Canvas) -> NDArray[np.uint8]:
    """A tyre with a rim; rotationally symmetric, so that rolling shows no moving texture."""
    bright = canvas.material.kind == "wheel_disc"
    u = canvas.columns() - canvas.width / canvas.density / 2
    v = canvas.rows() - canvas.height / canvas.density / 2
    r = np.asarray(np.hypot(u, v) / (canvas.width / canvas.density / 2), np.float32)
    image = canvas.filled((34, 34, 34) if bright else (30, 30, 30))
    # Rim, ring and hub, by their share of the radius.
    for share, light, dark in (
        (0.66, (196, 198, 200), (58, 58, 60)),
        (0.5, (88, 88, 92), (40, 40, 42)),
        (0.2, (210, 212, 214), (62, 62, 64)),
    ):
        inside = 1 - smoothstep(r, share - 0.03, share + 0.03)
        image = mix(image, light if bright else dark, inside)
    return canvas.finished(image)


def rubber(canvas: Canvas) -> NDArray[np.uint8]:
    """A tyre's tread."""
    image = canvas.filled((36, 36, 36))
    stripes = np.sin(canvas.columns() * 2 * math.pi / 0.012)
    image += spread(5 * stripes * np.ones((canvas.height, 1), np.float32))
    return canvas.finished(image)


def flat(canvas: Canvas) -> NDArray[np.uint8]:
    """One flat tone."""
    return canvas.finished(canvas.filled(canvas.colour()))


def door(canvas: Canvas) -> NDArray[np.uint8]:
    """A flat leaf in a frame, with a gap between them and a handle."""
    image = canvas.filled(canvas.colour("2"))
    h, w, frame = canvas.height, canvas.width, canvas.px(0.07)
    gap = max(1, canvas.px(0.006))
    image[frame - gap :, frame - gap : w - frame + gap] = (48, 50, 52)
    image[frame : h - gap, frame : w - frame] = canvas.colour()
    x, y = w - frame - canvas.px(0.07), h - canvas.px(1.02)
    length, thick = canvas.px(0.13), max(2, canvas.px(0.022))
    plate = (x - thick, y - 2 * thick), (x + thick, y + 4 * thick)
    cv2.rectangle(image, *plate, (168, 170, 172), -1)
    cv2.rectangle(image, (x - length, y), (x, y + thick), (70, 74, 78), -1)
    return canvas.finished(image)
