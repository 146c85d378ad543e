"""Bare cost of OpenCV's calls: the time spent in its functions while a frame is observed.

While a recorder is on, every function of ``cv2`` and every method of its algorithms (detectors,
matchers) is wrapped in a timer. The wrapping itself costs time, so nothing else should be timed
meanwhile.
"""

from __future__ import annotations

import threading
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import cache, wraps
from types import BuiltinFunctionType, MethodDescriptorType
from typing import Any

import cv2

# Classes with functions besides the algorithms; the rest are plain data.
_OTHER_CLASSES = (cv2.KeyPoint,)


class OpenCvRecorder:
    """Sums up the time inside OpenCV's calls, by the call's name.

    A call made within another one (from Python) counts as part of that one. Calls of several
    threads are added up. Only one recorder of a process may be on at a time.
    """

    def __init__(self, clock: Callable[[], float] = time.perf_counter) -> None:
        self._clock = clock
        self._thread = threading.local()
        self._seconds: dict[str, float] = defaultdict(float)
        self._wrapped: list[tuple[Any, str, Any]] = []

    @contextmanager
    def on(self) -> Iterator[None]:
        """Record while the block runs, then restore OpenCV's functions.

        Raises:
            RuntimeError: a recorder is already on.
        """
        if any(getattr(owner, name) is not original for owner, name, original in _calls()[:1]):
            raise RuntimeError("a recorder of OpenCV's time is on already")
        if not self._wrapped:
            self._wrapped = [
                (owner, name, self._timed(owner, name, original))
                for owner, name, original in _calls()
            ]
        try:
            for owner, name, wrapper in self._wrapped:
                setattr(owner, name, wrapper)
            yield
        finally:
            for owner, name, original in _calls():
                setattr(owner, name, original)

    def take(self) -> Mapping[str, float]:
        """Return milliseconds by call since the last ``take``, and start again."""
        taken = {name: 1e3 * seconds for name, seconds in self._seconds.items()}
        self._seconds.clear()
        return taken

    def _timed(self, owner: Any, name: str, original: Any) -> Any:
        title = name if owner is cv2 else f"{owner.__name__}.{name}"
        call = original.__func__ if isinstance(original, staticmethod) else original
        thread, seconds, clock = self._thread, self._seconds, self._clock

        @wraps(call)
        def timed(*args: Any, **kwargs: Any) -> Any:
            if getattr(thread, "inside", False):
                return call(*args, **kwargs)
            thread.inside = True
            begin = clock()
            try:
                return call(*args, **kwargs)
            finally:
                seconds[title] += clock() - begin
                thread.inside = False

        return staticmethod(timed) if isinstance(original, staticmethod) else timed


@cache
def _calls() -> tuple[tuple[Any, str, Any], ...]:
    """Return what is wrapped: the module or class, the attribute, and its original value."""
    classes = [
        each
        for each in vars(cv2).values()
        if isinstance(each, type) and (issubclass(each, cv2.Algorithm) or each in _OTHER_CLASSES)
    ]
    functions = [
        (cv2, name, value)
        for name, value in vars(cv2).items()
        if isinstance(value, BuiltinFunctionType)
    ]
    methods = [
        (owner, name, value)
        for owner in dict.fromkeys(classes)
        for name, value in vars(owner).items()
        if not name.startswith("_") and isinstance(value, staticmethod | MethodDescriptorType)
    ]
    return (*functions, *methods)
