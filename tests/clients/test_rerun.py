"""Rerun shows a recording: images in their cameras, clouds, frames and boxes.

Its package takes half a gigabyte, so it is not part of the set-up: ``make clients-test`` installs
it.
"""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from observer.recording.reader import Recording

chunks = pytest.importorskip("rerun.chunk", reason="needs rerun-sdk: make clients-test")
pyarrow = pytest.importorskip("pyarrow", reason="needs pyarrow, of the extra parquet")

Row = dict[str, Any]


def rows_of(path: Path) -> dict[str, list[Row]]:
    """Return a recording as read by Rerun: rows by entity, values by component, ``stamp`` in ns."""
    found: dict[str, list[Row]] = defaultdict(list)
    for chunk in chunks.McapReader(path).stream():
        batch = chunk.to_record_batch()
        columns = {}
        for name, column in zip(batch.schema.names, batch.columns, strict=True):
            if pyarrow.types.is_timestamp(column.type):
                column = column.cast(pyarrow.int64())
            columns[name.partition(":")[2] or name] = column.to_pylist()
        columns["stamp"] = columns.get("timestamp", columns.get("message_log_time"))
        if columns["stamp"] is not None and "message_encoding" not in columns:
            for values in zip(*columns.values(), strict=True):
                found[chunk.entity_path].append(dict(zip(columns, values, strict=True)))
    return found


@pytest.fixture(scope="module")
def rows(recording: Path) -> dict[str, list[Row]]:
    return rows_of(recording)


def one(value: list[Any]) -> Any:
    """Return the only instance of a component."""
    (found,) = value
    return found


def place(rows: dict[str, list[Row]], frame: str, stamp: int) -> tuple[Any, Any]:
    """Return R and t of a frame in Rerun's root frame at a time."""
    R, t = np.eye(3), np.zeros(3)
    for _ in range(10):
        known = [
            row for row in rows["/tf"] if one(row["child_frame"]) == frame and row["stamp"] <= stamp
        ]
        if not known:
            assert frame == "level"
            return R, t
        x, y, z, w = one(known[-1]["quaternion"])
        turn = np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
            ]
        )
        R, t = turn @ R, turn @ t + one(known[-1]["translation"])
        frame = one(known[-1]["parent_frame"])
    pytest.fail("the frames go round")


def test_images_are_placed_in_their_cameras(rows: dict[str, list[Row]], recording: Path) -> None:
    with Recording(recording) as read:
        stamps = [read.facts.anchor.wall_time_ns(frame.received) for frame in read.frames]
        last = read.pair(len(stamps) - 1)
    for side, pixels in zip(("left", "right"), last, strict=True):
        images, camera = rows[f"/camera/{side}/image"], rows[f"/camera/{side}/calibration"][0]
        assert [row["stamp"] for row in images] == stamps
        blob = np.array(one(images[-1]["blob"]), np.uint8)
        assert np.array_equal(cv2.imdecode(blob, cv2.IMREAD_UNCHANGED), pixels)
        # A pinhole's image plane has its own frame below the camera's.
        assert {one(row["frame"]) for row in images} == {one(camera["child_frame"])}
        assert one(camera["parent_frame"]) == f"camera_{side}"
        assert one(camera["resolution"]) == [pixels.shape[1], pixels.shape[0]]
        place(rows, f"camera_{side}", stamps[-1])


def test_every_pixel_of_a_lossless_recording_is_shown(lossless: Path) -> None:
    images = rows_of(lossless)["/camera/left/image"]
    with Recording(lossless) as read:
        assert len(images) == len(read.frames) > 0
        for k, row in enumerate(images):
            left = read.pair(k)[0]
            shown_format = one(row["format"])
            assert (shown_format["width"], shown_format["height"]) == left.shape[1::-1]
            # RGB, BGR or grey: the number of bytes fits.
            buffer = np.array(one(row["buffer"]), np.uint8)
            assert np.array_equal(buffer, left.ravel())


def test_the_cloud_is_in_front_of_the_camera_and_coloured(rows: dict[str, list[Row]]) -> None:
    assert rows["/cloud"]
    for row in rows["/cloud"]:
        points = np.array(row["positions"])
        assert len(points) == len(row["colors"]) > 1000
        assert one(row["frame"]) == "camera"
        assert (points[:, 2] > 0.1).all()
        # 0xRRGGBBAA: all are opaque, and not all have the same colour.
        assert {color & 0xFF for color in row["colors"]} == {0xFF}
        assert len(set(row["colors"])) > 100


def test_boxes_are_at_the_obstacles_and_true_bodies(
    rows: dict[str, list[Row]], recording: Path
) -> None:
    with Recording(recording) as read:
        found = [line["obstacles"] for line in read.lines()]
        true = [each.bodies for each in read.matched_truth()]
    centres = {
        "/scene/obstacles/edges": [[each["position"] for each in now] for now in found],
        "/scene/truth/edges": [[body.position for body in bodies] for bodies in true],
    }
    for topic, expected in centres.items():
        assert len(rows[topic]) == len(expected) > 0
        shown = 0
        for row, places in zip(rows[topic], expected, strict=True):
            points = np.array(row["positions"]).reshape(-1, 3)
            assert bool(len(points)) == bool(places)
            assert one(row["frame"]) == "world"
            boxes = np.split(points, max(1, len(places)))
            for box, centre in zip(boxes, places, strict=False):
                assert np.allclose(box.mean(axis=0), centre, atol=1e-3)
                # In the room, whose z is up, it is roughly on the ground.
                R, t = place(rows, "world", row["stamp"])
                assert -0.3 < (box @ R.T + t)[:, 2].min() < 0.5
                shown += 1
        assert shown > 5
