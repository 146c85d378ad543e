"""Formulas, declared once: as MathML for a page, and as a line of text for a figure.

A formula is a string or a ``Math`` of strings and further ``Math``. A string is tokenized into
names, numbers and signs, as in ``"x + 1"``; a name of several letters stays one name.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal, Union
from xml.sax.saxutils import escape

_Kind = Literal["row", "sub", "sup", "frac", "root", "under", "matrix", "size", "gap", "words"]
Formula = Union[str, "Math"]

_TOKEN = re.compile(r"[0-9]+(?:\.[0-9]+)?|[^\W\d_]+′*|\S")
# Spaces that separate signs in a declaration, but are dropped in a line of text.
_TIGHT_BEFORE = re.compile(r"(?<=\S) +([),])")
_TIGHT_BEHIND = re.compile(r"(\() +")
_NAMESPACE = "http://www.w3.org/1998/Math/MathML"
_PRIME = "′"
# Space between two formulas.
_GAP = "    "
_ELEMENTS = {
    "row": "mrow",
    "sub": "msub",
    "sup": "msup",
    "frac": "mfrac",
    "root": "msqrt",
    "under": "munder",
}
_SUBSCRIPTS = str.maketrans("0123456789+-=()aehijklmnoprstuvx", "₀₁₂₃₄₅₆₇₈₉₊₋₌₍₎ₐₑₕᵢⱼₖₗₘₙₒₚᵣₛₜᵤᵥₓ")
_SUPERSCRIPTS = str.maketrans("0123456789+-=()T", "⁰¹²³⁴⁵⁶⁷⁸⁹⁺⁻⁼⁽⁾ᵀ")


@dataclass(frozen=True)
class Math:
    """Part of a formula.

    Attributes:
        kind: how the parts are arranged. parts: for a matrix its elements, row by row.
        columns: number of columns of a matrix.
    """

    kind: _Kind
    parts: tuple[Formula, ...]
    columns: int = 1


def row(*parts: Formula) -> Math:
    """Parts next to each other."""
    return Math("row", parts)


def sub(base: Formula, below: Formula) -> Math:
    """A base with an index."""
    return Math("sub", (base, below))


def sup(base: Formula, above: Formula) -> Math:
    """A base with an exponent."""
    return Math("sup", (base, above))


def frac(numerator: Formula, denominator: Formula) -> Math:
    """A fraction."""
    return Math("frac", (numerator, denominator))


def root(*parts: Formula) -> Math:
    """A square root."""
    return Math("root", parts)


def under(base: Formula, below: Formula) -> Math:
    """A sign with something below it, such as a sum with its index."""
    return Math("under", (base, below))


def matrix(rows: Sequence[Sequence[Formula]]) -> Math:
    """A matrix in square brackets."""
    return Math("matrix", tuple(part for each in rows for part in each), len(rows[0]))


def size(*parts: Formula) -> Math:
    """The magnitude of a number or a vector, between bars."""
    return Math("size", parts)


def gap() -> Math:
    """Space between two formulas in a row; they may also be stacked."""
    return Math("gap", ())


def words(text: str) -> Math:
    """Plain words between signs."""
    return Math("words", (text,))


def mathml(formula: Formula) -> tuple[str, ...]:
    """Return the formula as MathML documents, one for each part between its gaps."""
    return tuple(
        f'<math xmlns="{_NAMESPACE}" display="block">{_element(part)}</math>'
        for part in _apart(formula)
    )


def _apart(formula: Formula) -> Iterator[Formula]:
    """Yield the formulas between the gaps of a row."""
    parts: list[Formula] = []
    for part in _beside(formula):
        if isinstance(part, Math) and part.kind == "gap":
            yield row(*parts)
            parts = []
        else:
            parts.append(part)
    yield row(*parts)


def _beside(formula: Formula) -> Iterator[Formula]:
    """Yield the parts of a row, and of rows nested in it."""
    if isinstance(formula, str) or formula.kind != "row":
        yield formula
        return
    for part in formula.parts:
        yield from _beside(part)


def text(formula: Formula) -> str:
    """Return the formula as one line of text."""
    return _TIGHT_BEHIND.sub(r"\1", _TIGHT_BEFORE.sub(r"\1", _line(formula)))


def _line(formula: Formula) -> str:
    if isinstance(formula, str):
        return formula
    parts = [_line(part) for part in formula.parts]
    match formula.kind:
        case "sub":
            return parts[0] + _index(parts[1], _SUBSCRIPTS, "_")
        case "sup":
            return parts[0] + _index(parts[1], _SUPERSCRIPTS, "^")
        case "frac":
            return " / ".join(_grouped(part) for part in parts)
        case "root":
            return f"√({' '.join(parts)})"
        case "under":
            return parts[0] + _index(parts[1], _SUBSCRIPTS, "_")
        case "gap":
            return _GAP
        case "size":
            return f"|{' '.join(parts)}|"
        case "matrix":
            lines = [parts[k : k + formula.columns] for k in range(0, len(parts), formula.columns)]
            return "[" + "; ".join(", ".join(line) for line in lines) + "]"
        case _:
            return " ".join(parts)


def _index(part: str, table: dict[int, int], sign: str) -> str:
    shifted = part.translate(table)
    if all(ord(c) in table for c in part):
        return shifted
    return f"{sign}{part}" if re.fullmatch(r"\w+", part) else f"{sign}({part})"


def _grouped(part: str) -> str:
    outside = re.sub(r"\([^()]*\)", "", part)
    return f"({part})" if re.search(r"\s[+−]\s|/", outside) else part


def _element(formula: Formula) -> str:
    if isinstance(formula, str):
        tokens = [_token(token) for token in _TOKEN.findall(formula)]
        return tokens[0] if len(tokens) == 1 else f"<mrow>{''.join(tokens)}</mrow>"
    if formula.kind == "size":
        inside = "".join(map(_element, formula.parts))
        bar = '<mo form="{}" stretchy="false">|</mo>'
        return f"<mrow>{bar.format('prefix')}{inside}{bar.format('postfix')}</mrow>"
    if formula.kind == "words":
        return f"<mtext>{escape(_line(formula))}</mtext>"
    parts = [_element(part) for part in formula.parts]
    if formula.kind != "matrix":
        name = _ELEMENTS[formula.kind]
        return f"<{name}>{''.join(parts)}</{name}>"
    cells = [f"<mtd>{part}</mtd>" for part in parts]
    lines = [cells[k : k + formula.columns] for k in range(0, len(cells), formula.columns)]
    # The page draws the brackets: without a math font they would not stretch.
    table = "".join(f"<mtr>{''.join(line)}</mtr>" for line in lines)
    return f"<mtable>{table}</mtable>"


def _token(token: str) -> str:
    if token[0].isdigit():
        return f"<mn>{token}</mn>"
    if token[0].isalpha():
        name = token.rstrip(_PRIME)
        element = f"<mi>{escape(name)}</mi>"
        # The prime character is raised by itself, in math fonts and others.
        prime = f'<mo lspace="0" rspace="0">{_PRIME}</mo>'
        return element if name == token else f"<mrow>{element}{prime}</mrow>"
    return f"<mo>{escape(token)}</mo>"
