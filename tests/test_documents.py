"""Documents refer only to what exists, and the documentation is complete and self-contained."""

from __future__ import annotations

import importlib
import importlib.util
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest

import observer
from app.cli.command_line import COMMANDS, load_command
from app.contract.scene import LAYERS
from observer.navigation.parameters import AllParameters
from tools import ROOT

from .visible_words import visible

PAGES = ROOT / "docs" / "pages"
DOCUMENTS = ("ARCHITECTURE.md", "CONTRIBUTING.md", "README.md", "SECURITY.md", "docker/README.md")
ALL = [*DOCUMENTS, *sorted(str(page.relative_to(ROOT)) for page in PAGES.glob("*.md"))]
ROOMS = "app|observer|static|tests|tools|docker|docs|notebooks"
# Made by a build, so it may be absent here.
MADE = {"docs/site"}
# Served next to the documentation by the same server.
SERVED = {"/docs", "/openapi.json"}
README_LINES = 200
PAPER = "A Hybrid Approach for Dynamic Observer to Detect and Track Dynamic Obstacles"


@pytest.mark.parametrize("document", ALL)
def test_every_path_and_module_that_is_named_exists(document: str) -> None:
    text = (ROOT / document).read_text()
    paths = set(re.findall(rf"`((?:{ROOMS})/[\w./-]*)`", text))
    missing = [path for path in paths - MADE if not (ROOT / path).exists()]
    assert missing == []
    for name in set(re.findall(r"`((?:app|observer)(?:\.[a-z_]+)+)(?:\.[A-Z]\w*)?`", text)):
        assert _exists(name), name


@pytest.mark.parametrize("document", ALL)
def test_every_file_that_is_named_without_its_folder_exists(document: str) -> None:
    """As in a sentence about a folder, where only the last part of the path is given."""
    text = (ROOT / document).read_text()
    named = set(re.findall(r"`((?:[\w-]+/)*[\w-]+\.(?:py|js))`", text))
    assert [name for name in named if not any(file.endswith(f"/{name}") for file in _files())] == []


@cache
def _files() -> list[str]:
    """Return the project's files of code, each with its path from the root."""
    folders = [ROOT / folder for folder in ROOMS.split("|")]
    return [
        f"/{file.relative_to(ROOT)}"
        for folder in folders
        for pattern in ("*.py", "*.js")
        for file in folder.rglob(pattern)
        if "node_modules" not in file.parts
    ]


def _exists(name: str) -> bool:
    """Return whether a dotted name is a module, or an attribute of one."""
    module, _, attribute = name.rpartition(".")
    parent = importlib.import_module(module)
    return hasattr(parent, attribute) or importlib.util.find_spec(name) is not None


@pytest.mark.parametrize("package", ["observer", "app"])
def test_the_architecture_lists_the_layers_that_are_enforced(package: str) -> None:
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text())
    enforced = [
        [set(layer.split(" | ")) for layer in contract["layers"]]
        for contract in settings["tool"]["importlinter"]["contracts"]
        if contract.get("containers") == [package]
    ]
    blocks = re.findall(r"^```\n(.*?)^```", _architecture(), re.MULTILINE | re.DOTALL)
    # A remark may stand to the right of a layer.
    told = [
        [
            set(re.split(r" {2,}", line)[0].replace(".py", "").split(", "))
            for line in block.split("\n")
        ]
        for block in (block.strip() for block in blocks)
    ]
    assert [layers for layers in told if layers in enforced] == enforced


def test_the_architecture_lists_the_folders_of_the_page() -> None:
    _, _, table = _architecture().partition("| folder | what is in it |")
    told = re.findall(r"^\| `([\w-]+)` \|", table, re.MULTILINE)
    folders = [each.name for each in (ROOT / "static" / "app").iterdir() if each.is_dir()]
    assert sorted(told) == sorted(folders)


def _architecture() -> str:
    return (ROOT / "ARCHITECTURE.md").read_text()


def test_the_readme_is_short() -> None:
    assert len((ROOT / "README.md").read_text().splitlines()) <= README_LINES


@pytest.mark.parametrize("document", DOCUMENTS)
def test_every_link_between_documents_leads_somewhere(document: str) -> None:
    """Links within the documentation are checked when it is built."""
    folder = (ROOT / document).parent
    for target in re.findall(r"\]\((?!https?:)([^)\s]+)\)", (ROOT / document).read_text()):
        path, _, anchor = target.partition("#")
        file = folder / path if path else ROOT / document
        assert file.exists(), target
        if anchor:
            assert anchor in _anchors(file), target


def _anchors(document: Path) -> set[str]:
    heads = re.findall(r"^#+ (.+)$", document.read_text(), re.MULTILINE)
    return {re.sub(r"[^\w -]", "", head).lower().replace(" ", "-") for head in heads}


@pytest.mark.parametrize("document", ALL)
def test_every_command_shown_exists(document: str) -> None:
    """Checks the names of commands and every option that follows."""
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    for code in _code((ROOT / document).read_text()):
        for name, rest in re.findall(r"dynamic-observer ([a-z][a-z-]*)([^#|&;]*)", code):
            assert name in COMMANDS, code
            taken = {option for each in load_command(name).params for option in each.opts}
            assert set(re.findall(r"(?<!\S)--[a-z][\w-]*", rest)) <= taken, code
        for name in re.findall(r"--set[ ]+([\w.]+)=", code):
            assert name in AllParameters().flat(), code
        for target in re.findall(r"^(?:\$ )?make ([a-z-]+)", code, re.MULTILINE):
            assert target in targets, code


def _code(text: str) -> Iterator[str]:
    """Yield the lines of code blocks, continued lines joined, and the text between backticks."""
    for block in re.findall(r"^ *```\w*\n(.*?)^ *```", text, re.MULTILINE | re.DOTALL):
        yield from re.sub(r"\\\n\s*", " ", block).splitlines()
    yield from re.findall(r"`([^`\n]+)`", re.sub(r"```.*?```", "", text, flags=re.DOTALL))


@pytest.mark.parametrize("document", [name for name in ALL if name.startswith(("README", "docs"))])
def test_every_label_named_is_on_the_page(document: str) -> None:
    """A label is written in italics and in full, as on the page: *Start run*."""
    assert _wrong_labels((ROOT / document).read_text()) == []


def test_a_label_that_is_not_on_the_page_would_be_found() -> None:
    right = "*Start run*, *Min. stereo depth* in the *Left* view; *stressed*, **Not\na label**"
    assert _wrong_labels(right) == []
    wrong = ["Start runs", "Nothing like it", "left", "Min. stereo\ndepths"]
    for label in wrong:
        assert _wrong_labels(f"Press *{label}* there.") == [" ".join(label.split())]


def _wrong_labels(text: str) -> list[str]:
    """Return the labels in a document that are not on the page in this spelling.

    Text in lower case is only emphasized, unless it is a label that is spelled differently.
    """
    shown = _labels()
    lower = {label.lower() for label in shown}
    plain = re.sub(r"```.*?```|\*\*.*?\*\*", "", text, flags=re.DOTALL)
    named = {" ".join(each.split()) for each in re.findall(r"(?<![*\w])\*([^*`]+)\*", plain)}
    return sorted(
        each
        for each in named - {PAPER}
        if each not in shown and (each[0].isupper() or each.lower() in lower)
    )


@cache
def _labels() -> set[str]:
    """Return the labels on the page: its texts, and the titles of parameters and layers."""
    titles = {entry["title"] for entry in AllParameters.declared()}
    titles |= {layer.title for layer in LAYERS.values()}
    return titles | {text for place, text in visible() if place.startswith("static")}


def test_every_message_in_troubleshooting_exists_in_the_code() -> None:
    """``…`` stands for a variable part; each part between is searched for."""
    rows = re.findall(r"^\| `(.+?)` \|", (PAGES / "troubleshooting.md").read_text(), re.MULTILINE)
    assert len(rows) > 30
    words = _words("observer/**/*.py", "app/**/*.py", "tools/**/*.py", "Makefile")
    # Join texts written on several lines, and replace inserted values.
    words = re.sub(r"\"\s+f?\"", "", words)
    words = re.sub(r"{[^{}]*}", "…", words)
    missing = [
        part
        for row in rows
        for part in re.split(r"\s*…\s*", row)
        if len(part) > 3 and part not in words
    ]
    assert missing == []


def _words(*patterns: str) -> str:
    files = [file for pattern in patterns for file in sorted(ROOT.glob(pattern))]
    return "\n".join(file.read_text() for file in files)


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The documentation, freshly built. A broken link within it fails the build."""
    folder = tmp_path_factory.mktemp("documentation") / "site"
    done = subprocess.run(
        [sys.executable, "-m", "tools.docs", str(folder)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=100,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    return folder


class _Page(HTMLParser):
    """What a page links to, what it loads, and its anchors."""

    def __init__(self, page: Path) -> None:
        super().__init__()
        self.links: list[str] = []
        self.loads: list[str] = []
        self.places: set[str] = set()
        self.feed(page.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = {name: value or "" for name, value in attrs}
        self.places |= {given[name] for name in ("id", "name") if name in given}
        if tag in ("a", "area") and "href" in given:
            self.links.append(given["href"])
        elif "href" in given:
            self.loads.append(given["href"])
        self.loads += [given[name] for name in ("src", "data", "poster") if given.get(name)]
        # Otherwise an image in another resolution could come from elsewhere.
        assert "srcset" not in given


@pytest.fixture(scope="module")
def pages(site: Path) -> dict[Path, _Page]:
    return {page: _Page(page) for page in site.rglob("*.html")}


def test_every_page_is_in_the_site(site: Path, pages: dict[Path, _Page]) -> None:
    assert {page.stem for page in PAGES.glob("*.md")} <= {page.stem for page in pages}
    # Files that only a site with an address needs.
    assert not list(site.glob("sitemap*")) + list(site.glob("404.html"))


def test_every_link_of_the_site_leads_somewhere(pages: dict[Path, _Page]) -> None:
    for page, content in pages.items():
        for link in [*content.links, *content.loads]:
            parts = urlsplit(link)
            if parts.scheme in ("http", "https"):
                continue
            if parts.path in SERVED:
                continue
            target = (page.parent / unquote(parts.path)).resolve() if parts.path else page
            target = target / "index.html" if target.is_dir() else target
            assert target.is_file(), f"{page.name}: {link}"
            if parts.fragment and target in pages:
                assert unquote(parts.fragment) in pages[target].places, f"{page.name}: {link}"


def test_nothing_is_loaded_from_elsewhere(site: Path, pages: dict[Path, _Page]) -> None:
    for page, content in pages.items():
        assert [each for each in content.loads if re.match(r"(?:\w+:)?//", each)] == [], page.name
    for style in site.rglob("*.css"):
        text = style.read_text(encoding="utf-8")
        assert not re.search(r"url\(\s*['\"]?(?:https?:)?//|@import", text), style.name


def test_the_references_are_complete(site: Path) -> None:
    commands = (site / "commands.html").read_text()
    for name in COMMANDS:
        assert f'id="{name}"' in commands
        options = {each for param in load_command(name).params for each in param.opts}
        assert [each for each in options if each.startswith("-") and each not in commands] == []
    parameters = (site / "parameters.html").read_text()
    assert [name for name in AllParameters().flat() if f">{name}<" not in parameters] == []
    library = (site / "library.html").read_text()
    public = set(observer.__all__) - {"__version__"}
    assert [name for name in public if f".{name}" not in library] == []
    assert "/api/runs/{id}/recording" in (site / "rest.html").read_text()


def test_every_optional_extra_is_listed() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    _, _, table = (PAGES / "server.md").read_text().partition("| extra | for |")
    listed = re.findall(r"^\| `([\w-]+)` \|", table, re.MULTILINE)
    assert listed == sorted(set(project["optional-dependencies"]) - {"dev", "docs"})


def test_every_page_is_in_the_readme() -> None:
    """Except those generated or filled in when the documentation is built."""
    linked = re.findall(r"docs/pages/([\w-]+\.md)", (ROOT / "README.md").read_text())
    pages = {page.name for page in PAGES.glob("*.md")} - {"index.md", "library.md"}
    assert set(linked) == pages


def test_the_accuracy_table_says_how_it_was_made() -> None:
    """The command is right above the table, so that a new measurement replaces both."""
    text = (PAGES / "accuracy.md").read_text()
    assert re.search(
        r"dynamic-observer benchmark --seeds \d+ --frames \d+\n```\n\n\| metric at", text
    )
