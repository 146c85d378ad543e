"""The audit queries a real service through pip-audit; here one on a port of this machine."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest

from tools.packaging import audit

ADVISORY = {
    "id": "GHSA-aaaa-bbbb-cccc",
    "aliases": ["CVE-2026-1"],
    "summary": "it opens the door",
    "affected": [
        {
            "package": {"name": "leaky", "ecosystem": "PyPI"},
            "ranges": [{"type": "ECOSYSTEM", "events": [{"introduced": "0"}, {"fixed": "1.1"}]}],
        }
    ],
}


@dataclass
class Service:
    """A vulnerability service that knows one advisory, and records its requests."""

    options: list[str]
    asked: list[str] = field(default_factory=list)


@pytest.fixture
def service(tmp_path: Path) -> Iterator[Service]:
    class Handler(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            told = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
            known.asked.append(f"{told['package']['name']} {told['version']}")
            found: dict[str, Any] = {"vulns": [ADVISORY]} if known.asked[-1] == "leaky 1.0" else {}
            body = json.dumps(found).encode()
            self.send_response(200)
            self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, *_: object) -> None:
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
        address = f"http://127.0.0.1:{server.server_port}/"
        options = ["--vulnerability-service", "osv", "--osv-url", address]
        known = Service([*options, "--cache-dir", str(tmp_path / "cache")])
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield known
        server.shutdown()
        thread.join()


def project(folder: Path, *pins: str) -> Path:
    (folder / "constraints.txt").write_text("# pinned\n" + "\n".join(pins) + "\n")
    (folder / "pyproject.toml").write_text("[tool.audit.accepted]\n")
    return folder


def test_every_pin_of_this_project_can_be_looked_up(service: Service, repository: Path) -> None:
    found = audit.audit(repository / "constraints.txt", service.options)
    assert found.vulnerabilities == found.unknown == ()
    # The first request only checks that the service answers.
    assert service.asked[0].startswith("pip-audit ")
    assert len(service.asked) - 1 == found.checked > 100


def test_a_known_vulnerability_fails_and_names_the_fixed_version(
    service: Service,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(audit, "ROOT", project(tmp_path, "leaky==1.0", "sound==2"))
    assert audit.main(service.options) == 1
    (told,) = capsys.readouterr().err.splitlines()
    assert told == "leaky 1.0: CVE-2026-1, GHSA-aaaa-bbbb-cccc (fixed in 1.1): it opens the door"


@pytest.mark.parametrize(
    ("accepted", "sentences"),
    [
        ({"CVE-2026-1": "no door here"}, []),
        ({"GHSA-aaaa-bbbb-cccc": "no door here"}, []),
        ({"CVE-2026-1": ""}, ["CVE-2026-1 is accepted without a reason"]),
        (
            {"CVE-2026-1": "no door here", "CVE-1": "old"},
            ["CVE-1 is accepted, but no pinned package has it any more; remove it"],
        ),
    ],
)
def test_an_accepted_vulnerability_needs_a_reason_and_must_still_exist(
    accepted: dict[str, str], sentences: list[str]
) -> None:
    ids = ("CVE-2026-1", "GHSA-aaaa-bbbb-cccc")
    found = audit.Audit((audit.Vulnerability("leaky 1.0", ids, (), "it opens"),), 2, ())
    assert audit.problems(found, accepted) == sentences


def test_an_unreachable_service_is_reported_in_one_line(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    free_port: int,
) -> None:
    monkeypatch.setattr(audit, "ROOT", project(tmp_path, "leaky==1.0"))
    unreachable = ["--vulnerability-service", "osv", "--osv-url", f"http://127.0.0.1:{free_port}/"]
    assert audit.main(unreachable) == 0
    told = capsys.readouterr().err
    assert told.startswith("Known vulnerabilities of packages were not looked up: ")
    assert len(told.splitlines()) == 1
