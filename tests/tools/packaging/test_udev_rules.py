"""The udev rules, as far as they can be checked without devices."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

# man udev, section "Rules files".
_PART = re.compile(r'(?P<key>[A-Z]+)(\{[A-Za-z_]+\})?(?P<operator>==|!=|\+=|=)"[^"]*"')
_MATCHES = {"SUBSYSTEM", "SUBSYSTEMS", "KERNELS", "ATTR", "ATTRS", "ENV"}
_ASSIGNMENTS = {"GROUP", "MODE", "SYMLINK", "IMPORT"}


@pytest.fixture(scope="module")
def rules(repository: Path) -> list[str]:
    """All rules, including those offered as comments."""
    text = (repository / "docker" / "60-dynamic-observer.rules").read_text()
    return [line.removeprefix("# ") for line in text.splitlines() if "SUBSYSTEM==" in line]


def test_every_rule_uses_only_keys_that_udev_has(rules: list[str]) -> None:
    assert len(rules) == 7
    for rule in rules:
        parts = [_PART.fullmatch(part.strip()) for part in rule.split(",")]
        assert None not in parts, rule
        found = {(part["key"], part["operator"]) for part in parts if part}
        assert {key for key, operator in found if operator == "=="} <= _MATCHES
        assert {key for key, operator in found if operator != "=="} <= _ASSIGNMENTS
        assert any(operator != "==" for _, operator in found)


def test_devices_are_assigned_to_the_groups_that_the_doctor_names(rules: list[str]) -> None:
    given = dict(
        re.findall(r'^SUBSYSTEM=="(\w+)".*GROUP="(\w+)", MODE="0660"$', "\n".join(rules), re.M)
    )
    assert given == {"video4linux": "video", "tty": "dialout"}


def test_names_by_path_follow_the_import_of_the_path(rules: list[str]) -> None:
    # Our file is read before 60-persistent-v4l.rules, and within one rule matches come first.
    known = rules.index('SUBSYSTEM=="video4linux", IMPORT{builtin}="path_id"')
    by_path = [place for place, rule in enumerate(rules) if "ENV{ID_PATH}==" in rule]
    assert len(by_path) == 2
    assert known < min(by_path)


def test_robot_ports_can_be_named_individually(rules: list[str]) -> None:
    named = [rule for rule in rules if 'SYMLINK+="robot-' in rule]
    assert {rule.rpartition('"robot-')[2].rstrip('"') for rule in named} == {"observer", "obstacle"}
    # Both keys match one parent: the adapter itself, not another USB device above it.
    assert all('SUBSYSTEM=="tty", SUBSYSTEMS=="usb"' in rule for rule in named)
