"""Tables of defaults: the fields of a dataclass, their default values, and what its docstring says of them."""

from __future__ import annotations

import ast
import inspect
from dataclasses import MISSING, Field, fields
from itertools import pairwise
from textwrap import dedent
from typing import Any

from flatgym.docstrings import listed


def defaults(kind: type) -> str:
    """Return the fields of a dataclass as a Markdown table: name, default, meaning."""
    meanings = attributes(kind)
    rows = [
        f"| `{field.name}` | {value(field)} | {meanings.get(field.name, '').replace('|', chr(92) + '|')} |"
        for field in fields(kind)
    ]
    return "\n".join(["| field | default | meaning |", "| --- | --- | --- |", *rows])


def attributes(kind: type) -> dict[str, str]:
    """Return what a class and its bases say of each attribute, without the full stop.

    An attribute is described in the section `Attributes:` of the class docstring, or in a string below its definition.
    """
    found: dict[str, str] = {}
    for one in reversed(kind.__mro__[:-1]):
        found |= listed(one) | below(one)
    return {name: " ".join(text.split()).rstrip(".").replace("^2", "²") for name, text in found.items()}


def below(kind: type) -> dict[str, str]:
    """Return the strings that stand below the definitions of attributes."""
    (definition,) = ast.parse(dedent(inspect.getsource(kind))).body
    assert isinstance(definition, ast.ClassDef)
    return {
        first.target.id: str(second.value.value)
        for first, second in pairwise(definition.body)
        if isinstance(first, ast.AnnAssign) and isinstance(first.target, ast.Name)
        and isinstance(second, ast.Expr) and isinstance(second.value, ast.Constant)
    }  # fmt: skip


def value(field: Field[Any]) -> str:
    """Return the default of a field as it is written in code, or that it is required."""
    if field.default is not MISSING:
        exact = type(field.default) is int
        return f"`{field.default:_}`" if exact else f"`{field.default!r}`"
    if field.default_factory is not MISSING:
        made = field.default_factory()
        return f"`{type(made).__name__}()`" if hasattr(made, "__dataclass_fields__") else f"`{made!r}`"
    return "required"
