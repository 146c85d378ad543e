"""Live motion capture as a person chose it; it is found again after a restart of the server."""

from __future__ import annotations

import asyncio
import contextlib
from dataclasses import replace
from typing import Any

from app.contract.commands import LiveTruthOrder, SetTruth
from app.contract.live_truth import LiveTruthStatus
from app.server.asking import ask
from app.server.errors import FieldError, NotAvailable
from app.server.shared import Shared
from observer.errors import TruthError
from observer.truth.live.opening import check_live

_KEY = "live_truth"
_LONGEST_SPEC = 300


class LiveTruthManager:
    """Used in the event loop.

    Attributes:
        order: what is listened to, None where nothing is.
    """

    def __init__(self, shared: Shared, spec: str | None) -> None:
        """
        Args:
            spec: takes the place of what was chosen before.
        """
        self.order: LiveTruthOrder | None = None
        self._shared = shared
        self._storage = shared.storage
        self._spec = spec

    def load(self) -> None:
        """Find what was chosen before; the server's start is another thread."""
        kept = _order(self._storage.get_setting(_KEY))
        if self._spec is not None and (kept is None or kept.spec != self._spec):
            # Bodies have the names of another system.
            kept = LiveTruthOrder(self._spec)
            self._storage.set_setting(_KEY, _plain(kept))
        self.order = kept

    async def choose(self, order: LiveTruthOrder | None) -> LiveTruthStatus | None:
        """Listen to this from now on, and keep it; what is open stays open.

        Returns:
            As ``StateEvent.truth`` holds it; None also where no engine is there to listen yet.

        Raises:
            FieldError: it names no live motion capture; nothing is changed then.
            StorageError: it could not be kept; nothing is changed.
        """
        async with self._shared.lock:
            if order is not None:
                order = checked(order)
            await asyncio.to_thread(self._storage.set_setting, _KEY, _plain(order))
            self.order = order
            facts: LiveTruthStatus | None = None
            with contextlib.suppress(NotAvailable):
                # An engine that is being started anew opens its source with it.
                facts = await ask(self._shared.engine, SetTruth(order), field=("body", "spec"))
            self._shared.followers.status_changed()
            return facts


def checked(order: LiveTruthOrder) -> LiveTruthOrder:
    """The order, if it can be carried out.

    Raises:
        FieldError: it names no live motion capture, or the observer is to be ignored.
    """
    spec = order.spec.strip()
    if not spec.isprintable() or len(spec) > _LONGEST_SPEC:
        raise FieldError(("body", "spec"), "give vrpn:HOST, vrpn:HOST:PORT/NAME or vicon-udp:PORT")
    try:
        check_live(spec)
    except TruthError as error:
        raise FieldError(("body", "spec"), str(error)) from error
    if order.observer is not None and order.observer in order.ignore:
        raise FieldError(
            ("body", "ignore"),
            f"{order.observer} carries the camera and cannot be ignored as well; take one back",
        )
    return replace(order, spec=spec)


def _plain(order: LiveTruthOrder | None) -> dict[str, Any] | None:
    if order is None:
        return None
    return {"spec": order.spec, "observer": order.observer, "ignore": list(order.ignore)}


def _order(plain: Any) -> LiveTruthOrder | None:
    """What was kept; None for what this version cannot use."""
    with contextlib.suppress(KeyError, TypeError, FieldError):
        return checked(
            LiveTruthOrder(str(plain["spec"]), plain["observer"], tuple(plain["ignore"]))
        )
    return None
