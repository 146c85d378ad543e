"""Untrusted calibration files as plain nested data: YAML, JSON, and XML as OpenCV writes it.

Parsed in Python and libyaml rather than by ``cv2.FileStorage``: that one prints to stderr, aborts
on some damaged files and does not say which line is wrong.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TypeAlias

import numpy as np

from observer.errors import CalibrationError, InputError
from observer.text_files import MAX_BYTES, MAX_DEPTH, PlainData, checked_text, parse_text

# Name of a file, and the top-level mapping that it holds.
NamedData: TypeAlias = tuple[str, dict[str, PlainData]]

CALIBRATION = "a calibration"
_FORM = "YAML, XML or JSON as OpenCV's FileStorage writes it"


@contextmanager
def calibration_errors() -> Iterator[None]:
    """Turn refusals by the readers of text and numbers into ``CalibrationError``."""
    try:
        # Overflows become infinite, which every check of a calibration refuses.
        with np.errstate(over="ignore", invalid="ignore"):
            yield
    except CalibrationError:
        raise
    except InputError as error:
        raise CalibrationError(str(error)) from None


def parse_plain_data(text: str, *, name: str, form: str = _FORM) -> dict[str, PlainData]:
    """Return the top-level mapping of a YAML, XML (OpenCV FileStorage) or JSON text.

    Args:
        text: the whole file. The notation is recognised by its first character.
        name: what the text is called in messages, usually a file's name.
        form: what the text must be, for messages about one without any data.

    Raises:
        InputError: as ``parse_text``; XML that is malformed or declares entities.
    """
    if not text.removeprefix("\ufeff").lstrip().startswith("<"):
        return parse_text(text, name=name, what=CALIBRATION, form=form)
    text = checked_text(text, name=name, what=CALIBRATION, form=form, most=MAX_BYTES)
    # Entities can expand to gigabytes or read other files, and no calibration needs them.
    if re.search(r"<!(DOCTYPE|ENTITY)", text, re.IGNORECASE):
        raise InputError(
            f"{name}: the file declares a document type or entities, which a calibration must not "
            "contain"
        )
    try:
        # Without the declaration: the text is already decoded, whatever encoding it declares.
        bare = re.sub(r"\A\s*<\?xml[^>]*\?>", "", text).strip()
        root = ElementTree.fromstring(bare)  # nosec B314
    except ElementTree.ParseError as error:
        raise InputError(f"{name}: the file is truncated or not valid XML: {error}") from None
    data = _xml_value(root, name, 0)
    if not isinstance(data, dict):
        raise InputError(f"{name}: the file contains no keys with values; it must be {form}")
    return data


def _xml_value(element: ElementTree.Element, name: str, depth: int) -> PlainData:
    if depth > MAX_DEPTH:
        raise InputError(f"{name}: the file is nested too deeply")
    children = list(element)
    if not children:
        return (element.text or "").strip()
    if all(child.tag == "_" for child in children):
        return [_xml_value(child, name, depth + 1) for child in children]
    result: dict[str, PlainData] = {}
    for child in children:
        if child.tag in result:
            raise InputError(f"{name}: {child.tag[:60]} appears twice; keep one of them")
        result[child.tag] = _xml_value(child, name, depth + 1)
    return result
