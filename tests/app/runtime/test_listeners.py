"""Listeners hear every event in order, whatever others do."""

from __future__ import annotations

from app.runtime.listeners import Listeners


def test_every_listener_hears_every_event_in_order() -> None:
    listeners: Listeners[str] = Listeners()
    first: list[str] = []
    second: list[str] = []
    listeners.subscribe(first.append)
    listeners.publish("one")
    listeners.subscribe(second.append)
    listeners.publish("two")
    assert (first, second) == (["one", "two"], ["two"])


def test_a_listener_that_fails_affects_no_other() -> None:
    listeners: Listeners[str] = Listeners()
    heard: list[str] = []

    def fail(event: str) -> None:
        raise RuntimeError(event)

    listeners.subscribe(fail)
    listeners.subscribe(heard.append)
    listeners.publish("one")
    assert heard == ["one"]


def test_a_listener_may_leave_during_an_event_and_twice() -> None:
    listeners: Listeners[str] = Listeners()
    heard: list[str] = []

    def once(event: str) -> None:
        heard.append(event)
        leave()

    leave = listeners.subscribe(once)
    listeners.subscribe(heard.append)
    listeners.publish("one")
    listeners.publish("two")
    leave()
    assert heard == ["one", "one", "two"]
