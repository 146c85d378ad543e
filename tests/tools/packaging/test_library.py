"""The distribution of the library alone: nothing missing, nothing from the server."""

from __future__ import annotations

import ast
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path
from typing import Any

import pytest

# Import name -> package name, where they differ.
PACKAGES = {
    "coppeliasim_zmqremoteapi_client": "coppeliasim-zmqremoteapi-client",
    "cv2": "opencv-python-headless",
    "foxglove": "foxglove-sdk",
    "pydantic_core": "pydantic",
    "serial": "pyserial",
    "typing_extensions": "typing-extensions",
    "yaml": "pyyaml",
}
# Used if the user has it: tables in notebooks.
OPTIONAL = {"pandas"}


def project(file: Path) -> dict[str, Any]:
    table: dict[str, Any] = tomllib.loads(file.read_text())["project"]
    return table


def names(requirements: list[str]) -> set[str]:
    return {each.split(">")[0].split("=")[0].split("[")[0] for each in requirements}


@pytest.fixture
def library(repository: Path) -> Path:
    return repository / "tools" / "packaging" / "library"


def test_its_dependencies_are_exactly_what_the_library_imports(
    repository: Path, library: Path
) -> None:
    whole, part = project(repository / "pyproject.toml"), project(library / "pyproject.toml")
    assert part["version"] == whole["version"]
    assert set(part["dependencies"]) < set(whole["dependencies"])
    imported = set()
    for source in (repository / "observer").rglob("*.py"):
        for node in ast.walk(ast.parse(source.read_text())):
            if isinstance(node, ast.Import):
                imported |= {each.name.split(".")[0] for each in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
                imported.add(node.module.split(".")[0])
    foreign = imported - set(sys.stdlib_module_names) - {"observer"} - OPTIONAL
    needed = {PACKAGES.get(name, name) for name in foreign}
    extras = set().union(*(names(each) for each in whole["optional-dependencies"].values()))
    assert needed - extras <= names(part["dependencies"])
    assert names(part["dependencies"]) <= needed


def test_its_wheel_contains_only_the_library(library: Path, tmp_path: Path) -> None:
    build = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir"]
    subprocess.run(
        [*build, str(tmp_path), str(library)], check=True, capture_output=True, timeout=100
    )
    (wheel,) = tmp_path.glob("dynamic_observer_library-*.whl")
    found = zipfile.ZipFile(wheel).namelist()
    assert {"observer/observer.py", "observer/py.typed", "observer/LICENSE"} <= set(found)
    assert [each for each in found if each.endswith(".pyc")] == []
    assert {each.split("/")[0] for each in found if ".dist-info" not in each} == {"observer"}
