"""Look up known vulnerabilities of the pinned packages, by pip-audit.

    python tools/packaging/audit.py [options of pip-audit]

If the package index does not report any, as some mirrors do not, this says so and passes. Those
that cannot be fixed yet are accepted in ``pyproject.toml``, each with its reason:

    [tool.audit.accepted]
    GHSA-xxxx-xxxx-xxxx = "why it does no harm here, and what it waits for"
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tools import ROOT

# pip-audit's own pin: every index that reports vulnerabilities knows it.
_PROBE = "pip_audit"
_TIMEOUT_S = 5


class Unanswered(Exception):
    """The index reports no vulnerabilities; the sentence says why."""


@dataclass(frozen=True)
class Vulnerability:
    """Known vulnerability of a pinned package.

    Attributes:
        package: with its version. ids: the first is its own, the others are aliases.
        fixed_in: versions that are free of it. summary: of the advisory.
    """

    package: str
    ids: tuple[str, ...]
    fixed_in: tuple[str, ...]
    summary: str

    def __str__(self) -> str:
        fixed = f"fixed in {', '.join(self.fixed_in)}" if self.fixed_in else "not fixed yet"
        return f"{self.package}: {', '.join(self.ids)} ({fixed}): {self.summary[:200]}"


@dataclass(frozen=True)
class Audit:
    """Known vulnerabilities of the pinned packages.

    Attributes:
        checked: number of packages that the index knows. unknown: names of the others.
    """

    vulnerabilities: tuple[Vulnerability, ...]
    checked: int
    unknown: tuple[str, ...]


def audit(constraints: Path, options: Sequence[str] = ()) -> Audit:
    """Query the index about all pinned packages, after one that it knows if it answers at all.

    Args:
        constraints: a file of NAME==VERSION. options: further ones of pip-audit.

    Raises:
        Unanswered: it does not answer.
    """
    probe = re.search(rf"^{_PROBE}==.*$", constraints.read_text(), re.MULTILINE)
    if probe is not None:
        with tempfile.TemporaryDirectory() as folder:
            alone = Path(folder) / "probe.txt"
            alone.write_text(probe.group())
            _ask(alone, options)
    return _ask(constraints, options)


def _ask(pins: Path, options: Sequence[str]) -> Audit:
    command = [
        *(sys.executable, "-m", "pip_audit", "--requirement", str(pins), "--no-deps"),
        *("--disable-pip", "--format", "json", "--progress-spinner", "off", "--aliases", "on"),
        *("--timeout", str(_TIMEOUT_S), *options),
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    try:
        packages = json.loads(done.stdout)["dependencies"]
    except ValueError:
        last = next(iter(reversed(done.stderr.strip().splitlines())), "it said nothing")
        raise Unanswered(f"pip-audit has no answer: {last[:200]}") from None
    unknown = tuple(each["name"] for each in packages if "skip_reason" in each)
    if len(unknown) == len(packages):
        raise Unanswered("the package index reports none")
    found = tuple(
        _vulnerability(package, entry) for package in packages for entry in package.get("vulns", ())
    )
    return Audit(found, len(packages) - len(unknown), unknown)


def _vulnerability(package: Mapping[str, Any], entry: Mapping[str, Any]) -> Vulnerability:
    return Vulnerability(
        f"{package['name']} {package['version']}",
        (entry["id"], *entry["aliases"]),
        tuple(entry["fix_versions"]),
        entry["description"],
    )


def problems(found: Audit, accepted: Mapping[str, str]) -> list[str]:
    """Return a sentence for each thing to do; none if all is well.

    Args:
        accepted: reasons by the id of a vulnerability, or one of its aliases.
    """
    sentences = [
        str(each) for each in found.vulnerabilities if not any(id_ in accepted for id_ in each.ids)
    ]
    sentences += [f"{id_} is accepted without a reason" for id_, why in accepted.items() if not why]
    known = {id_ for each in found.vulnerabilities for id_ in each.ids}
    sentences += [
        f"{id_} is accepted, but no pinned package has it any more; remove it"
        for id_ in accepted
        if id_ not in known
    ]
    return sentences


def main(options: Sequence[str]) -> int:
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["audit"]
    try:
        found = audit(ROOT / "constraints.txt", options)
    except Unanswered as reason:
        sys.stderr.write(f"Known vulnerabilities of packages were not looked up: {reason}\n")
        return 0
    if found.unknown:
        sys.stderr.write(f"Unknown to the package index: {', '.join(found.unknown)}\n")
    sentences = problems(found, settings["accepted"])
    for sentence in sentences:
        sys.stderr.write(f"{sentence}\n")
    if not sentences:
        but = f" but {len(found.vulnerabilities)} accepted" if found.vulnerabilities else ""
        sys.stderr.write(f"No known vulnerability in {found.checked} pinned packages{but}\n")
    return 1 if sentences else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
