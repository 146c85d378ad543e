"""What anyone who reaches the port may try, all sent to one running server.

A server of the simulated lab as a user starts it, with engine, drive process and 3D view.
``FAULT_TRIALS`` trials of each fault, at most five. In the end the same processes still run.
"""

from __future__ import annotations

import contextlib
import time
from collections import Counter
from collections.abc import Iterator
from itertools import product
from pathlib import Path
from typing import Any

import pytest
from websockets.exceptions import ConnectionClosed

from .bench import TRIALS as FAULT_TRIALS
from .harmful import (
    ARCHIVES,
    BROKEN_FRAMES,
    GARBAGE,
    HUGE_NUMBERS,
    MALFORMED,
    NO_NUMBERS,
    YAML_BOMB,
    holding,
    numeric_fields,
    paths,
)
from .web import (
    CANARY,
    MEGABYTE,
    SOCKETS,
    Memory,
    Operation,
    Watcher,
    Web,
    close_code,
    delivery,
    listed,
    nothing_changes,
    read_answer,
    told,
)

TRIALS = min(5, FAULT_TRIALS)
JSON = {"Content-Type": "application/json"}
UPLOADS = ("/api/calibrations", "/api/calibrating/images", "/api/truth")
NOWHERE = "/no/such/path"
UPLOAD_HEAD = b'--x\r\nContent-Disposition: form-data; name="file"; filename="a"\r\n\r\n'
BOARD = {"kind": "chessboard", "columns": "9", "rows": "6", "square_mm": "25"}
FRAMES = 30
MOST_LOOKS = 3
KEPT = 0.9

pytestmark = [pytest.mark.slow, pytest.mark.timeout(120 + 30 * TRIALS)]


# --- too much and too long ---------------------------------------------------------------------


def test_slow_clients(web: Web) -> None:
    slow = [*(7 * ["/api/live"]), *(7 * ["/api/views/left"]), *(6 * ["/viewer"])]
    grown, shares = [], []
    for _ in range(TRIALS):
        watchers = [Watcher(web, path) for path in ("/api/live", "/api/views/left")]
        time.sleep(0.5)
        # Other load on the machine comes and goes, unlike the effect of slow clients.
        for attempt in range(MOST_LOOKS):
            before = delivery(web, watchers, FRAMES)
            with contextlib.ExitStack() as stack, Memory(web.server.process) as memory:
                for path in slow:
                    stack.enter_context(web.slow_client(path))
                beside = delivery(web, watchers, FRAMES)
            grown.append(memory.grown / MEGABYTE)
            share = beside.share / before.share
            if share >= KEPT or attempt == MOST_LOOKS - 1:
                shares.append(share)
                break
        for each in watchers:
            each.end()
    told(
        23,
        "20 slow clients",
        f"the web process grows by {max(grown):.1f} MB, allowed 50 MB; the others keep "
        f"{100 * min(shares):.0f} % of the frames, allowed {100 * KEPT:.0f} %; "
        f"{before.per_s:.1f} and {beside.per_s:.1f} a second",
        grown_mb=max(grown),
        share=min(shares),
    )
    assert max(grown) < 50
    assert min(shares) >= KEPT


def test_endless_uploads(web: Web) -> None:
    grown, counted, unread = [], Counter[int](), [0]
    # Endpoints for files, for JSON, and none at all.
    ways = [(path, UPLOAD_HEAD) for path in UPLOADS[:2]] + [("/api/runs", b""), (NOWHERE, b"")]
    if FAULT_TRIALS > 1:
        # It accepts half a gigabyte before it refuses.
        ways.append((UPLOADS[2], UPLOAD_HEAD))
    for _ in range(TRIALS):
        for path, head in ways:
            for announced in (True, False):
                with Memory(web.server.process) as memory:
                    status, sent = web.upload(path, head, 2 << 30, announced=announced)
                grown.append(memory.grown / MEGABYTE)
                counted[status] += 1
                assert status == 413 or path == NOWHERE, (path, status)
                if path == NOWHERE:
                    unread.append(sent)
    told(
        24,
        "2 GB sent, with and without Content-Length",
        f"{listed(counted)}; the web process grows by {max(grown):.1f} MB, allowed 20 MB; where "
        f"nothing reads it {max(unread) / MEGABYTE:.0f} MB are taken",
        grown_mb=max(grown),
    )
    assert set(counted) <= {404, 413}
    assert max(grown) <= 20
    assert max(unread) <= 64 * MEGABYTE


# --- malicious content -------------------------------------------------------------------------


def test_harmful_archives(web: Web, data: Path) -> None:
    took, grown, counted = [0.0], [0.0], Counter[int]()
    made = {name: make() for name, make in ARCHIVES.items()}

    def send(path: str, name: str, content: bytes) -> tuple[float, Any]:
        file = {"file": (name, content, "application/zip")}
        started = time.monotonic()
        answer = web.http.post(path, files=file, data=BOARD if path.endswith("images") else {})
        return time.monotonic() - started, answer

    with nothing_changes(web):
        for path in UPLOADS:
            # Baseline: any file takes some time and a process.
            with Memory(web.server.process) as ordinary:
                least_s, _ = send(path, "file", b"nothing of the kind")
            # An endpoint that does not accept archives is tried with one only.
            for name in made if path != "/api/truth" else ["bomb"]:
                with Memory(web.server.process) as memory:
                    seconds, answer = send(path, f"../../{name}.zip", made[name])
                took.append(seconds - least_s)
                grown.append((memory.grown - ordinary.grown) / MEGABYTE)
                counted[answer.status_code] += 1
                assert answer.status_code in (413, 422), (name, path, answer.text)
    told(
        25,
        "zip bomb, nested archives, symbolic link, entries outside",
        f"{listed(counted)} within {1000 * max(took):.0f} ms beyond any other file, allowed "
        f"2000 ms; {max(grown):.1f} MB are taken, allowed 100 MB",
        worst_ms=1000 * max(took),
        grown_mb=max(grown),
    )
    assert max(took) <= 2.0
    assert max(grown) < 100
    assert sorted(each.name for each in data.parent.iterdir()) == ["canary", "data"]


def test_yaml_alias_bombs_are_refused(web: Web) -> None:
    ways: dict[str, tuple[str, str, dict[str, Any]]] = {
        "rig": ("PUT", "/api/rig/file", {"json": {"text": f"mount:\n{YAML_BOMB}"}}),
        "programme": ("POST", "/api/programmes", {"json": {"text": YAML_BOMB}}),
        "plain calibration": ("POST", UPLOADS[0], {"files": {"file": ("c.yaml", YAML_BOMB)}}),
        "OpenCV's calibration": (
            "POST",
            UPLOADS[0],
            {"files": {"file": ("c.yaml", f"%YAML:1.0\n---\n{YAML_BOMB}")}},
        ),
    }
    took, counted = [], Counter[int]()
    with nothing_changes(web), Memory(web.server.process) as memory:
        for name, (method, path, body) in ways.items():
            started = time.monotonic()
            answer = web.http.request(method, path, **body)
            took.append(time.monotonic() - started)
            counted[answer.status_code] += 1
            assert answer.status_code == 422, (name, answer.text)
            # It was refused for what it is, before being expanded.
            assert "alias" in answer.text, (name, answer.text)
    told(
        26,
        "YAML alias bomb",
        f"{listed(counted)} within {1000 * max(took):.0f} ms, allowed 2000 ms; the web process "
        f"grows by {memory.told}, allowed 20 MB",
        worst_ms=1000 * max(took),
    )
    assert max(took) <= 2.0
    assert memory.grown <= 20 * MEGABYTE


def test_paths_outside_the_folder_are_refused(web: Web, data: Path) -> None:
    counted = Counter[int]()
    targets = [
        path for file in (data.parent / "canary", "/etc/passwd") for path in paths(str(file))
    ]
    for target in targets:
        status, answer = web.answer(web.head("GET", target, "Connection: close"))
        counted[status] += 1
        assert 400 <= status < 500, (target, answer)
        assert CANARY.encode() not in answer, target
        assert b"root:" not in answer, target
    told(27, "paths that lead outside", f"{listed(counted)}; the canary stays unread")


# --- invalid values ----------------------------------------------------------------------------


def test_invalid_parameter_values_are_refused(web: Web) -> None:
    declared = web.http.get("/api/parameters/schema").json()
    bad: dict[str, list[str]] = {
        "number": [*NO_NUMBERS, *HUGE_NUMBERS, "null"],
        "integer": [*NO_NUMBERS, *HUGE_NUMBERS, "null", "0.5"],
        "boolean": ["NaN", "1", '"true"', "null"],
        "choice": ["NaN", "true", "1", '"nonsense"', "null"],
    }
    counted = Counter[int]()
    with nothing_changes(web):
        for kind, values in bad.items():
            names = [entry["name"] for entry in declared if entry["type"] == kind]
            for value, part in product(values, batched(names)):
                body = ", ".join(f'"{name}": {value}' for name in part)
                answer = web.http.patch("/api/parameters", content=f"{{{body}}}", headers=JSON)
                counted[answer.status_code] += 1
                assert answer.status_code == 422, (kind, value, answer.text)
                named = {part for each in answer.json()["detail"] for part in each["loc"]}
                assert set(part) <= named, (value, set(part) - named)
    told(
        28,
        "parameters that are no numbers in range",
        f"{len(declared)} parameters, each named in {listed(counted)}; the old values stay",
    )


def batched(names: list[str]) -> list[list[str]]:
    """Split the names so that a refusal's 50 entries suffice for each name and possible type."""
    return [names[first : first + 12] for first in range(0, len(names), 12)]


def test_invalid_numbers_are_refused(web: Web) -> None:
    counted, fields = Counter[int](), 0
    known = web.description["components"]["schemas"]
    with nothing_changes(web):
        for operation in filter(lambda each: each.takes_json, web.operations):
            body = operation.described["requestBody"]["content"]["application/json"]["schema"]
            for place in set(numeric_fields(body, known)):
                fields += 1
                for value in (*NO_NUMBERS, *HUGE_NUMBERS):
                    answer = web.http.request(
                        operation.method,
                        operation.path,
                        content=holding(place, value),
                        headers=JSON,
                    )
                    counted[answer.status_code] += 1
                    where = (operation.method, operation.path, place, value, answer.text)
                    assert answer.status_code == 422, where
                    named = {part for each in answer.json()["detail"] for part in each["loc"]}
                    assert named & set(place), where
        for operation in web.operations:
            for query in numbers_in_query(operation):
                fields += 1
                for value in ("nan", "inf", "-inf", "1e999", "true", "1e300", "x"):
                    path = f"{operation.path}?{query}={value}"
                    answer = web.http.request(operation.method, path)
                    counted[answer.status_code] += 1
                    assert answer.status_code in (404, 422), (path, answer.text)
    told(
        28,
        "fields that are no numbers in range",
        f"{fields} fields, {listed(counted)}; nothing changes",
    )
    assert fields > 30


def numbers_in_query(operation: Operation) -> Iterator[str]:
    for parameter in operation.described.get("parameters", ()):
        if parameter["in"] == "query" and set(numeric_fields(parameter["schema"], {})):
            yield parameter["name"]


def test_malformed_json_is_refused(web: Web) -> None:
    counted, took = Counter[int](), [0.0]
    with nothing_changes(web):
        for operation in filter(lambda each: each.takes_json, web.operations):
            needed = operation.described["requestBody"].get("required", False)
            for name, body in MALFORMED.items():
                if body or needed:
                    started = time.monotonic()
                    answer = web.http.request(
                        operation.method, operation.path, content=body, headers=JSON
                    )
                    took.append(time.monotonic() - started)
                    counted[answer.status_code] += 1
                    assert 400 <= answer.status_code < 500, (operation, name, answer.text)
    told(
        29,
        "malformed and deep JSON",
        f"{listed(counted)} within {1000 * max(took):.0f} ms; nothing changes",
    )


def test_garbage_closes_a_websocket(web: Web) -> None:
    codes = Counter[int]()
    for path in SOCKETS:
        for name, garbage in GARBAGE.items():
            with web.opened(path) as socket:
                with contextlib.suppress(ConnectionClosed):
                    socket.send(garbage)
                    while True:
                        socket.recv(timeout=5)
                codes[socket.close_code or 0] += 1
                # A client still sending when the server closes may miss the code.
                allowed = (1006, 1009) if name == "two megabytes" else (1007, 1009)
                assert socket.close_code in allowed, (path, name, socket.close_code)
        for name, frame in BROKEN_FRAMES.items():
            line = ["Sec-WebSocket-Protocol: viser-v1.1.1"] if path == "/viewer" else []
            with web.connected() as connection:
                connection.sendall(web.handshake(path, *line))
                assert read_answer(connection)[0] == 101
                connection.settimeout(5)
                connection.sendall(frame)
                code = close_code(connection)
                codes[code] += 1
                assert code in (1002, 1007, 1009), (path, name, code)
    told(
        29,
        "garbage to WebSockets",
        f"closed with {listed(codes)}; the processes live",
    )
