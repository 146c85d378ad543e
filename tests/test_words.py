"""User-visible texts use the words of the glossary and none that it says to avoid.

``visible_words`` defines which texts are checked.
"""

from __future__ import annotations

import ast
import re

import pytest

from app.contract.glossary import GLOSSARY
from tools import ROOT

from .visible_words import Text, page_texts, python_texts, script_texts, visible

# Wordings to avoid in everything that a person reads, whatever the term: regular expressions, as
# ``Term.avoided``.
UNIDIOMATIC: tuple[str, ...] = (
    r"\bmore sure\b",
    r"\bfor good\b",
    r"\bas was (told|asked)\b",
    r"\bbrings? no\b",
    r"\bis going\b(?! to)",
    r"\bsays? nothing\b",
    r"\bplaces are read\b",
    r"\bhave it back\b",
    r"\bmore or less\b",
    r"\banew\b",
    r"\bin force\b",
    r"\bif left out\b",
    r"\bundisturbed\b",
    r"\bwhat is (typed|shown|seen) is\b",
    r"\b(is|are|was|were) told\b",
    r"\blies? beside\b",
    r"\bas said above\b",
    r"\bover restarts\b",
)

# Wordings in which pydantic and REST address developers.
DEVELOPER_TEXT: tuple[str, ...] = (
    r"\bshould have at least\b",
    r"\bInput should be\b",
    r"\bField required\b",
    r"\b(GET|POST|PUT|PATCH|DELETE) /api\b",
)
# For developers, who use routes by name.
OF_ROUTES = ("app/contract/", "app/http/", "tools/docs/")
# Docstrings begin with none of them, but with a verb or a noun.
QUESTION_WORDS = ("How ", "What ", "When ", "Where ", "Whether ", "Why ")
AVOIDED = [(pattern, term.name) for term in GLOSSARY for pattern in term.avoided] + [
    (pattern, "plain English") for pattern in (*UNIDIOMATIC, *DEVELOPER_TEXT)
]


def found(pattern: str, texts: list[Text]) -> list[str]:
    """Return the texts that match a pattern, with their places."""
    wanted = re.compile(pattern, re.IGNORECASE)
    return [f"{place}: {text}" for place, text in texts if wanted.search(text)]


@pytest.mark.parametrize(("pattern", "instead"), AVOIDED)
def test_no_visible_text_has_a_word_that_the_glossary_avoids(pattern: str, instead: str) -> None:
    told = found(pattern, visible())
    if pattern in DEVELOPER_TEXT:
        told = [each for each in told if not each.startswith(OF_ROUTES)]
    assert told == [], f"write: {instead}"


@pytest.mark.parametrize(
    "text",
    [
        "Lay truth over this run",
        "speed of truth",
        "95 % within +- 0.2 mm",
        "one sigma 3 ms",
        "the run was observed again",
        "Give back",
        "this lease is old",
        "Of no known body",
        "String should have at least 1 character",
        "calibrate anew",
        "it is software stop, no emergency stop",
    ],
)
def test_an_avoided_word_would_be_reported(text: str) -> None:
    sources = (
        (python_texts, f"raise InputError(f'{{name}}: {text}')"),
        (python_texts, f'said = "{text} " "and more"'),
        (script_texts, f'h("p", {{ title: "{text}" }});'),
        (script_texts, f"setText(this.#words, `{text} ${{count}}`);"),
        (page_texts, f"<p>{text}</p>"),
        (page_texts, f'<button title="{text}">x</button>'),
    )
    for read, source in sources:
        texts = [("here", words) for _, words in read(source)]
        assert any(found(pattern, texts) for pattern, _ in AVOIDED), source


def test_correct_wording_is_not_reported() -> None:
    right = "Ground truth: cart.csv, time offset 3 ± 1 ms (95 % interval); see truth.csv"
    assert not any(found(pattern, [("here", right)]) for pattern, _ in AVOIDED)


def test_texts_of_all_packages_are_checked() -> None:
    rooms = {place.split("/")[0] for place, _ in visible()}
    assert rooms == {"app", "observer", "tools", "static"}
    assert len(visible()) > 3000


def test_docstrings_begin_with_a_verb_or_a_noun() -> None:
    found = [
        f"{file.relative_to(ROOT)}: {text.splitlines()[0]}"
        for room in ("app", "observer")
        for file in sorted((ROOT / room).rglob("*.py"))
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8")))
        if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef))
        and (text := ast.get_docstring(node))
        and text.startswith(QUESTION_WORDS)
    ]
    assert found == []


def test_every_term_is_defined_in_whole_sentences() -> None:
    names = [term.name for term in GLOSSARY]
    assert names == sorted(names, key=str.lower)
    assert len(set(names)) == len(names)
    for term in GLOSSARY:
        assert re.fullmatch(r"[A-Z].*\.", term.meaning), term.name
        page = ROOT / "docs" / "pages" / term.page
        assert not term.page or term.page == "guard.md" or page.is_file(), term.page
