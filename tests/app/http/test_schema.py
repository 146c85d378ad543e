"""Every operation answers as the API's description says, whatever request it gets.

schemathesis generates requests from the description: at the limits of every value, at random, and
in chains where one operation uses the result of another. ``API_EXAMPLES=200`` sets the number of
random requests for each operation.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from anyio.from_thread import BlockingPortal, start_blocking_portal

from ..engine_values import rectified_calibration
from ..planted_runs import plant_run

EXAMPLES = int(os.environ.get("API_EXAMPLES", "3"))
# A larger number uses new examples each time; the seed is printed.
SAME_EACH_TIME = "API_EXAMPLES" not in os.environ
# Values that a schema cannot describe are refused with 422, so values valid by the schema may be
# refused as well, which positive_data_acceptance reports as a fault. gate/test_gate.py tests that
# every route requires the token; ignored_auth would use up the attempts.
CONFIG = """
base-url = "{url}"
headers = {{ Authorization = "{authorization}" }}
continue-on-failure = true

[generation]
deterministic = {same}
max-examples = {examples}

[checks]
ignored_auth.enabled = false
positive_data_acceptance.enabled = false
not_a_server_error.expected-statuses = ["2xx", "3xx", "4xx", "503", "507"]
negative_data_rejection.expected-statuses = ["4xx", "503", "507"]

# Names that another path takes for an id, with its methods.
[[operations]]
include-path = ["/api/calibrations/deactivate", "/api/calibrations/refine", "/api/truth/live"]
checks.allow_header_conformance.enabled = false
"""
# Existing names, for operations that would find nothing by a made-up name.
KNOWN = """
[[operations]]
include-path-regex = "{path}"
exclude-method = "DELETE"
parameters = {{ "path.{parameter}" = "{value}" }}
"""

pytestmark = [pytest.mark.slow, pytest.mark.timeout(240 + 20 * EXAMPLES)]


@pytest.fixture
def portal() -> Iterator[BlockingPortal]:
    """The event loop that the server runs in."""
    with start_blocking_portal() as portal:
        yield portal


@pytest.fixture
def served(portal: BlockingPortal, serve: Any, peer: Any) -> Iterator[Any]:
    """The application with stand-ins for engine and drive process."""
    with portal.wrap_async_context_manager(serve()) as served:
        portal.call(peer.observe)
        yield served


def test_every_operation_answers_as_described(
    served: Any, portal: BlockingPortal, tmp_path: Path
) -> None:
    config = tmp_path / "schemathesis.toml"
    authorization = served.http.headers["Authorization"]
    same = str(SAME_EACH_TIME).lower()
    parts = [
        CONFIG.format(url=served.url, authorization=authorization, examples=EXAMPLES, same=same)
    ]
    parts += [
        KNOWN.format(path=path, parameter=parameter, value=value)
        for path, parameter, value in portal.call(things, served)
    ]
    config.write_text("".join(parts))
    done = subprocess.run(
        [
            *(sys.executable, "-m", "schemathesis.cli", "--no-color", "--config-file"),
            *(str(config), "run", f"{served.url}/openapi.json", "--warnings", "off"),
        ],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        cwd=tmp_path,
        check=False,
    )
    # For the person who runs it (pytest -s): the number of requests, and the seed.
    sys.stdout.write(done.stdout[done.stdout.rfind("\nTest cases:") :])
    assert done.returncode == 0, done.stdout
    # A run that ended early has not tested every operation.
    described = sum(map(len, served.app.openapi()["paths"].values()))
    assert f"Tested: {described}" in done.stdout, done.stdout


async def things(served: Any) -> list[tuple[str, str, str]]:
    """Return one of each kind: a regular expression of paths, their parameter and its value."""
    bare, run = [await finished_run(served) for _ in range(2)]
    plant_run(served.server.storage.folder.run(run), run)
    file = {"file": ("known.yaml", rectified_calibration())}
    calibration = (await served.http.post("/api/calibrations", files=file)).json()["id"]
    programme = (await served.http.get("/api/programmes")).json()[0]["name"]
    return [
        ("^/api/runs/[{]id[}](/(recover|stop|recording|speeds|incidents|chart))?$", "id", run),
        # For a run with a recording each answer would take seconds.
        ("^/api/runs/[{]id[}]/(align|chart[.]|export|report|rerun)", "id", bare),
        ("^/api/calibrations/[{]id[}]", "id", calibration),
        ("^/api/programmes/[{]name[}]", "name", programme),
        ("^/api/views/[{]name[}]", "name", "left"),
    ]


async def finished_run(served: Any) -> str:
    run = (await served.http.post("/api/runs", json={})).json()["id"]
    assert (await served.http.post(f"/api/runs/{run}/stop")).is_success
    return str(run)
