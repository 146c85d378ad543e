"""The command line as a shell sees it: a process, its exit code, its stdout and stderr."""

from __future__ import annotations

import json
import os
import pty
import subprocess
import sys
from pathlib import Path

import pytest

from app.cli.command_line import COMMANDS, load_command

from .shell import Shell, in_a_process


def test_observe_writes_exactly_one_valid_line_per_frame(shell: Shell, tmp_path: Path) -> None:
    output = tmp_path / "tracks.jsonl"
    done = shell("observe", "simulated:lab", "--frames", "6", "--output", str(output))
    assert (done.code, done.out) == (0, ""), done.err
    lines = [json.loads(text) for text in output.read_text().splitlines()]
    assert [line["frame"] for line in lines] == list(range(6))
    assert [round(line["time"], 6) for line in lines] == [round(i / 15, 6) for i in range(6)]
    for line in lines:
        assert line["status"] in ("ok", "degraded", "lost")
        assert {"segment", "reasons", "pose", "obstacles", "timings_ms"} <= line.keys()


def test_observe_writes_to_stdout_by_default_and_is_repeatable(shell: Shell) -> None:
    arguments = ("observe", "simulated:lab?seed=4", "--frames", "4")
    first, second = in_a_process(*arguments), shell(*arguments)
    assert first.code == 0, first.err

    def results(text: str) -> list[dict[str, object]]:
        lines = [json.loads(line) for line in text.splitlines()]
        for line in lines:
            del line["timings_ms"]
        return lines

    assert results(first.out) == results(second.out)
    assert len(results(first.out)) == 4


def test_simulate_then_observe_then_evaluate(shell: Shell, tmp_path: Path) -> None:
    folder, tracks = tmp_path / "short", tmp_path / "tracks.jsonl"
    scenario = tmp_path / "short.yaml"
    scenario.write_text("based_on: lateral\nduration_s: 2\n")
    made = shell("simulate", str(scenario), "--seed", "3", "--output", str(folder))
    assert made.code == 0, made.err
    assert {"left", "right", "times.txt", "calibration.yaml", "truth.csv"} <= {
        path.name for path in folder.iterdir()
    }
    seen = shell("observe", str(folder), "--output", str(tracks))
    assert seen.code == 0, seen.err
    judged = shell("evaluate", str(tracks), "--truth", str(folder / "truth.csv"), "--json")
    assert judged.code == 0, judged.err
    figures = json.loads(judged.out)
    assert 0 <= figures["recall"] <= 1
    assert figures["frames"] == len(tracks.read_text().splitlines())


def test_simulate_stops_after_the_requested_frames(shell: Shell, tmp_path: Path) -> None:
    folder = tmp_path / "lab"
    made = shell("simulate", "lab", "--frames", "2", "--output", str(folder))
    assert made.code == 0, made.err
    assert len(list((folder / "left").iterdir())) == 2
    assert len((folder / "times.txt").read_text().splitlines()) == 2


def test_unreadable_truth_beside_images_is_noted_but_not_refused(
    shell: Shell, tmp_path: Path
) -> None:
    folder, tracks = tmp_path / "lab", tmp_path / "tracks.jsonl"
    assert shell("simulate", "lab", "--frames", "2", "--output", str(folder)).code == 0
    for text in ("TX,TY\n1,2\n", (folder / "truth.csv").read_text() + "1,2\n"):
        (folder / "truth.csv").write_text(text)
        done = shell("observe", str(folder), "--output", str(tracks))
        assert (done.code, done.out) == (0, "")
        assert done.err.startswith("ground truth: truth.csv")
        assert "the images are processed without it" in done.err
        assert len(tracks.read_text().splitlines()) == 2


@pytest.mark.parametrize("command", ["observe", "simulate"])
def test_a_terminal_shows_progress_immediately(command: str, tmp_path: Path) -> None:
    arguments = {
        "observe": ("observe", "simulated:lab", "--frames", "2", "--output"),
        "simulate": ("simulate", "lab", "--frames", "2", "--output"),
    }[command]
    # The output must come before the method is imported: that import ends the process.
    code = (
        "import os, sys\n"
        "from app.cli import main\n"
        "class Late:\n"
        "    def find_spec(self, name, *_):\n"
        "        if name in ('cv2', 'numpy'):\n"
        "            os._exit(7)\n"
        "sys.meta_path.insert(0, Late())\n"
        "main()\n"
    )
    primary, terminal = pty.openpty()
    try:
        done = subprocess.run(
            [sys.executable, "-c", code, *arguments, str(tmp_path / "out")],
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=terminal, timeout=60,
            env={**os.environ, "TERM": "xterm", "COLUMNS": "100"}, check=False,
        )  # fmt: skip
        shown = os.read(primary, 65536).decode()
    finally:
        os.close(primary)
        os.close(terminal)
    assert (done.returncode, done.stdout) == (7, b"")
    assert {"observe": "opening simulated:lab", "simulate": "rendering lab"}[command] in shown


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        (("observe", "/no/such/folder"), "/no/such/folder"),
        (("observe", "simulated:moon"), "moon"),
        (("observe", "magic:1"), "unknown kind of source 'magic'"),
        (("observe", "simulated:lab", "--calibration", "/no/such.yaml"), "/no/such.yaml"),
        (("observe", "simulated:lab", "--set", "flow.nothing=1"), "flow.nothing"),
        (("observe", "simulated:lab", "--frames", "0"), "--frames"),
        (("observe",), "source"),
        (("evaluate", "/no/tracks.jsonl", "--truth", "/no/truth.csv"), "/no/"),
        (("serve", "--port", "99999"), "port"),
        (("frobnicate",), "frobnicate"),
    ],
)
def test_invalid_input_gives_a_one_line_error_and_exit_code_2(
    shell: Shell, arguments: tuple[str, ...], part: str
) -> None:
    done = shell(*arguments)
    assert (done.code, done.out) == (2, "")
    sentences = done.err.strip().splitlines()
    assert len(sentences) == 1, done.err
    assert part in sentences[0]


def test_a_failed_process_prints_one_line_and_exits_with_code_2() -> None:
    done = in_a_process("observe", "magic:1")
    assert (done.code, done.out) == (2, "")
    assert done.err.startswith("dynamic-observer: unknown kind of source 'magic'")
    assert done.err.count("\n") == 1


@pytest.mark.parametrize("name", COMMANDS)
def test_command_list_matches_each_command_help(name: str) -> None:
    own = load_command(name).help
    assert own.replace("\n", " ").startswith(COMMANDS[name])
    assert load_command(name).name == name


def test_a_negative_number_is_answered_with_how_to_write_it(shell: Shell) -> None:
    for arguments in (("go", "-5"), ("go", "1.0", "-0.5")):
        done = shell(*arguments)
        assert done.code == 2
        assert "put -- before a negative number" in done.err
    assert "negative" not in shell("go", "-x").err


def test_help_lists_every_command_in_order(shell: Shell) -> None:
    done = shell("--help")
    assert (done.code, done.err) == (0, "")
    _, _, listed = done.out.partition("Commands:\n")
    assert "..." not in listed
    assert [line.split()[0] for line in listed.splitlines()] == list(COMMANDS)


@pytest.mark.parametrize(
    "arguments",
    [
        ("--help",),
        # An emulated robot needs numpy, which alone takes a tenth of a second.
        *((name, "--help") for name in COMMANDS if name != "emulate"),
    ],
)
def test_help_imports_no_heavy_packages(arguments: tuple[str, ...]) -> None:
    code = (
        "import sys\n"
        "from app.cli import main\n"
        "try:\n"
        "    main()\n"
        "except SystemExit:\n"
        "    print(*sorted({name.partition('.')[0] for name in sys.modules}), file=sys.stderr)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, *arguments], capture_output=True, text=True, timeout=60,
        check=True,
    )  # fmt: skip
    heavy = {"cv2", "numpy", "scipy", "matplotlib", "fastapi", "sqlalchemy", "alembic", "viser"}
    assert heavy & set(done.stderr.split()) == set()


def test_a_mistyped_command_suggests_the_right_one(shell: Shell) -> None:
    assert "Did you mean 'chart'?" in shell("chartt").err
