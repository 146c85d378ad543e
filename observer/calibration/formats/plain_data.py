"""Untrusted YAML, XML and JSON text as plain nested data, every scalar still as its text.

Parsed in Python and libyaml rather than by ``cv2.FileStorage``: that one prints to stderr, aborts
on some damaged files and does not say which line is wrong.
"""

from __future__ import annotations

import json
import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from pathlib import Path
from typing import Any, TypeAlias

import yaml

from observer.errors import CalibrationError

PlainData: TypeAlias = "str | list[PlainData] | dict[str, PlainData]"

MAX_BYTES = 1_000_000
# A calibration nests two or three deep; more is either another kind of file or an attack.
_MAX_DEPTH = 12


def read_bytes(path: Path) -> bytes:
    """The content of a calibration file.

    Raises:
        CalibrationError: the file cannot be read or is larger than a calibration.
    """
    try:
        with path.open("rb") as file:
            content = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise CalibrationError(
            f"{path} cannot be read: {error.strerror}; give the path of a calibration file"
        ) from None
    check_length(content, name=path.name)
    return content


def read_text(path: Path) -> str:
    """The text of a calibration file.

    Raises:
        CalibrationError: the file cannot be read, is larger than a calibration or is no text.
    """
    return decoded(read_bytes(path), name=path.name)


def check_length(content: bytes, *, name: str) -> None:
    """Refuse what is larger than a calibration.

    Raises:
        CalibrationError: naming the file.
    """
    if len(content) > MAX_BYTES:
        raise CalibrationError(
            f"{name}: the file is larger than the {MAX_BYTES} bytes a calibration has at most"
        )


def decoded(content: bytes, *, name: str) -> str:
    """The text that these bytes are.

    Raises:
        CalibrationError: they are no text.
    """
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise CalibrationError(f"{name}: the file must be UTF-8 text") from None


def parse_plain_data(text: str, *, name: str) -> dict[str, PlainData]:
    """The top-level mapping of a YAML, XML (OpenCV FileStorage) or JSON text.

    Args:
        text: the whole file. The notation is recognised by its first character.
        name: what the text is called in messages, mostly a file's name.

    Raises:
        CalibrationError: the text is too long, is not text, is cut off or otherwise malformed,
            uses YAML aliases or XML entities, repeats a key, or holds no mapping.
    """
    _check_is_text(text, name)
    text = text.removeprefix("\ufeff")
    # OpenCV escapes the apostrophe in strings, which neither YAML nor JSON knows.
    text = re.sub(r"(\\\\)|\\'", lambda found: found.group(1) or "'", text)
    start = text.lstrip()[:1]
    if not start:
        raise CalibrationError(f"{name}: the file is empty; it must hold a calibration")
    if start == "<":
        data = _parse_xml(text, name)
    elif start == "{":
        data = _parse_json(text, name)
    else:
        data = _parse_yaml(text, name)
    if not isinstance(data, dict):
        raise CalibrationError(
            f"{name}: the file holds no keys with values; it must be YAML, XML or JSON "
            f"as OpenCV's FileStorage writes it"
        )
    return data


def _check_is_text(text: str, name: str) -> None:
    try:
        size = len(text.encode("utf-8"))
    except UnicodeEncodeError:
        raise CalibrationError(f"{name}: the file must be UTF-8 text") from None
    if size > MAX_BYTES:
        raise CalibrationError(
            f"{name}: the file has {size} bytes, but a calibration has at most {MAX_BYTES}"
        )
    if re.search(r"[\x00-\x08\x0e-\x1f\x7f]", text):
        raise CalibrationError(f"{name}: the file must be text, but it holds control characters")


def _parse_yaml(text: str, name: str) -> PlainData:
    # OpenCV writes "%YAML:1.0", which is no directive of YAML. Blanked, so that lines still count.
    text = re.sub(r"\A(\s*)%YAML[^\n]*", r"\1", text)
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    try:
        events = iter(yaml.parse(text, Loader=loader))
        return _YamlReader(events, name).document()
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f" in line {mark.line + 1}" if mark is not None else ""
        problem = getattr(error, "problem", None) or "it cannot be read"
        raise CalibrationError(
            f"{name}: the file is cut off or not valid YAML{where}: {problem}"
        ) from None


class _YamlReader:
    """Builds plain data from the parser's events, refusing aliases as soon as they appear."""

    def __init__(self, events: Iterator[Any], name: str) -> None:
        self._events = events
        self._name = name

    def document(self) -> PlainData:
        result: PlainData | None = None
        for event in self._events:
            if isinstance(event, yaml.DocumentStartEvent):
                if result is not None:
                    raise CalibrationError(
                        f"{self._name}: the file holds more than one YAML document; "
                        f"all keys must stand in one"
                    )
                result = self._value(next(self._events), 0)
        return {} if result is None else result

    def _value(self, event: Any, depth: int) -> PlainData:
        if isinstance(event, yaml.AliasEvent) or getattr(event, "anchor", None):
            raise CalibrationError(
                f"{self._name}: line {event.start_mark.line + 1} uses a YAML alias or anchor "
                f"(*name, &name); write every value out"
            )
        if depth > _MAX_DEPTH:
            raise CalibrationError(f"{self._name}: the file is nested too deeply")
        if isinstance(event, yaml.ScalarEvent):
            return str(event.value)
        if isinstance(event, yaml.SequenceStartEvent):
            return list(self._items(yaml.SequenceEndEvent, depth))
        return self._mapping(event, depth)

    def _items(self, end: type[Any], depth: int) -> Iterator[PlainData]:
        while not isinstance(event := next(self._events), end):
            yield self._value(event, depth + 1)

    def _mapping(self, start: Any, depth: int) -> PlainData:
        result: dict[str, PlainData] = {}
        items = self._items(yaml.MappingEndEvent, depth)
        for key in items:
            if not isinstance(key, str):
                raise CalibrationError(
                    f"{self._name}: a key of the mapping in line {start.start_mark.line + 1} "
                    f"is not a plain word"
                )
            _put(result, key, next(items), self._name)
        return result


def _parse_xml(text: str, name: str) -> PlainData:
    # Entities can expand to gigabytes or read other files, and no calibration needs them.
    if re.search(r"<!(DOCTYPE|ENTITY)", text, re.IGNORECASE):
        raise CalibrationError(
            f"{name}: the file declares a document type or entities; a calibration needs neither"
        )
    try:
        # As bytes without the declaration: the text is decoded already, whatever it declares.
        body = re.sub(r"\A\s*<\?xml[^>]*\?>", "", text)
        root = ElementTree.fromstring(body.strip())
    except ElementTree.ParseError as error:
        raise CalibrationError(f"{name}: the file is cut off or not valid XML: {error}") from None
    return _xml_value(root, name, 0)


def _xml_value(element: ElementTree.Element, name: str, depth: int) -> PlainData:
    if depth > _MAX_DEPTH:
        raise CalibrationError(f"{name}: the file is nested too deeply")
    children = list(element)
    if not children:
        return (element.text or "").strip()
    if all(child.tag == "_" for child in children):
        return [_xml_value(child, name, depth + 1) for child in children]
    result: dict[str, PlainData] = {}
    for child in children:
        _put(result, str(child.tag), _xml_value(child, name, depth + 1), name)
    return result


def _parse_json(text: str, name: str) -> PlainData:
    def mapping(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        result: dict[str, PlainData] = {}
        for key, value in pairs:
            _put(result, key, _json_scalar(value), name)
        return result

    try:
        data: PlainData = json.loads(
            text, object_pairs_hook=mapping, parse_int=str, parse_float=str, parse_constant=str
        )
    except json.JSONDecodeError as error:
        raise CalibrationError(
            f"{name}: the file is cut off or not valid JSON in line {error.lineno}: {error.msg}"
        ) from None
    except RecursionError:
        raise CalibrationError(f"{name}: the file is nested too deeply") from None
    return data


def _json_scalar(value: Any) -> PlainData:
    if isinstance(value, list):
        return [_json_scalar(item) for item in value]
    return value if isinstance(value, str | dict) else str(value)


def _put(mapping: dict[str, PlainData], key: str, value: PlainData, name: str) -> None:
    if key in mapping:
        raise CalibrationError(f"{name}: {key[:60]} is given twice; keep one of them")
    mapping[key] = value
