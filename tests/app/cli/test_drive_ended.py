"""``dynamic-observer drive`` ended by a signal or killed: the server soon knows."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

from .scripted_server import TOKEN, ScriptedServer


def test_a_signal_ends_the_command_and_stops_the_robots_immediately(
    server: ScriptedServer, tmp_path: Path
) -> None:
    server.kept["mine"] = "name: mine\nsteps: {obstacle: [{seconds: 30, speed_mps: 0.5}]}"
    file = tmp_path / "token"
    file.write_text(TOKEN + "\n")
    command = [sys.executable, "-m", "app.cli", "drive", "mine", "--json", "--token-file",
               str(file), "--server", f"127.0.0.1:{server.port}"]  # fmt: skip
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        while server.programme is None or server.facts()["programme"]["elapsed_s"] < 0.3:
            assert process.poll() is None, process.communicate()
            time.sleep(0.02)
        sent = time.monotonic()
        process.terminate()
        out, err = process.communicate(timeout=20)
    released = [t for t, m in server.said if m["type"] == "release"]
    sys.stdout.write(f"released {1000 * (released[0] - sent):.0f} ms after SIGTERM" + "\n")
    assert released[0] - sent < 1.0
    assert process.returncode == 128 + signal.SIGTERM
    assert json.loads(out)["finished"] is False
    assert err == "interrupted; the robots are stopped and disarmed\n"
    assert server.programme is None
    assert not server.armed


def test_a_killed_command_no_longer_counts_as_present(server: ScriptedServer) -> None:
    server.kept["mine"] = "name: mine\nsteps: {obstacle: [{seconds: 30, speed_mps: 0.5}]}"
    command = [sys.executable, "-m", "app.cli", "drive", "mine", "--token", TOKEN,
               "--server", f"http://127.0.0.1:{server.port}/"]  # fmt: skip
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        while server.programme is None:
            assert process.poll() is None
            time.sleep(0.02)
        process.kill()
        process.wait()
        killed = time.monotonic()
        assert server.programme is not None
    server.fresh_s = 0.25
    while server.facts()["programme"] is not None:
        assert time.monotonic() < killed + 5
        time.sleep(0.01)
    assert server.ended_at is not None
    took = 1000 * (server.ended_at - killed)
    sys.stdout.write(f"nobody present {took:.0f} ms after SIGKILL\n")
    assert server.why["obstacle"] == "nobody was present for the obstacle"
