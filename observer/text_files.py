"""Text files that people write: YAML or JSON, validated by a pydantic model.

Every scalar stays text until a model interprets it, so that ``no`` and ``12`` may be names and
numbers keep their digits. Input that could expand beyond its text (YAML aliases) is refused before
any data are built from it. Errors are one sentence.
"""

from __future__ import annotations

import codecs
import difflib
import re
from collections.abc import Callable, Iterator
from itertools import takewhile
from pathlib import Path
from typing import Annotated, Any, ClassVar, TypeAlias, TypeVar

import yaml
from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    PlainValidator,
    ValidationError,
    model_validator,
)
from pydantic_core import PydanticCustomError

from observer.errors import InputError
from observer.validation import validation_words, with_name

PlainData: TypeAlias = "str | list[PlainData] | dict[str, PlainData]"
Location: TypeAlias = "tuple[int | str, ...]"

MAX_BYTES = 1_000_000
NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?", re.ASCII)
# Marks of UTF-16, in which programs on Windows write text.
WIDE_MARKS = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
# Characters that no text file contains.
CONTROL_CHARACTER = re.compile(r"[\x00-\x08\x0e-\x1f\x7f]")
# Such files nest two or three levels; deeper nesting means another kind of file or an attack.
MAX_DEPTH = 12


def read_bytes(path: Path, what: str) -> bytes:
    """Return the content of a file of at most ``MAX_BYTES``; ``what`` names its content.

    Raises:
        InputError: the file cannot be read or is larger.
    """
    try:
        with path.open("rb") as file:
            content = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise InputError(
            f"{path} cannot be read: {error.strerror}; give the path of {what}"
        ) from None
    check_length(content, path.name, what)
    return content


def read_text(path: Path, what: str) -> str:
    """Return the text of a file of at most ``MAX_BYTES``; ``what`` names its content.

    Raises:
        InputError: the file cannot be read, is larger or is not text.
    """
    return decoded(read_bytes(path, what), name=path.name)


def check_length(content: bytes, name: str, what: str) -> None:
    """Raise ``InputError`` for more than ``MAX_BYTES``."""
    if len(content) > MAX_BYTES:
        raise InputError(
            f"{name}: the file is larger than the {MAX_BYTES} bytes allowed for {what}"
        )


def decoded(content: bytes, *, name: str) -> str:
    """Return these bytes as text; raise ``InputError`` if they are neither UTF-8 nor UTF-16."""
    is_wide = content.startswith(WIDE_MARKS)
    try:
        return content.decode("utf-16" if is_wide else "utf-8-sig")
    except UnicodeDecodeError:
        problem = "is UTF-16 text that is truncated or damaged" if is_wide else "must be UTF-8 text"
        raise InputError(f"{name}: the file {problem}") from None


def parse_text(
    text: str, *, name: str, what: str, form: str, most: int = MAX_BYTES
) -> dict[str, PlainData]:
    """Return the top-level mapping of a YAML or JSON text, every scalar as text.

    Args:
        name: how messages call the text, usually a file's name.
        what: its content, as in ``a rig``. form: its required notation, as in ``YAML``.
        most: most characters allowed.

    Raises:
        InputError: the text is too long, is not text, is truncated or otherwise malformed, uses
            YAML aliases, repeats a key, or is not a mapping.
    """
    text = checked_text(text, name=name, what=what, form=form, most=most)
    # OpenCV writes "%YAML:1.0", which is not a valid YAML directive. The line is blanked, not
    # removed, so that line numbers stay correct.
    text = re.sub(r"\A(\s*)%YAML[^\n]*", r"\1", text)
    try:
        data = _document(yaml.parse(text, Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader)))
    except InputError as error:
        raise InputError(f"{name}: {error}") from None
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        # libyaml reports the end of a truncated text one line after its last.
        last = text.count("\n")
        where = f" in line {min(mark.line, last) + 1}" if mark is not None else ""
        problem = getattr(error, "problem", None) or "it cannot be read"
        # JSON is parsed as YAML, but authors of JSON need not know that.
        notation = "JSON" if text.lstrip().startswith("{") else "YAML"
        raise InputError(
            f"{name}: the file is truncated or not valid {notation}{where}: {problem}"
        ) from None
    if not isinstance(data, dict):
        raise InputError(f"{name}: the file contains no keys with values; it must be {form}")
    return data


def checked_text(text: str, *, name: str, what: str, form: str, most: int) -> str:
    """Return a text without byte order mark; raise ``InputError`` if it is not text, empty or too
    long."""
    if len(text) > most:
        raise InputError(f"{name}: {what} may have at most {most} characters, not {len(text)}")
    if re.search(r"[\ud800-\udfff]", text):
        raise InputError(f"{name}: the file must be UTF-8 text")
    if CONTROL_CHARACTER.search(text):
        raise InputError(f"{name}: the file must be text, but it contains control characters")
    text = text.removeprefix("\ufeff")
    if not text.strip():
        raise InputError(f"{name}: the file is empty; it must be {form}")
    # OpenCV escapes apostrophes in strings, which is invalid in both YAML and JSON.
    return re.sub(r"(\\\\)|\\'", lambda found: found.group(1) or "'", text)


def _document(events: Iterator[Any]) -> PlainData:
    """Return the data of the parser's events; comments alone are an empty mapping."""
    data: PlainData = {}
    for number, _ in enumerate(e for e in events if isinstance(e, yaml.DocumentStartEvent)):
        value = _value(events, next(events), 0)
        if number and value:
            raise InputError("the file contains more than one YAML document; put all keys in one")
        # Printed ROS messages end with the mark that begins another document.
        data = data if number else value
    return data


def _value(events: Iterator[Any], event: Any, depth: int) -> PlainData:
    line = event.start_mark.line + 1
    if isinstance(event, yaml.AliasEvent) or getattr(event, "anchor", None):
        raise InputError(
            f"line {line} uses a YAML alias or anchor (*name, &name); write every value out"
        )
    if depth > MAX_DEPTH:
        raise InputError("the file is nested too deeply")
    if isinstance(event, yaml.ScalarEvent):
        return str(event.value)
    if isinstance(event, yaml.SequenceStartEvent):
        items = takewhile(lambda item: not isinstance(item, yaml.SequenceEndEvent), events)
        return [_value(events, item, depth + 1) for item in items]
    result: dict[str, PlainData] = {}
    while not isinstance(event := next(events), yaml.MappingEndEvent):
        key = _value(events, event, depth + 1)
        if not isinstance(key, str):
            raise InputError(f"a key of the mapping in line {line} is not a plain word")
        if key in result:
            raise InputError(f"{key[:60]} appears twice; keep one of them")
        result[key] = _value(events, next(events), depth + 1)
    return result


class FileModel(BaseModel):
    """A mapping in a file.

    A validator raises ``ValueError`` with a message that continues after its key ("must be ..."),
    or contains ``{at}`` where the key is to be inserted.

    Attributes:
        noun: what the mapping is; if given, undeclared keys are refused.
        form: what follows "must" in the message if it is not a mapping. missing: message for a
            missing key. unset: values for which a key counts as missing.
    """

    model_config = ConfigDict(frozen=True, arbitrary_types_allowed=True)

    noun: ClassVar[str] = ""
    form: ClassVar[str] = "contain keys with values"
    missing: ClassVar[str] = "is missing"
    unset: ClassVar[tuple[str, ...]] = ()

    @classmethod
    def unknown(cls, key: str) -> str:
        """Return the message for an undeclared key."""
        near = difflib.get_close_matches(key, cls.model_fields, n=1, cutoff=0.4)
        hint = f"did you mean {near[0]}?" if near else f"the keys are {', '.join(cls.model_fields)}"
        return f"is not a key of {cls.noun}; {hint}"

    @model_validator(mode="before")
    @classmethod
    def _keys(cls, data: Any) -> Any:
        data = {} if data in cls.unset else data
        if not isinstance(data, dict):
            raise ValueError(f"must {cls.form}, not {shown(data)}")
        for key in data:
            if cls.noun and key not in cls.model_fields:
                raise _key_error(key, cls.unknown(key))
        data = {key: value for key, value in data.items() if value not in cls.unset}
        for key, field in cls.model_fields.items():
            if field.is_required() and key not in data:
                raise _key_error(key, cls.missing)
        return data


ModelT = TypeVar("ModelT", bound=BaseModel)


def _key_error(key: str, message: str) -> PydanticCustomError:
    return PydanticCustomError("key", "{message}", {"key": key, "message": message})


def dotted(location: Location) -> str:
    """Return a place in a file as ``mount.height_m``."""
    return ".".join(str(part)[:60] for part in location)


def validated(
    model: type[ModelT], data: Any, name: str, place: Callable[[Location], str] = dotted
) -> ModelT:
    """Return the model of a file's data.

    Args:
        name: how messages call the file.
        place: how messages call a place in it.

    Raises:
        InputError: one sentence that names the file, the key and what would be right.
    """
    try:
        return model.model_validate(data)
    except ValidationError as error:
        raise InputError(f"{name}: {problem(error, place)}") from None


def problem(error: ValidationError, place: Callable[[Location], str] = dotted) -> str:
    """Return the first error that pydantic found, as one sentence that names the place."""
    first = error.errors(include_url=False)[0]
    location = first["loc"]
    if first["type"] == "key":
        location = (*location, first["ctx"]["key"])
    return sentence(place(location), validation_words(first))


def sentence(where: str, message: str) -> str:
    """Return the message with the place in the file that it is about."""
    if "{at}" in message:
        return message.replace("{at}", where)
    return with_name(where, message)


def shown(value: PlainData) -> str:
    """Return a value as a message shows it."""
    return repr(value[:40]) if isinstance(value, str) else "several values"


def one_of(table: dict[str, Any], message: str) -> PlainValidator:
    """Validate a word by looking up its value in a table; ``message`` contains ``{given}``."""

    def look_up(value: PlainData) -> Any:
        if isinstance(value, str) and value in table:
            return table[value]
        raise ValueError(message.format(given=shown(value)))

    return PlainValidator(look_up)


def word(message: str) -> BeforeValidator:
    """Validate a text; ``message`` is the error for lists and mappings."""

    def check(value: PlainData) -> str:
        if not isinstance(value, str):
            raise ValueError(message)
        return value

    return BeforeValidator(check)


def _number(value: PlainData) -> float:
    if not isinstance(value, str) or NUMBER.fullmatch(value) is None:
        raise ValueError(f"must be a plain number, not {shown(value)}")
    # Very large numbers become infinity, which the code that uses the number refuses.
    return float(value)


Number = Annotated[float, PlainValidator(_number)]
Flag = Annotated[
    bool,
    one_of(
        {"true": True, "True": True, "false": False, "False": False},
        "must be true or false, not {given}",
    ),
]
