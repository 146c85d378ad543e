"""The container's files, as far as they can be checked without a Docker engine."""

from __future__ import annotations

import fnmatch
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml

from app.drive import priority
from app.settings import ENVIRONMENT_PREFIX, Settings

# The keys used here of https://github.com/compose-spec/compose-spec/blob/main/05-services.md;
# types and forms further down are from schema/compose-spec.json there.
SERVICE_KEYS = {
    "build", "cap_drop", "command", "devices", "group_add", "healthcheck", "image", "init",
    "ports", "read_only", "restart", "security_opt", "stop_grace_period", "tmpfs", "ulimits",
    "volumes",
}  # fmt: skip
# getrlimit(2): a niceness of -15 is allowed by a limit of 20 + 15.
_LIMITS = {"rtprio": 1, "nice": 35}
HEALTHCHECK_KEYS = {"test", "interval", "timeout", "start_period", "retries"}


@pytest.fixture(scope="module")
def dockerfile(repository: Path) -> dict[str, list[str]]:
    """Instruction -> its arguments in order, continued lines joined."""
    text = (repository / "docker" / "Dockerfile").read_text()
    text = re.sub(r"^#.*\n", "", text, flags=re.MULTILINE)
    instructions: dict[str, list[str]] = {}
    for line in re.sub(r"\\\n\s*", " ", text).splitlines():
        if line.strip():
            name, _, arguments = line.partition(" ")
            instructions.setdefault(name, []).append(" ".join(arguments.split()))
    return instructions


class _StrictLoader(yaml.SafeLoader):
    """Refuses duplicate keys, of which YAML's own loader takes the last."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        keys = [self.construct_object(key, deep=True) for key, _ in node.value]
        assert len(keys) == len(set(keys)), f"a key is there twice:{node.start_mark}"
        return super().construct_mapping(node, deep)


def _strictly(text: str) -> dict[str, Any]:
    loaded: dict[str, Any] = yaml.load(text, _StrictLoader)
    return loaded


def _service(compose: dict[str, Any]) -> dict[str, Any]:
    service: dict[str, Any] = compose["services"]["observer"]
    return service


@pytest.fixture(scope="module")
def compose(repository: Path) -> dict[str, Any]:
    # Only this file is checked against the specification below.
    assert [path.name for path in (repository / "docker").glob("*.y*ml")] == ["compose.yaml"]
    return _strictly((repository / "docker" / "compose.yaml").read_text())


def test_hadolint_finds_nothing(repository: Path) -> None:
    hadolint = shutil.which("hadolint", path=str(Path(sys.executable).parent))
    if hadolint is None:
        pytest.skip("hadolint is not installed: its package is for Linux on x86-64 only")
    done = subprocess.run(
        [hadolint, str(repository / "docker" / "Dockerfile")],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 0, done.stdout


def test_the_image_is_set_up_by_make_and_runs_without_privileges(
    dockerfile: dict[str, list[str]], repository: Path
) -> None:
    (setup,) = (run for run in dockerfile["RUN"] if "make setup" in run)
    assert setup.startswith("make setup ")
    assert not [run for run in dockerfile["RUN"] if re.search(r"pip install|npm ", run)]
    assert dockerfile["USER"] == ["1000:1000"]
    # Started as `make run` starts it.
    makefile = (repository / "Makefile").read_text()
    assert re.search(r"^run: setup\n\t@exec \$\(BIN\)/dynamic-observer serve", makefile, re.M)
    assert dockerfile["ENTRYPOINT"] == ['[".venv/bin/dynamic-observer"]']
    assert yaml.safe_load(dockerfile["CMD"][0])[:2] == ["serve", "simulated:lab"]


def test_the_environment_names_settings(dockerfile: dict[str, list[str]]) -> None:
    names = re.findall(r"(\w+)=", " ".join(dockerfile["ENV"]))
    assert names
    # The processor that Numba compiles for, not a setting.
    names.remove("NUMBA_CPU_NAME")
    for name in names:
        assert name.startswith(ENVIRONMENT_PREFIX)
        assert name.removeprefix(ENVIRONMENT_PREFIX).lower() in Settings.model_fields


def test_the_image_receives_only_what_setup_needs(repository: Path) -> None:
    lines = (repository / ".dockerignore").read_text().splitlines()
    rules = [line for line in lines if line and not line.startswith("#")]
    assert rules[0] == "*"
    taken = {rule[1:] for rule in rules if rule.startswith("!")}
    needed = {"Makefile", "pyproject.toml", "constraints.txt", "README.md", "LICENSE"}
    assert needed | {"app", "docs", "observer", "static", "tools"} == taken
    left_out = [rule for rule in rules[1:] if not rule.startswith("!")]
    for made in ("docs/site", "static/vendor", "static/node_modules", "app/__pycache__"):
        assert any(fnmatch.fnmatch(made, rule) for rule in left_out)


def test_the_compose_file_matches_the_dockerfile(
    compose: dict[str, Any], dockerfile: dict[str, list[str]], repository: Path
) -> None:
    assert set(compose) == {"name", "services", "volumes"}
    service = compose["services"]["observer"]
    assert set(service) <= SERVICE_KEYS
    assert set(service["healthcheck"]) <= HEALTHCHECK_KEYS
    assert (repository / "docker" / service["build"]["context"]).resolve() == repository
    assert (repository / service["build"]["dockerfile"]).is_file()
    assert service["ports"] == ["127.0.0.1:8080:8080"], "published to this machine only"
    assert service["volumes"] == ["data:/data"]
    assert set(compose["volumes"]) == {"data"}
    assert service["command"] == yaml.safe_load(dockerfile["CMD"][0])


# A duration like 1m30s; HOST:CONTAINER with optional address and protocol; a mapping of paths.
_DURATION = re.compile(r"(?:\d+(?:us|ms|s|m|h))+")
_PORT = re.compile(r"(?:(?:\d+\.){3}\d+:)?(?:\d+:)?\d+(?:/(?:tcp|udp))?")
_MAPPING = re.compile(r"[^:]+:/[^:]*(?::[a-z,]+)?")
_LISTED: dict[str, re.Pattern[str]] = {
    "ports": _PORT, "volumes": _MAPPING, "devices": _MAPPING, "tmpfs": re.compile("/.*"),
    "cap_drop": re.compile("[A-Z_]+"), "security_opt": re.compile(r".+[:=].+"),
    "group_add": re.compile(r".+"), "command": re.compile(r"(?s).+"),
}  # fmt: skip


def _misfits(service: dict[str, Any]) -> list[str]:
    """Return the keys whose values lack the type or form that the specification requires.

    Where it allows a short and a long form, only the short one is accepted here.
    """
    found = []
    for key, form in _LISTED.items():
        values = service.get(key, [])
        strings = isinstance(values, list) and all(isinstance(each, str) for each in values)
        if not strings or not all(map(form.fullmatch, values)) or len(set(values)) < len(values):
            found.append(key)
    health = service["healthcheck"]
    spans = {key: health[key] for key in ("interval", "timeout", "start_period") if key in health}
    spans["stop_grace_period"] = service["stop_grace_period"]
    found += [key for key, value in spans.items() if not _DURATION.fullmatch(str(value))]
    if type(health["retries"]) is not int or health["retries"] < 1:
        found.append("retries")
    if not all(isinstance(word, str) for word in health["test"]):
        found.append("test")
    found += [key for key in ("init", "read_only") if not isinstance(service[key], bool)]
    found += [key for key in ("image",) if not isinstance(service[key], str)]
    if service["restart"] not in ("no", "always", "on-failure", "unless-stopped"):
        found.append("restart")
    limits = service.get("ulimits", {})
    return found + [name for name, value in limits.items() if type(value) is not int]


def test_the_values_have_the_types_of_the_specification(compose: dict[str, Any]) -> None:
    assert re.fullmatch(r"[a-z0-9][a-z0-9_-]*", compose["name"])
    assert _misfits(_service(compose)) == []
    # Null means a volume with the engine's defaults.
    assert all(value is None or isinstance(value, dict) for value in compose["volumes"].values())


def test_named_volumes_are_declared_and_no_variables_are_used(
    compose: dict[str, Any], repository: Path
) -> None:
    named = {each.partition(":")[0] for each in _service(compose)["volumes"]}
    assert named == set(compose["volumes"]), "a path of the host, or an unused volume"
    # Compose replaces an unset variable by an empty string.
    text = (repository / "docker" / "compose.yaml").read_text()
    assert not re.findall(r"(?<!\$)\$(?:\{|\w)", text)


def test_the_port_is_the_servers_default(
    compose: dict[str, Any], dockerfile: dict[str, list[str]]
) -> None:
    port = Settings.model_fields["port"].default
    (published,) = _service(compose)["ports"]
    assert published.split(":") == ["127.0.0.1", str(port), str(port)]
    assert dockerfile["EXPOSE"] == [str(port)]
    assert f"{ENVIRONMENT_PREFIX}PORT={port} " in " ".join(dockerfile["ENV"])
    assert f"127.0.0.1:{port}/healthz" in _service(compose)["healthcheck"]["test"][-1]


def test_the_service_has_no_more_rights_than_the_image(compose: dict[str, Any]) -> None:
    # The image's user is not root; the service neither changes the user nor adds rights.
    service = _service(compose)
    assert not {"user", "privileged", "cap_add", "network_mode", "pid", "ipc"} & set(service)
    assert service["cap_drop"] == ["ALL"]
    assert service["security_opt"] == ["no-new-privileges:true"]
    assert service["read_only"] is True


def test_the_commented_devices_are_valid_when_uncommented(repository: Path) -> None:
    text = (repository / "docker" / "compose.yaml").read_text()
    commented = r"^    # ((?:devices|group_add|ulimits):|  - |  (?:rtprio|nice): )"
    opened = re.sub(commented, r"    \1", text, flags=re.MULTILINE)
    service = _service(_strictly(opened))
    assert set(service) <= SERVICE_KEYS
    assert _misfits(service) == []
    assert any(device.startswith("/dev/video") for device in service["devices"])
    # Robots by stable names, mapped to where the doctor and the page look for them.
    robots = [each.partition(":") for each in service["devices"] if "serial" in each]
    assert all(host.startswith("/dev/serial/by-id/") for host, _, _ in robots)
    assert [inside for _, _, inside in robots] == ["/dev/ttyUSB0", "/dev/ttyUSB1"]
    assert service["group_add"] == ["video", "dialout"]
    assert service["ulimits"] == _LIMITS


def test_the_limits_allow_the_drive_loops_priority(repository: Path) -> None:
    assert _LIMITS == {"rtprio": priority.REALTIME, "nice": 20 - priority.NICENESS}
    readme = (repository / "docker" / "README.md").read_text()
    for name, value in _LIMITS.items():
        assert f"--ulimit {name}={value}" in readme


def test_both_files_have_the_same_health_check(
    compose: dict[str, Any], dockerfile: dict[str, list[str]]
) -> None:
    kind, *command = compose["services"]["observer"]["healthcheck"]["test"]
    assert kind == "CMD"
    assert "/healthz" in command[-1]
    (instruction,) = dockerfile["HEALTHCHECK"]
    assert yaml.safe_load(instruction[instruction.index("[") :]) == command
