"""Writes what is watched into its slots, and nothing that is not."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

from app.channel.latest import LatestWriter
from app.engine.clouds import MIN_INTERVAL_S, CloudMaker, RateLimit
from app.engine.views import draw_view, jpeg_size
from app.engine.watched import Observed
from app.messages import CLOUD_NAME, VIEW_NAMES
from observer.errors import InputError


class Publisher:
    """Draws, encodes and writes views and the cloud while somebody watches them."""

    def __init__(self, slots: Mapping[str, LatestWriter], clock: Callable[[], float]) -> None:
        """
        Args:
            slots: one for each name in ``VIEW_NAMES`` and ``CLOUD_NAME``.
            clock: the host's monotonic clock.
        """
        self._slots = slots
        self._clock = clock
        self._watched: frozenset[str] = frozenset()
        self._newest: Observed | None = None
        self._clouds = CloudMaker()
        self._cloud_limit = RateLimit(MIN_INTERVAL_S)

    def watch(self, names: Iterable[str]) -> None:
        """Draw these from now on; what is newly watched is shown at once, also while paused.

        Raises:
            InputError: there is no such view; the sentence lists those there are.
        """
        wanted = frozenset(names)
        unknown = wanted - {*VIEW_NAMES, CLOUD_NAME}
        if unknown:
            raise InputError(
                f"there is no view {', '.join(sorted(unknown))}; "
                f"there are: {', '.join((*VIEW_NAMES, CLOUD_NAME))}"
            )
        new, self._watched = wanted - self._watched, wanted
        if self._newest is not None:
            self._draw(self._newest, new)

    def publish(self, observed: Observed) -> None:
        """Draw the watched views of the newest frame."""
        self._newest = observed
        self._clouds.remember(observed)
        wanted = self._watched
        if CLOUD_NAME in wanted and not self._cloud_limit.allows(self._clock()):
            wanted = wanted - {CLOUD_NAME}
        self._draw(observed, wanted)

    def forget(self) -> None:
        """The source is closed: what was observed of it is not shown again."""
        self._newest = None
        self._clouds = CloudMaker()

    def _draw(self, observed: Observed, names: Iterable[str]) -> None:
        frame = observed.frame
        facts = {"frame": frame.index, "time": frame.time, "received": frame.received}
        for name in names:
            if name == CLOUD_NAME:
                cloud = self._clouds.make(observed)
                if cloud is not None:
                    self._slots[name].write(cloud[0], *cloud[1])
                continue
            width, height = jpeg_size(*frame.left.shape[1::-1])
            header = {**facts, "width": width, "height": height}
            self._slots[name].write(header, draw_view(name, observed))
