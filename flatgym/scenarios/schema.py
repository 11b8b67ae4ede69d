"""The JSON Schema of scenario files, made from the dataclasses and their docstrings.

It names the fields, their types, defaults, meanings and units. Limits that depend on other fields, such as a goal above
the floor, are checked by the dataclasses.
"""

from __future__ import annotations

import types
from dataclasses import MISSING, fields, is_dataclass
from typing import Any, Union, get_args, get_origin, get_type_hints

from flatgym.docstrings import listed
from flatgym.quadrotor import Quadrotor
from flatgym.scenarios.files import KINDS
from flatgym.scenarios.scenario import Hoop, Scenario, Tolerance

TYPES = {float: "number", int: "integer", str: "string"}


def schema() -> dict[str, Any]:
    """Return the JSON Schema of a scenario or distribution in a file."""
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "FlatQuad scenario or distribution",
        "description": "Lengths in metres, times in seconds, angles in radians.",
        "oneOf": [{"$ref": f"#/$defs/{kind.__name__}"} for kind in KINDS.values()],
        "$defs": {kind.__name__: _object(kind) for kind in (*KINDS.values(), Hoop, Quadrotor, Tolerance)},
    }


def _object(kind: type) -> dict[str, Any]:
    """Return the schema of a dataclass; a file may leave out the name, and `kind` of a scenario."""
    hints, meanings, properties, required = get_type_hints(kind), listed(kind), {}, []
    for name, one in KINDS.items():
        if one is kind:
            properties["kind"] = {"const": name}
            required += [] if kind is Scenario else ["kind"]
    for field in fields(kind):
        properties[field.name] = _value(hints[field.name])
        if field.name in meanings:
            properties[field.name]["description"] = meanings[field.name]
        if field.default is not MISSING:
            properties[field.name]["default"] = field.default
        elif field.default_factory is MISSING and field.name != "name":
            required.append(field.name)
    return {"type": "object", "properties": properties, "required": required, "additionalProperties": False}


def _value(hint: Any) -> dict[str, Any]:
    """Return the schema of a type: a number, a text, a fixed or open list, another dataclass, or None as well."""
    if is_dataclass(hint):
        return {"$ref": f"#/$defs/{hint.__name__}"}  # type: ignore[union-attr]
    if hint in TYPES:
        return {"type": TYPES[hint]}
    parts = get_args(hint)
    if get_origin(hint) in (Union, types.UnionType):
        return {"anyOf": [{"type": "null"} if part is types.NoneType else _value(part) for part in parts]}
    if parts[1] is Ellipsis:
        return {"type": "array", "items": _value(parts[0])}
    return {"type": "array", "prefixItems": [_value(part) for part in parts], "minItems": len(parts), "items": False}
