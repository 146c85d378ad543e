"""The observation lines that pages receive."""

from __future__ import annotations

from app.contract.events import live_line
from observer.jsonl import observation_line

from .test_pictures import observed


def test_live_lines_omit_only_silhouettes() -> None:
    line = observation_line(observed().observation)
    told = live_line(line)
    ((before,), (after,)) = line["obstacles"], told["obstacles"]
    assert before["silhouette"], "the line itself keeps it: it is recorded"
    assert "silhouette" not in after
    assert {**after, "silhouette": before["silhouette"]} == before
    assert {**told, "obstacles": []} == {**line, "obstacles": []}
