"""Documents name only files, folders and modules that exist."""

from __future__ import annotations

import importlib
import importlib.util
import re
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).parents[1]
DOCUMENTS = ("ARCHITECTURE.md", "CONTRIBUTING.md", "README.md", "SECURITY.md")
ROOMS = "app|observer|static|tests|tools|docker|notebooks"


@pytest.mark.parametrize("document", DOCUMENTS)
def test_every_path_and_module_that_is_named_exists(document: str) -> None:
    text = (REPOSITORY / document).read_text()
    paths = set(re.findall(rf"`((?:{ROOMS})/[\w./-]*)`", text))
    missing = [path for path in paths if not (REPOSITORY / path).exists()]
    assert missing == []
    for name in set(re.findall(r"`((?:app|observer)(?:\.[a-z_]+)+)(?:\.[A-Z]\w*)?`", text)):
        assert _exists(name), name


def _exists(name: str) -> bool:
    """Return whether a dotted name is a module, or an attribute of one."""
    module, _, attribute = name.rpartition(".")
    parent = importlib.import_module(module)
    return hasattr(parent, attribute) or importlib.util.find_spec(name) is not None
