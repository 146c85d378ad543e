"""Traces: what is kept, what is made later, and what never."""

from __future__ import annotations

from observer.trace import FullTrace, NoTrace


def test_only_a_full_trace_keeps_values() -> None:
    full = FullTrace()
    for trace in (full, NoTrace()):
        trace.keep("left", 1)
    assert full == {"left": 1}


def test_deferred_trace_values_are_made_once_and_only_on_request() -> None:
    made: list[str] = []

    def make() -> int:
        made.append("made")
        return 7

    trace = FullTrace()
    trace.keep_later("seven", make)
    NoTrace().keep_later("seven", make)
    assert "seven" in trace
    assert made == []
    assert trace["seven"] == trace.get("seven") == dict(trace)["seven"] == 7
    assert made == ["made"]
    assert trace.get("eight") is None
