"""The recorder of OpenCV's time: what it counts, and that it leaves nothing behind."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Sequence

import cv2
import numpy as np
import pytest

from observer.evaluation.opencv_time import OpenCvRecorder

IMAGE = np.random.default_rng(0).integers(0, 255, (120, 160), dtype=np.uint8)


def ticking(step: float = 1.0) -> Iterator[float]:
    now = 0.0
    while True:
        yield now
        now += step


def recorder(step: float = 1.0) -> OpenCvRecorder:
    """Return one whose clock advances by ``step`` seconds per reading: each call takes one step."""
    ticks = ticking(step)
    return OpenCvRecorder(lambda: next(ticks))


def wrappable() -> dict[str, object]:
    """Return the attributes of OpenCV that the recorder may wrap."""
    found: dict[str, object] = {f"cv2.{k}": v for k, v in vars(cv2).items() if callable(v)}
    for owner in (cv2.Feature2D, cv2.FastFeatureDetector, cv2.StereoMatcher, cv2.KeyPoint):
        found |= {f"{owner.__name__}.{k}": v for k, v in vars(owner).items()}
    return found


def test_functions_and_methods_are_counted_by_name() -> None:
    matcher = cv2.StereoBM.create(16, 9)  # made before
    timed = recorder(0.001)
    with timed.on():
        cv2.blur(IMAGE, (3, 3))
        cv2.blur(IMAGE, ksize=(3, 3))
        cv2.FastFeatureDetector.create(20).detect(IMAGE)
        matcher.compute(IMAGE, IMAGE)
        matcher.setUniquenessRatio(5)
        cv2.KeyPoint.convert([cv2.KeyPoint(1, 2, 3)])
    assert timed.take() == {
        "blur": pytest.approx(2.0),
        "FastFeatureDetector.create": pytest.approx(1.0),
        "Feature2D.detect": pytest.approx(1.0),
        "StereoMatcher.compute": pytest.approx(1.0),
        "StereoBM.setUniquenessRatio": pytest.approx(1.0),
        "KeyPoint.convert": pytest.approx(1.0),
    }
    assert timed.take() == {}


def test_recorded_calls_return_opencv_results() -> None:
    def work() -> tuple[np.ndarray, list[Sequence[float]], np.ndarray]:
        points = cv2.FastFeatureDetector.create(20).detect(IMAGE)
        disparity = cv2.StereoSGBM.create(numDisparities=16, blockSize=5).compute(IMAGE, IMAGE)
        return cv2.resize(IMAGE, (80, 60)), [p.pt for p in points], disparity

    bare = work()
    with OpenCvRecorder().on():
        timed = work()
    np.testing.assert_array_equal(bare[0], timed[0])
    assert bare[1] == timed[1]
    np.testing.assert_array_equal(bare[2], timed[2])


def test_opencv_is_restored_afterwards_even_after_an_error() -> None:
    before = wrappable()
    timed = recorder()
    with pytest.raises(cv2.error), timed.on():
        cv2.blur(IMAGE, (-3, 3))
    assert wrappable() == before
    assert timed.take() == {"blur": pytest.approx(1000)}
    cv2.blur(IMAGE, (3, 3))
    assert timed.take() == {}


def test_recorder_is_reusable_but_not_nested() -> None:
    before = wrappable()
    timed = recorder()
    for _ in range(3):
        with timed.on():
            cv2.blur(IMAGE, (3, 3))
    assert timed.take() == {"blur": pytest.approx(3000)}
    with timed.on():
        with pytest.raises(RuntimeError, match="on already"), recorder().on():
            pass
        # The refused second recorder did not end the first.
        cv2.blur(IMAGE, (3, 3))
    assert timed.take() == {"blur": pytest.approx(1000)}
    assert wrappable() == before


def test_nested_call_is_not_counted_twice() -> None:
    """OpenCV sometimes calls back into Python, and the callback may call OpenCV again."""
    timed = recorder()
    inner = cv2.blur

    def calls_back(*_: object) -> None:
        # While the recorder is on, this is the wrapped function.
        assert cv2.blur is not inner
        cv2.blur(IMAGE, (3, 3))

    wrapped = timed._timed(cv2, "outer", calls_back)
    with timed.on():
        wrapped()
    assert timed.take() == {"outer": pytest.approx(1000)}
    with timed.on():
        cv2.blur(IMAGE, (3, 3))
    assert timed.take() == {"blur": pytest.approx(1000)}


def test_calls_from_other_threads_are_counted() -> None:
    timed = OpenCvRecorder()
    with timed.on():
        thread = threading.Thread(target=cv2.blur, args=(IMAGE, (3, 3)))
        thread.start()
        thread.join()
    assert timed.take()["blur"] > 0
