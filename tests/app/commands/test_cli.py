"""The command line as a shell sees it: a process, its exit code, its stdout and stderr."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest


def dynamic_observer(*arguments: str, timeout_s: float = 100) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "app.cli", *arguments],
        capture_output=True,
        text=True,
        timeout=timeout_s,
        stdin=subprocess.DEVNULL,
        check=False,
    )


def test_observe_writes_one_valid_line_for_every_frame_and_nothing_else(tmp_path: Path) -> None:
    output = tmp_path / "tracks.jsonl"
    done = dynamic_observer("observe", "simulated:lab", "--frames", "6", "--output", str(output))
    assert (done.returncode, done.stdout) == (0, ""), done.stderr
    lines = [json.loads(text) for text in output.read_text().splitlines()]
    assert [line["frame"] for line in lines] == list(range(6))
    assert [round(line["time"], 6) for line in lines] == [round(i / 15, 6) for i in range(6)]
    for line in lines:
        assert line["status"] in ("ok", "degraded", "lost")
        assert {"segment", "reasons", "pose", "obstacles", "timings_ms"} <= line.keys()


def test_observe_writes_to_stdout_without_output_and_is_repeatable() -> None:
    first, second = (
        dynamic_observer("observe", "simulated:lab?seed=4", "--frames", "4") for _ in range(2)
    )
    assert first.returncode == 0, first.stderr

    def results(text: str) -> list[dict[str, object]]:
        lines = [json.loads(line) for line in text.splitlines()]
        for line in lines:
            del line["timings_ms"]
        return lines

    assert results(first.stdout) == results(second.stdout)
    assert len(results(first.stdout)) == 4


def test_simulate_then_observe_then_evaluate(tmp_path: Path) -> None:
    folder, tracks = tmp_path / "lateral", tmp_path / "tracks.jsonl"
    made = dynamic_observer("simulate", "lateral", "--seed", "3", "--output", str(folder))
    assert made.returncode == 0, made.stderr
    assert {"left", "right", "times.txt", "calibration.yaml", "truth.csv"} <= {
        path.name for path in folder.iterdir()
    }
    seen = dynamic_observer("observe", str(folder), "--output", str(tracks))
    assert seen.returncode == 0, seen.stderr
    judged = dynamic_observer(
        "evaluate", str(tracks), "--truth", str(folder / "truth.csv"), "--json"
    )
    assert judged.returncode == 0, judged.stderr
    figures = json.loads(judged.stdout)
    assert 0 <= figures["recall"] <= 1
    assert figures["frames"] == len(tracks.read_text().splitlines())


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        (("observe", "/no/such/folder"), "/no/such/folder"),
        (("observe", "simulated:moon"), "moon"),
        (("observe", "magic:1"), "there is no kind of source 'magic'"),
        (("observe", "simulated:lab", "--calibration", "/no/such.yaml"), "/no/such.yaml"),
        (("observe", "simulated:lab", "--set", "flow.nothing=1"), "flow.nothing"),
        (("observe", "simulated:lab", "--frames", "0"), "--frames"),
        (("observe",), "source"),
        (("evaluate", "/no/tracks.jsonl", "--truth", "/no/truth.csv"), "/no/"),
        (("serve", "--port", "99999"), "port"),
        (("frobnicate",), "frobnicate"),
    ],
)
def test_wrong_input_is_one_sentence_and_exit_code_2(arguments: tuple[str, ...], part: str) -> None:
    done = dynamic_observer(*arguments)
    assert done.returncode == 2
    assert done.stdout == ""
    sentences = done.stderr.strip().splitlines()
    assert len(sentences) == 1, done.stderr
    assert part in sentences[0]
