"""Everything that a set-up installs is pinned, and no file names a registry's address."""

from __future__ import annotations

import itertools
import json
import os
import subprocess
import tomllib
from importlib import metadata
from pathlib import Path
from typing import Any

import pytest
from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet
from packaging.utils import canonicalize_name


@pytest.fixture(scope="module")
def pins(repository: Path) -> dict[str, str]:
    lines = (repository / "constraints.txt").read_text().splitlines()
    pinned = [line.split("==") for line in lines if line and not line.startswith("#")]
    assert all(len(each) == 2 for each in pinned), "every line is NAME==VERSION"
    return {canonicalize_name(name): version for name, version in pinned}


@pytest.fixture(scope="module")
def project(repository: Path) -> dict[str, Any]:
    project: dict[str, Any] = tomllib.loads((repository / "pyproject.toml").read_text())["project"]
    return project


def test_every_dependency_is_pinned_within_its_range(
    pins: dict[str, str], project: dict[str, Any]
) -> None:
    asked = [*project["dependencies"], *itertools.chain(*project["optional-dependencies"].values())]
    for requirement in map(Requirement, asked):
        version = pins.get(canonicalize_name(requirement.name))
        assert version is not None, f"{requirement.name} is not in constraints.txt"
        assert version in requirement.specifier, f"{requirement} does not allow {version}"


def test_the_oldest_python_can_install_every_pin(
    pins: dict[str, str], project: dict[str, Any]
) -> None:
    """Debian 12 has Python 3.11.2: a pin for 3.11.5 and newer ended its first make run."""
    (oldest,) = SpecifierSet(project["requires-python"])
    installed = metadata.distributions()
    pinned = [each for each in installed if canonicalize_name(each.name) in pins]
    assert len(pinned) > 100
    asked = {each.name: _python_of(each.metadata) for each in pinned}
    newer = {
        name: python for name, python in asked.items() if oldest.version not in SpecifierSet(python)
    }
    assert newer == {}


def test_the_dev_extra_includes_every_other_extra(project: dict[str, Any]) -> None:
    # Otherwise what an extra adds would never be tested.
    extras = dict(project["optional-dependencies"])
    # This one brings 1.2 GB of graphical toolkits that nothing here uses; where it is missing,
    # its tests are skipped and say why.
    del extras["crowd"]
    assert set(itertools.chain(*extras.values())) == set(extras["dev"])


def test_the_lock_file_contains_no_address(repository: Path) -> None:
    lock = json.loads((repository / "static" / "package-lock.json").read_text())
    packages = lock["packages"]
    assert "node_modules/uplot" in packages
    assert [name for name, package in packages.items() if "resolved" in package] == []
    assert all("integrity" in package for name, package in packages.items() if name)
    for package in packages.values():
        # Links for donations to the authors.
        package.pop("funding", None)
    assert "://" not in json.dumps(lock)


def test_the_lock_file_matches_package_json(repository: Path) -> None:
    static = repository / "static"
    wanted = json.loads((static / "package.json").read_text())
    locked = json.loads((static / "package-lock.json").read_text())["packages"][""]
    for kind in ("dependencies", "devDependencies"):
        assert locked[kind] == wanted[kind]


def test_ci_run_is_a_script(repository: Path) -> None:
    script = repository / ".ci" / "run"
    assert os.access(script, os.X_OK)
    subprocess.run(["bash", "-n", str(script)], check=True, timeout=20)
    text = script.read_text()
    assert "set -euo pipefail" in text
    assert text.index("make lint") < text.index("make test")


def _python_of(package: metadata.PackageMetadata) -> str:
    return package["Requires-Python"] or "" if "Requires-Python" in package else ""
