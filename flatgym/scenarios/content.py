"""Scenarios and distributions as plain data, and the digest of their content.

    Scenario.from_dict(scenario.to_dict()) == scenario
    scenario.digest == replace(scenario, name="other").digest

The digest is a SHA-256 of all fields but the name. Two tasks with the same digest have the same flights, whatever they
are called, so stored answers and results are found by it.
"""

from __future__ import annotations

import difflib
import hashlib
import json
from collections.abc import Iterable
from dataclasses import MISSING, asdict, fields
from functools import cached_property
from typing import Any, Self, TypeVar

T = TypeVar("T")


class Content:
    """What the dataclasses of tasks share: the plain data, and the digest."""

    def to_dict(self) -> dict[str, Any]:
        """Return all fields as dicts, lists, numbers and strings, ready for JSON."""
        data: dict[str, Any] = json.loads(json.dumps(asdict(self)))  # type: ignore[call-overload]
        return data

    def to_json(self) -> str:
        """Return all fields as JSON text."""
        return json.dumps(self.to_dict())

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> Self:
        """Return the task of a `to_dict`."""
        raise NotImplementedError

    @classmethod
    def from_json(cls, text: str) -> Self:
        """Return the task of a `to_json`; a ValueError for any other text."""
        return cls.from_dict(parse_json(text))

    @cached_property
    def digest(self) -> str:
        """SHA-256 of the content, 64 hexadecimal digits.

        It is that of the UTF-8 text of `to_dict` without the name, as JSON with sorted keys and without spaces.
        Numbers are written with the fewest digits that read back the same; decimals with a point, as in 5.0.
        """
        content = {key: value for key, value in self.to_dict().items() if key != "name"}
        text = json.dumps(content, sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(text.encode()).hexdigest()


def parse_json(text: str) -> Any:
    """Return the data of a JSON text; a ValueError if it is damaged, or a key occurs twice in an object."""
    try:
        return json.loads(text, object_pairs_hook=_unique)
    except (json.JSONDecodeError, RecursionError) as error:
        raise ValueError(f"not a scenario: {error}") from None


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return a dict of pairs; a ValueError for a key that occurs twice."""
    found = dict(pairs)
    if len(found) < len(pairs):
        keys = [key for key, _ in pairs]
        raise ValueError(f"the field {next(key for key in keys if keys.count(key) > 1)!r} is given twice")
    return found


def fields_of(data: Any, kind: str) -> dict[str, Any]:
    """Return the fields of a task of one kind, "scenario" or "distribution", without "kind".

    Raises:
        ValueError: for anything but a dict, and for another kind.
    """
    if not isinstance(data, dict):
        raise ValueError(f"a {kind} must be a table of its fields, got {data!r}")
    values = dict(data)
    if (found := values.pop("kind", "scenario")) != kind:
        raise ValueError(f"expected kind = {kind!r}, got {found!r}")
    return values


def build(kind: type[T], data: Any, owner: str) -> T:
    """Return the dataclass with these fields.

    Args:
        kind: the dataclass.
        data: values by field name.
        owner: what the errors call it.

    Raises:
        ValueError: for anything but a dict, for an unknown field, with the known ones and the nearest, and for a
            missing one.
    """
    known = {field.name: field for field in fields(kind)}  # type: ignore[arg-type]
    if not isinstance(data, dict):
        raise ValueError(f"{owner} must be a table of {', '.join(known)}, got {data!r}")
    for name in data:
        if name not in known:
            raise ValueError(f"{owner} has no field {name!r}; known: {', '.join(known)}{hint(name, known)}")
    for name, field in known.items():
        if name not in data and field.default is MISSING and field.default_factory is MISSING:
            raise ValueError(f"{owner} lacks the field {name!r}")
    return kind(**data)


def hint(word: Any, known: Iterable[str]) -> str:
    """Return "; did you mean ...?" with the known word that is nearest, or an empty text if none is near."""
    near = difflib.get_close_matches(str(word), list(known), n=1)
    return f"; did you mean {near[0]!r}?" if near else ""
