"""Description of the interface's refusals: every one is a sentence."""

from __future__ import annotations

from typing import Any

from pydantic import TypeAdapter

from app.contract.refusals import Problems, Refused

_MEANINGS: dict[int, str] = {
    404: "Not found.",
    409: "Not possible in the current state.",
    503: "Not possible at the moment; try again.",
    507: "The disk is full.",
}
_SCHEMAS = "#/components/schemas/"


def _answer(model: type[Problems | Refused], description: str) -> dict[str, Any]:
    # By reference: from a model, each of these hundreds takes the framework a millisecond.
    schema = {"$ref": _SCHEMAS + model.__name__}
    return {"description": description, "content": {"application/json": {"schema": schema}}}


# What the gate in front of every route may answer.
GATE_RESPONSES: dict[int | str, dict[str, Any]] = {
    400: _answer(Refused, "The request is malformed or meant for another host."),
    401: _answer(Refused, "No token, or a wrong one."),
    403: _answer(
        Refused, "Sent by a page of another site, or a change requested with a read-only link."
    ),
    429: _answer(Refused, "Too many wrong tokens from this address."),
}
# What it may also answer to requests that may have a body.
BODY_RESPONSES: dict[str, dict[str, Any]] = {
    "413": _answer(Refused, "The body is too large."),
    "415": _answer(Refused, "The body is of the wrong kind."),
}


def refusals(*codes: int) -> dict[int | str, dict[str, Any]]:
    """Return the ``responses`` of a route that may answer with these codes."""
    return {
        code: _answer(Problems, "Values were refused; nothing was changed.")
        if code == 422
        else _answer(Refused, _MEANINGS[code])
        for code in codes
    }


def refusal_schemas() -> dict[str, Any]:
    """Return the schemas that the references above name."""
    both: TypeAdapter[Any] = TypeAdapter(Problems | Refused)
    schema = both.json_schema(mode="serialization", ref_template=_SCHEMAS + "{model}")
    found: dict[str, Any] = schema["$defs"]
    return found
