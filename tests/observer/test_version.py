"""The installed version, and how to install optional packages."""

from __future__ import annotations

import importlib.metadata
import sys

import pytest

from observer import extras, version


def _only(installed: str | None, monkeypatch: pytest.MonkeyPatch) -> None:
    def of(distribution: str) -> str:
        if distribution == installed:
            return "1.2.3"
        raise importlib.metadata.PackageNotFoundError

    monkeypatch.setattr("importlib.metadata.version", of)
    monkeypatch.setattr(version, "library_version", version.library_version.__wrapped__)


@pytest.mark.parametrize(
    ("installed", "told", "wanted"),
    [
        ("dynamic-observer", "1.2.3", "'dynamic-observer[cluster]'"),
        ("dynamic-observer-library", "1.2.3", "distributed pyarrow"),
        (None, "source", "distributed pyarrow"),
    ],
)
def test_packages_are_installed_into_the_python_in_use_as_the_distribution_allows(
    installed: str | None, told: str, wanted: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    _only(installed, monkeypatch)
    assert version.library_version() == told
    command = extras.install_command("cluster", "distributed", "pyarrow")
    assert command == f"{sys.executable} -m pip install {wanted}"


def test_a_command_can_be_pasted_into_a_shell(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "executable", "/home/ada/my lab/python")
    command = "'/home/ada/my lab/python' -m pip install 'psycopg[binary]'"
    assert extras.pip_install("psycopg[binary]") == command


def test_missing_packages_are_counted_and_named_without_their_own_extras() -> None:
    one = extras.package_missing("a database", "postgres", "psycopg[binary]")
    assert one.startswith("a database needs the package psycopg, which is not installed; ")
    two = extras.package_missing("a sweep", "cluster", "distributed", "pyarrow")
    assert two.startswith("a sweep needs the packages distributed and pyarrow, which are not ")
    assert f"install them with: {sys.executable} -m pip install " in two
