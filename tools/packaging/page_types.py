"""Write the contract's schema, from which the page's types are made, to the standard output.

    python -m tools.packaging.page_types

``tools/packaging/frontend.py types`` makes the page's types from it.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from pydantic import TypeAdapter

from app.contract.sockets import DriveMessage, LiveMessage

_REFERENCE = "#/components/schemas/{model}"
# Fewer common properties may be a coincidence.
_FEWEST_SHARED = 5


def page_schema() -> dict[str, Any]:
    """Return the schemas of all REST bodies, replies and socket messages, as OpenAPI 3.1."""
    from app.http.server import create_app
    from app.settings import Settings

    with TemporaryDirectory() as folder:
        described = create_app(Settings(data=Path(folder)), "").openapi()
    schemas = {
        # Unlike requests, the server's messages always contain every field.
        name: schema
        if schema.get("additionalProperties") is False
        else {**schema, "required": list(schema.get("properties", ()))}
        for name, schema in described["components"]["schemas"].items()
    }
    said: dict[str, Any] = {"LiveMessage": LiveMessage, "DriveMessage": DriveMessage}
    for name, messages in said.items():
        schema = TypeAdapter(messages).json_schema(mode="serialization", ref_template=_REFERENCE)
        schemas = {**schema.pop("$defs"), **schemas, name: schema}
    schemas = {name: _extending(name, schemas) for name in schemas}
    page: dict[str, Any] = _untitled({**described, "paths": {}, "components": {"schemas": schemas}})
    return page


def _extending(name: str, schemas: dict[str, Any]) -> Any:
    """Return a schema as an extension of the largest one that it contains, or else unchanged."""
    schema = schemas[name]
    own = schema.get("properties", {})
    contained = {
        each: properties
        for each, other in schemas.items()
        if len(properties := other.get("properties", {})) < len(own)
        and all(own.get(key) == value for key, value in properties.items())
    }
    base = max(contained, key=lambda each: len(contained[each]), default="")
    if len(contained.get(base, ())) < _FEWEST_SHARED:
        return schema
    added = {key: value for key, value in own.items() if key not in contained[base]}
    own_part = {"type": "object", "properties": added, "required": list(added)}
    about = {"description": schema["description"]} if "description" in schema else {}
    return {**about, "allOf": [{"$ref": _REFERENCE.format(model=base)}, own_part]}


def _untitled(schema: Any) -> Any:
    """Remove the titles, which only repeat the names."""
    if isinstance(schema, list):
        return [_untitled(each) for each in schema]
    if not isinstance(schema, dict):
        return schema
    # A property named title is not a string.
    titled = isinstance(schema.get("title"), str)
    return {k: _untitled(v) for k, v in schema.items() if not (titled and k == "title")}


if __name__ == "__main__":
    json.dump(page_schema(), sys.stdout)
