"""User-visible texts: those in the page's modules, in its HTML, and in the Python code.

Sentences, labels and help; names for machines (keys, fields, paths) do not count.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from functools import cache
from html.parser import HTMLParser

from tools import ROOT

# Files with the avoided words themselves or with database statements.
NO_TEXTS = (
    "app/storage/migrations",
    "app/contract/glossary.py",
    "tools/packaging/page_facts.py",
    "tools/packaging/page_glossary.py",
)

Text = tuple[str, str]


def python_texts(source: str) -> Iterator[tuple[int, str]]:
    """Yield the line and content of each text in Python code, except docstrings.

    A value inserted at run time becomes an ellipsis.
    """
    tree = ast.parse(source)
    said: set[ast.AST] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            said.add(node.value)
        if isinstance(node, ast.JoinedStr):
            said.update(each for each in ast.walk(node) if each is not node)
    for node in ast.walk(tree):
        if node in said:
            continue
        text = ""
        if isinstance(node, ast.JoinedStr):
            parts = (v.value if isinstance(v, ast.Constant) else "…" for v in node.values)
            text = "".join(map(str, parts))
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            text = node.value
        if re.search(r"[A-Za-z]{2}", text) and " " in text.strip():
            yield getattr(node, "lineno", 0), text


def script_texts(source: str) -> Iterator[tuple[int, str]]:
    """Yield the line and content of each text in JavaScript: with a space, or capitalized."""
    token = re.compile(
        r"/\*.*?\*/|//[^\n]*"
        r"|(?P<text>\"(?:\\.|[^\"\\\n])*\"|'(?:\\.|[^'\\\n])*'|`(?:\\.|[^`\\])*`)",
        re.DOTALL,
    )
    for found in token.finditer(source):
        text = found["text"]
        if text is None:
            continue
        text = re.sub(r"\$\{[^}]*\}", "…", text[1:-1])
        if re.search(r"[a-z]{2}", text) and (" " in text.strip() or text[:1].isupper()):
            yield source.count("\n", 0, found.start()) + 1, text


class _Visible(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.texts: list[tuple[int, str]] = []
        self._code = False

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self._code = tag in ("script", "style")
        for name, value in attrs:
            if name in ("title", "aria-label", "placeholder", "alt") and value:
                self.texts.append((self.getpos()[0], value))

    def handle_endtag(self, tag: str) -> None:  # noqa: ARG002
        self._code = False

    def handle_data(self, data: str) -> None:
        if data.strip() and not self._code:
            self.texts.append((self.getpos()[0], data))


def page_texts(source: str) -> Iterator[tuple[int, str]]:
    """Yield the line and content of each text of an HTML page."""
    parser = _Visible()
    parser.feed(source)
    yield from parser.texts


READERS = {".py": python_texts, ".js": script_texts, ".html": page_texts}


@cache
def visible() -> list[Text]:
    """Return the place and content of every user-visible text."""
    files = [
        *(file for room in ("app", "observer", "tools") for file in (ROOT / room).rglob("*.py")),
        *(ROOT / "static" / "app").rglob("*.js"),
        *(ROOT / "static").glob("*.html"),
    ]
    texts = []
    for file in sorted(files):
        name = str(file.relative_to(ROOT))
        if not name.startswith(NO_TEXTS):
            for line, text in READERS[file.suffix](file.read_text(encoding="utf-8")):
                texts.append((f"{name}:{line}", " ".join(text.split())))
    return texts
