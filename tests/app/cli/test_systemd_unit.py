"""The unit that starts the server with the computer."""

from __future__ import annotations

import configparser
import shutil
import subprocess
from pathlib import Path

import pytest

from .shell import Shell


def unit(text: str) -> configparser.ConfigParser:
    parser = configparser.ConfigParser(interpolation=None)
    parser.optionxform = str  # type: ignore[assignment, method-assign]
    parser.read_string(text)
    return parser


def test_the_unit_starts_this_installation_with_the_given_options(
    shell: Shell, tmp_path: Path
) -> None:
    done = shell(
        "systemd-unit", "video:/srv/left 1.mp4,/srv/100%.mp4", "--port", "9000",
        "--data", str(tmp_path), "--allowed-host", "lab.example", "--user", "ada",
    )  # fmt: skip
    assert (done.code, done.err) == (0, "")
    service = unit(done.out)["Service"]
    assert service["User"] == "ada"
    start = service["ExecStart"]
    assert start.startswith("/")
    assert Path(start.split()[0]).exists()
    assert '"video:/srv/left 1.mp4,/srv/100%%.mp4"' in start
    assert "--port 9000" in start
    assert f"--data {tmp_path}" in start
    assert f"--token-file {tmp_path}/token" in start
    assert "--allowed-host lab.example" in start
    assert "--no-browser" in start


def test_the_unit_keeps_settings_of_the_environment(
    shell: Shell, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    given = {
        "DATABASE": "postgresql://ada:a b%c$d\"@db/lab", "TRUTH": "vrpn:tracker", "STRICT": "true",
        "VIEWER_POINTS": "5000",
    }  # fmt: skip
    for name, value in given.items():
        monkeypatch.setenv(f"DYNAMIC_OBSERVER_{name}", value)
    done = shell("systemd-unit", "--data", str(tmp_path), "--user", "ada")
    assert (done.code, done.err) == (0, "")
    lines = done.out.splitlines()
    (start,) = [line for line in lines if line.startswith("ExecStart=")]
    assert start.endswith(" --truth vrpn:tracker --strict")
    assert [line for line in lines if line.startswith("Environment=")] == [
        r'Environment="DYNAMIC_OBSERVER_DATABASE=postgresql://ada:a b%%c$d\"@db/lab"',
        "Environment=DYNAMIC_OBSERVER_VIEWER_POINTS=5000",
    ]


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        (("--user", "no-such-user"), "there is no user"),
        (("--user", "a b", "--data", "/srv"), "is not a user name"),
        (("--user", "ada\nExecStartPre=/bin/false", "--data", "/srv"), "is not a user name"),
        (("simulated:lab\nUser=root",), "a systemd unit cannot hold"),
        (("--tls-cert", "cert.pem"), "--tls-key"),
    ],
)
def test_invalid_users_and_options_are_refused(
    shell: Shell, arguments: tuple[str, ...], part: str
) -> None:
    done = shell("systemd-unit", *arguments)
    assert done.code == 2
    assert part in done.err


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="there is no systemd-analyze")
def test_systemd_accepts_the_unit(shell: Shell, tmp_path: Path) -> None:
    file = tmp_path / "dynamic-observer.service"
    file.write_text(shell("systemd-unit", "--data", str(tmp_path), "--user", "root").out)
    done = subprocess.run(
        ["systemd-analyze", "verify", str(file)],
        capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, "")
