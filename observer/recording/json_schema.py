"""JSON schemas of our own messages, in the form that Foxglove and Lichtblick understand.

Their parsers support one plain ``type`` per property, and neither alternatives nor references nor
arrays of arrays. Properties that may be null are therefore marked ``nullable`` (as in OpenAPI 3.0)
beside their type, and arrays of arrays are put under ``patternProperties``, which those parsers
ignore. No draft of JSON Schema has ``nullable``, so no ``$schema`` is given.
"""

from __future__ import annotations

from typing import Any

from msgspec import inspect

_Object = inspect.StructType | inspect.TypedDictType | inspect.DataclassType
_PLAIN: dict[type[inspect.Type], str] = {
    inspect.BoolType: "boolean",
    inspect.IntType: "integer",
    inspect.FloatType: "number",
    inspect.StrType: "string",
    inspect.LiteralType: "string",
}


def json_schema(payload: type[Any]) -> dict[str, Any]:
    """Return the schema of a payload's JSON."""
    described = inspect.type_info(payload)
    assert isinstance(described, _Object)
    title = {"title": payload.__name__, "description": (payload.__doc__ or "").partition("\n")[0]}
    return {**title, **_of(described)}


def _of(kind: inspect.Type) -> dict[str, Any]:
    if isinstance(kind, inspect.UnionType):
        (known,) = (one for one in kind.types if not isinstance(one, inspect.NoneType))
        return {**_of(known), "nullable": True}
    if isinstance(kind, _Object):
        return _object(kind)
    if isinstance(kind, inspect.TupleType):
        # The values of a tuple all have the same type.
        return {"type": "array", "items": _of(kind.item_types[0])}
    if isinstance(kind, inspect.ListType | inspect.VarTupleType):
        return {"type": "array", "items": _of(kind.item_type)}
    if isinstance(kind, inspect.DictType):
        values = kind.value_type
        further = {} if isinstance(values, inspect.AnyType) else _of(values)
        return {"type": "object", "properties": {}, "additionalProperties": further or True}
    return {"type": _PLAIN[type(kind)]}


def _object(kind: _Object) -> dict[str, Any]:
    properties, nested, required = {}, {}, []
    for field in kind.fields:
        name = getattr(field, "encode_name", field.name)
        schema = _of(field.type)
        if schema.get("items", {}).get("type") == "array":
            nested[f"^{name}$"] = schema
        else:
            properties[name] = schema
        if field.required:
            required.append(name)
    result = {"type": "object", "properties": properties, "required": required}
    return {**result, "patternProperties": nested} if nested else result
