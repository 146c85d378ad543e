"""Unauthorised access, and starting with a bad configuration.

A server of the simulated lab as a user starts it, with engine, drive process and 3D view; anyone
let in could drive its robots. The operations are taken from the server's own API description.
"""

from __future__ import annotations

import itertools
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from app.storage import Storage
from tools import ROOT

from .bench import Refused, served, wait_until
from .web import SOCKETS, Web, listed, nothing_changes, told

EVIL = "http://evil.example"
FILES = "multipart/form-data; boundary=x"
FORMS = ("text/plain", "application/x-www-form-urlencoded", FILES)
TAKE_FILES = ("/api/calibrations", "/api/calibrating/images", "/api/truth")
PUBLIC = {"/healthz", "/readyz", "/sign-in"}
STOP_S = 0.3
GUESSERS = 4
GUESSING_S = 2.0

pytestmark = [pytest.mark.slow, pytest.mark.timeout(120)]


def everything(web: Web) -> Iterator[tuple[str, str]]:
    """Yield method and path of all described operations and of everything else."""
    for operation in web.operations:
        yield operation.method, operation.path
    for path in (
        "/",
        "/docs",
        "/docs/start.js",
        "/openapi.json",
        "/metrics",
        "/viewer",
        "/viewer/",
    ):
        yield "GET", path
    static = ROOT / "static"
    for file in static.rglob("*"):
        if file.is_file() and "node_modules" not in file.parts:
            yield "GET", f"/static/{file.relative_to(static).as_posix()}"
    for method, path in itertools.product(("GET", "POST", "DELETE", "TRACE"), ("/no/such", "/api")):
        yield method, path


def test_cross_site_requests_are_refused(web: Web) -> None:
    counted = Counter[int]()
    foreign = [{"Origin": EVIL}, {"Origin": "null"}]
    foreign += [{"Sec-Fetch-Site": site} for site in ("cross-site", "same-site")]
    tried = [{"Content-Type": "application/json", **sender} for sender in foreign]
    # Without headers that tell the origin of the page, only the content type can give it away.
    tried += [{"Content-Type": kind} for kind in FORMS] + [{}]
    body = b'{"paused": true, "text": "x", "name": "evil", "source": "simulated:lab"}'
    with nothing_changes(web):
        for operation in filter(lambda each: each.acts, web.operations):
            for headers in tried:
                if headers == {"Content-Type": FILES} and operation.path in TAKE_FILES:
                    continue
                answer = web.http.request(
                    operation.method, operation.path, content=body, headers=headers
                )
                counted[answer.status_code] += 1
                where = (operation.method, operation.path, headers, answer.text)
                assert answer.status_code in (403, 415), where
    told(30, "requests of other sites", f"{listed(counted)}; nothing changes")


def test_a_rebound_host_is_refused(web: Web) -> None:
    counted = Counter[int]()
    names = ("evil.example", f"evil.example:{web.server.port}", "127.0.0.1.evil.example")
    with nothing_changes(web):
        for name in names:
            for method, path in everything(web) if name == names[0] else [("GET", "/")]:
                answer = web.http.request(method, path, headers={"Host": name})
                counted[answer.status_code] += 1
                assert answer.status_code == 400, (method, path, name)
            for path in SOCKETS:
                status, _ = web.answer(web.handshake(path, f"Host: {name}"))
                counted[status] += 1
                assert status == 400, (path, name)
    told(31, "rebound Host, also of WebSockets", listed(counted))


def test_a_foreign_origin_is_refused(web: Web) -> None:
    counted = Counter[int]()
    near = f"http://127.0.0.1:{web.server.port + 1}"
    for path in SOCKETS:
        for origin in (EVIL, "null", near, "file://", f"{EVIL}:{web.server.port}"):
            status, _ = web.answer(web.handshake(path, f"Origin: {origin}"))
            counted[status] += 1
            assert status == 403, (path, origin)
    told(32, "WebSockets of a foreign Origin", listed(counted))


def test_requests_without_the_token_are_refused(web: Web) -> None:
    counted = Counter[int]()
    with nothing_changes(web):
        for method, path in everything(web):
            answer = web.stranger.request(method, path, json={} if method != "GET" else None)
            counted[answer.status_code] += 1
            assert answer.status_code == 401, (method, path, answer.text[:200])
        for path in SOCKETS:
            status, _ = web.answer(web.handshake(path, signed_in=False))
            counted[status] += 1
            assert status == 401, path
    assert {path for path in PUBLIC if web.stranger.get(path).is_success} == PUBLIC
    told(
        33,
        "no token",
        f"{listed(counted)} for {len(web.operations)} operations, pages, files, the viewer and "
        f"{len(SOCKETS)} WebSockets; nothing reaches the robots",
    )


def test_guessing_the_token_is_throttled(web: Web) -> None:
    counted, stops = Counter[int](), []
    ends = time.monotonic() + GUESSING_S
    lock = threading.Lock()

    def guess(number: int) -> None:
        for attempt in itertools.count():
            if time.monotonic() > ends:
                return
            # Correct except for the last character.
            last = "-" if web.server.token[-1] != "-" else "_"
            line = f"Authorization: Bearer {web.server.token[:-1]}{last}"
            if (attempt + number) % 2:
                sent = web.handshake("/api/drive", line, signed_in=False)
            else:
                sent = web.head("POST", "/api/robots/reset", line, signed_in=False)
            status, _ = web.answer(sent)
            with lock:
                counted[status] += 1

    guessers = [threading.Thread(target=guess, args=(each,)) for each in range(GUESSERS)]
    for each in guessers:
        each.start()
    while time.monotonic() < ends:
        started = time.monotonic()
        assert web.http.post("/api/robots/stop").is_success
        stops.append(time.monotonic() - started)
        time.sleep(0.05)
    for each in guessers:
        each.join()
    assert web.http.post("/api/robots/reset").is_success
    bits = 6 * len(web.server.token)
    told(
        34,
        "guessing the token",
        f"{listed(counted)} of {counted.total()} guesses in {GUESSING_S:g} s at {bits} bits; Stop "
        f"within {1000 * max(stops):.0f} ms meanwhile, allowed {1000 * STOP_S:.0f} ms",
        worst_ms=1000 * max(stops),
    )
    assert set(counted) == {401, 429}
    assert counted[401] <= 5
    assert bits >= 128
    assert max(stops) <= STOP_S


# --- a bad configuration -----------------------------------------------------------------------

SAYS = ("the rig is unknown", "flow.window_px", "motion capture", "there is no folder")


def badly_configured(folder: Path) -> Path:
    """Make a data folder in which everything is misconfigured."""
    folder.mkdir()
    (folder / "rig.yaml").write_text("mount: {height_m: -5")
    with Storage(folder / "observer.sqlite") as storage:
        storage.save_parameters(3, {"flow.window_px": -5, "flow.unheard_of": 1}, None)
        storage.set_setting("live_truth", {"spec": "nonsense", "observer": None, "ignore": []})
    return folder


def test_a_bad_configuration_is_served_disarmed_and_reported(tmp_path: Path) -> None:
    started = time.monotonic()
    with served(badly_configured(tmp_path / "data"), "/no/such/folder") as server:
        seconds = time.monotonic() - started

        def failed() -> Any:
            status = server.request("GET", "/status")
            return status if status["engine"]["state"] == "failed" else None

        status = wait_until("the source is refused", failed)
        said = "; ".join([*status["warnings"], status["engine"]["reason"]])
        robots = server.request("GET", "/robots")["robots"]
        for role in robots:
            with pytest.raises(Refused) as refused:
                server.request("POST", f"/robots/{role}/arm", {})
            assert refused.value.status in (404, 409)
        # It can be repaired through its own API.
        server.request("PUT", "/source", {"source": "simulated:lab"})
    assert [each for each in SAYS if each not in said] == [], said
    assert not any(robot and robot["state"] in ("armed", "moving") for robot in robots.values())
    told(
        35,
        "bad configuration at start",
        f"served after {seconds:.1f} s with nothing armed, and all {len(SAYS)} faults told",
    )


def test_a_strict_start_fails_with_a_bad_configuration(tmp_path: Path) -> None:
    folder = badly_configured(tmp_path / "data")
    command = [sys.executable, "-m", "app.cli", "serve", "/no/such/folder", "--strict"]
    started = time.monotonic()
    done = subprocess.run(
        [*command, "--port", "0", "--data", str(folder)],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    seconds = time.monotonic() - started
    last = done.stderr.splitlines()[-1]
    assert done.returncode == 1, done.stderr
    assert [each for each in SAYS if each not in last] == [], done.stderr
    assert "Traceback" not in done.stderr
    # No link to a page that does not exist.
    assert done.stdout == ""
    told(
        35,
        "bad configuration at a strict start",
        f"exit code {done.returncode} after {seconds:.1f} s, and all {len(SAYS)} faults told",
    )
