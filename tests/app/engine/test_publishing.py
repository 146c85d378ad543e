"""Watched views reach their slots: drawn by the loop, or by the dense stereo thread."""

from __future__ import annotations

import os
import queue
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest

from app.contract.events import DenseStereoEvent
from app.contract.views import CLOUD_NAME, VIEW_NAMES
from app.engine import publishing
from app.engine.dense_stereo import MAX_POINTS, Cloud, DensePair, DenseStereo, dense_stereo
from app.engine.observed import Observed
from app.engine.publishing import Publisher
from app.engine.views import draw_view
from app.runtime.latest import Latest, LatestReader, LatestWriter, create_slot
from observer.camera import StereoCamera
from observer.errors import InputError
from observer.geometry import Pose
from observer.parameters import Parameters
from observer.types import Observation, Status, StereoFrame

PATIENCE_S = 10.0
WIDTH, HEIGHT = 160, 120
CAMERA = StereoCamera(WIDTH, HEIGHT, 200.0, 200.0, 80.0, 60.0, 0.1)


def image() -> Any:
    noise = np.random.default_rng(1).integers(0, 256, (HEIGHT // 3, WIDTH // 3), dtype=np.uint8)
    return cv2.resize(noise, (WIDTH, HEIGHT), interpolation=cv2.INTER_CUBIC)


def observed(index: int, **changes: Any) -> Observed:
    """A pair 8 pixels apart; the trace of a method that needs no dense stereo of its own."""
    left = image()
    trace = {"left": left, "right": np.roll(left, -8, axis=1)} | changes
    frame = StereoFrame(index, index / 10, left, left, received=50.0 + index)
    pose = Pose(np.eye(3), np.array([0, 0, 0.1 * index]))
    observation = Observation(index, frame.time, frame.received, 0, Status.OK, (), 1, pose, ())
    return Observed(frame, observation, trace, CAMERA, Parameters(), 0)


class Bench:
    """A publisher with real slots, and a list of its messages."""

    def __init__(self) -> None:
        self.fds = {name: create_slot(2_000_000) for name in (*VIEW_NAMES, CLOUD_NAME)}
        writers = {name: LatestWriter(fd) for name, fd in self.fds.items()}
        self.readers = {name: LatestReader(fd) for name, fd in self.fds.items()}
        self.told: queue.SimpleQueue[DenseStereoEvent] = queue.SimpleQueue()
        self.publisher = Publisher(writers, self.told.put)

    def wait_read(self, name: str, fits: Callable[[Latest], bool] = lambda _: True) -> Latest:
        deadline = time.monotonic() + PATIENCE_S
        while time.monotonic() < deadline:
            latest = self.readers[name].read()
            if latest is not None and fits(latest):
                return latest
            time.sleep(0.005)
        pytest.fail(f"nothing fitting was written to {name}")

    def next_told(self) -> DenseStereoEvent:
        return self.told.get(timeout=PATIENCE_S)


@pytest.fixture
def bench() -> Iterator[Bench]:
    made = Bench()
    yield made
    made.publisher.close()
    for fd in made.fds.values():
        os.close(fd)


def test_only_watched_views_are_written(bench: Bench) -> None:
    publisher, readers = bench.publisher, bench.readers
    publisher.publish(observed(1))
    assert all(reader.read() is None for reader in readers.values())
    # A new watcher sees the newest frame at once, even while nothing is played.
    publisher.watch(("left",))
    latest = readers["left"].read()
    assert latest is not None
    assert latest.header == {
        "frame": 1, "time": 0.1, "received": 51.0, "width": WIDTH, "height": HEIGHT,
    }  # fmt: skip
    publisher.publish(observed(2))
    assert [n for n, reader in readers.items() if reader.read() is not None] == ["left"]
    publisher.watch(())
    publisher.publish(observed(3))
    assert readers["left"].read(after=2) is None
    assert "dense stereo" not in {thread.name for thread in threading.enumerate()}
    with pytest.raises(InputError, match=r"no view front; there are: left, .*, cloud"):
        publisher.watch(("left", "front"))


def test_a_cloud_is_computed_when_the_method_gives_no_disparity(bench: Bench) -> None:
    bench.publisher.watch((CLOUD_NAME,))
    bench.publisher.publish(observed(4))
    latest = bench.wait_read(CLOUD_NAME)
    header, count = latest.header, latest.header["count"]
    assert (header["frame"], header["time"], header["received"]) == (4, 0.4, 54.0)
    assert np.reshape(header["T_world_camera"], (4, 4))[2, 3] == pytest.approx(0.4)
    assert 0 < count <= MAX_POINTS
    assert len(latest.payload) == count * 15
    points = np.frombuffer(latest.payload[: 12 * count], np.float32).reshape(-1, 3)
    assert np.median(points[:, 2]) == pytest.approx(200.0 * 0.1 / 8.0, rel=0.02)
    told = bench.next_told()
    assert (told.frame, told.received, told.coarseness, told.trouble) == (4, 54.0, 1, None)
    assert told.seconds > 0
    assert bench.readers["disparity"].read() is None, "nobody watches it"


def test_a_recording_gets_one_cloud_per_second_without_watchers(bench: Bench) -> None:
    kept: queue.SimpleQueue[tuple[Cloud, float]] = queue.SimpleQueue()
    for index in range(4):
        # One second apart, so that each cloud is due.
        bench.publisher.publish(observed(index), lambda *given: kept.put(given))
        cloud, received = kept.get(timeout=PATIENCE_S)
        assert received == 50.0 + index
        assert len(cloud.points) == len(cloud.colors) > 1000
        assert np.median(cloud.points[:, 2]) == pytest.approx(2.5, rel=0.01)
    soon = replace(observed(4), frame=replace(observed(4).frame, received=53.5))
    bench.publisher.publish(soon, lambda *given: kept.put(given))
    with pytest.raises(queue.Empty):
        kept.get(timeout=0.3)
    assert bench.readers[CLOUD_NAME].read() is None
    assert bench.told.empty()


def test_a_due_cloud_is_recorded_despite_newer_frames(bench: Bench) -> None:
    kept: queue.SimpleQueue[float] = queue.SimpleQueue()
    busy, free = threading.Event(), threading.Event()

    def keep(cloud: Cloud, received: float) -> None:
        del cloud
        kept.put(received)
        busy.set()
        assert free.wait(PATIENCE_S)

    bench.publisher.watch([CLOUD_NAME])
    bench.publisher.publish(observed(0), keep)
    assert busy.wait(PATIENCE_S)
    bench.publisher.publish(observed(1), keep)
    newer = observed(2)
    bench.publisher.publish(replace(newer, frame=replace(newer.frame, received=51.1)), keep)
    free.set()
    assert [kept.get(timeout=PATIENCE_S) for _ in range(2)] == [50.0, 52.0]


def test_a_later_watcher_gets_the_cloud_of_the_known_disparity(bench: Bench) -> None:
    bench.publisher.publish(observed(1))
    known = np.full((HEIGHT, WIDTH), 10.0, np.float32)
    bench.publisher.publish(observed(2, disparity=known, previous_time=0.1))
    bench.publisher.watch((CLOUD_NAME,))
    latest = bench.wait_read(CLOUD_NAME)
    assert latest.header["frame"] == 1
    count = latest.header["count"]
    points = np.frombuffer(latest.payload[: 12 * count], np.float32).reshape(-1, 3)
    assert points[:, 2] == pytest.approx(200.0 * 0.1 / 10.0)


def test_the_disparity_view_is_computed_outside_the_loop(bench: Bench) -> None:
    bench.publisher.watch(("disparity", "plain"))
    bench.publisher.publish(observed(3))
    plain = bench.readers["plain"].read()
    assert plain is not None
    latest = bench.wait_read("disparity")
    assert latest.header == plain.header
    picture = cv2.imdecode(np.frombuffer(latest.payload, np.uint8), cv2.IMREAD_COLOR)
    assert picture is not None
    assert picture.shape == (HEIGHT, WIDTH, 3)
    assert np.median(picture[:, 40:-20].max(axis=2)) > 100, "most of it is known"
    assert bench.readers[CLOUD_NAME].read() is None


def test_a_failure_is_reported_and_the_next_pair_is_processed(bench: Bench) -> None:
    bench.publisher.watch((CLOUD_NAME,))
    bench.publisher.publish(observed(1, right=np.zeros((5, 5), np.uint8)))
    told = bench.next_told()
    assert told.frame == 1
    assert (told.trouble or "").startswith("dense stereo failed: internal error (error: ")
    bench.publisher.publish(observed(2))
    assert bench.next_told().trouble is None
    assert bench.wait_read(CLOUD_NAME).header["frame"] == 2


def test_a_view_that_fails_stops_no_other_and_is_reported_once(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def fragile(name: str, seen: Observed) -> bytes:
        if name == "residual" and seen.frame.index < 3:
            raise ValueError(f"no colour in frame {seen.frame.index}")
        return draw_view(name, seen)

    monkeypatch.setattr(publishing, "draw_view", fragile)
    bench.publisher.watch(("left", "plain", "residual", "warped"))
    for index in (1, 2):
        bench.publisher.publish(observed(index))
        for name in ("left", "plain", "warped"):
            assert bench.wait_read(name).header["frame"] == index
    assert bench.publisher.troubles == (
        "drawing the view residual failed: internal error (ValueError: no colour in frame 1); "
        "see the server's log",
    )
    assert [r.getMessage() for r in caplog.records] == ["drawing the view residual failed"]
    bench.publisher.publish(observed(3))
    assert bench.wait_read("residual").header["frame"] == 3
    assert bench.publisher.troubles == ()


@pytest.mark.parametrize("gone", ["because nobody watches it", "with its source"])
def test_the_trouble_of_a_view_is_forgotten(bench: Bench, gone: str) -> None:
    def broken(name: str) -> Any:
        raise ValueError(name)

    bench.publisher.watch(("camera_left", "camera_right"))
    bench.publisher.show_cameras(observed(1).frame, broken)
    assert len(bench.publisher.troubles) == 2
    if gone == "with its source":
        bench.publisher.forget()
    else:
        bench.publisher.watch(())
    assert bench.publisher.troubles == ()


def test_a_frame_without_images_for_dense_stereo_is_reported(bench: Bench) -> None:
    bench.publisher.watch((CLOUD_NAME,))
    bare = replace(observed(1), trace={})
    bench.publisher.publish(bare)
    assert "KeyError: 'left'" in bench.publisher.troubles[0]


def test_no_result_of_a_closed_source_is_written_later(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    at_work, go_on = threading.Event(), threading.Event()

    def slow(pair: DensePair) -> DenseStereo | None:
        at_work.set()
        assert go_on.wait(PATIENCE_S)
        return dense_stereo(pair)

    monkeypatch.setattr(publishing, "dense_stereo", slow)
    bench.publisher.watch((CLOUD_NAME,))
    bench.publisher.publish(observed(1))
    assert at_work.wait(PATIENCE_S)
    bench.publisher.forget()
    go_on.set()
    assert bench.next_told().frame == 1
    assert bench.readers[CLOUD_NAME].read() is None
    bench.publisher.publish(observed(2))
    assert bench.wait_read(CLOUD_NAME).header["frame"] == 2
