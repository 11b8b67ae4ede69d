"""Scenarios and distributions in files: TOML or JSON with the fields of the dataclass.

    load("my_track.toml")    # a Scenario, or with kind = "distribution" a Distribution

A file has the structure of `to_dict`. Fields with a default may be left out. `name` may be left out too: it is then
that of the file. `flatgym.scenarios.schema` describes the structure as a JSON Schema.
"""

from __future__ import annotations

import json
import math
import os
import tomllib
from collections.abc import Collection, Iterator
from dataclasses import fields
from itertools import pairwise
from pathlib import Path
from typing import Any

from flatgym.docstrings import listed
from flatgym.scenarios.content import hint, parse_json
from flatgym.scenarios.distributions import Distribution
from flatgym.scenarios.scenario import Scenario

Task = Scenario | Distribution
KINDS: dict[str, type[Task]] = {"scenario": Scenario, "distribution": Distribution}
"""The dataclass of each value of `kind`; a file without it holds a scenario."""
SUFFIXES = (".toml", ".json")
"""Endings of files."""


def load(path: str | os.PathLike[str]) -> Task:
    """Return the scenario or distribution in a file.

    Raises:
        ValueError: naming the file: for one that is missing, damaged, with the line, or of another ending, for the
            errors of the dataclasses, and for those of `check_places`.
    """
    path = Path(path)
    if path.suffix not in SUFFIXES:
        raise ValueError(f"{path}: a scenario's file ends in {' or '.join(SUFFIXES)}")
    try:
        text = path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise ValueError(f"there is no file {path}; `flatquad init {path}` writes an example") from None
    except UnicodeDecodeError as error:
        raise ValueError(f"{path} is no UTF-8 text: {error}") from None
    try:
        data = tomllib.loads(text) if path.suffix == ".toml" else parse_json(text)
        found = from_dict({"name": path.stem} | data if isinstance(data, dict) else data)
        check_places(found)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{path}: {error}") from None
    return found


def check_places(task: Task) -> None:
    """Raise a ValueError for a hoop that repeats the one before it, and for start or goal inside a rim.

    A hoop may be passed twice, with another between. A body at a point nearer to a rim than its radius collides.
    """
    if not isinstance(task, Scenario):
        return
    for i, (one, other) in enumerate(pairwise(task.hoops), start=1):
        if one == other:
            raise ValueError(f"Scenario.hoops[{i}] repeats Scenario.hoops[{i - 1}]: {other}; leave one out")
    radius = task.quadrotor.radius
    for i, hoop in enumerate(task.hoops):
        for name in ("start", "goal"):
            distance = min(math.dist(getattr(task, name), rim) for rim in hoop.rims)
            if distance < radius:
                raise ValueError(
                    f"Scenario.{name} {getattr(task, name)} lies {distance:.3g} m from a rim of Scenario.hoops[{i}], "
                    f"where a body of radius {radius} m collides; move one of them"
                )


def from_dict(data: dict[str, Any]) -> Task:
    """Return the scenario or distribution of a `to_dict`: that of its `kind`, by default a scenario."""
    kind = data.get("kind", "scenario") if isinstance(data, dict) else "scenario"
    if not isinstance(kind, str) or kind not in KINDS:
        raise ValueError(f"unknown kind {kind!r}; known: {', '.join(KINDS)}{hint(kind, KINDS)}")
    return KINDS[kind].from_dict(data)


def to_text(task: Task, suffix: str) -> str:
    """Return the text of a file with a task, TOML with comments or JSON; `load` reads it back."""
    if suffix == ".json":
        return json.dumps({"kind": kind_of(task)} | task.to_dict(), indent=1, ensure_ascii=False) + "\n"
    return "\n".join(_toml(task)) + "\n"


def kind_of(task: Task) -> str:
    """Return the value of `kind`."""
    return next(kind for kind, one in KINDS.items() if isinstance(task, one))


def _toml(task: Task) -> Iterator[str]:
    """Yield the lines of a TOML file: fields below comments that say what they are, then tables, the hoops last."""
    yield "# Lengths in metres, times in seconds, angles in radians."
    yield f"kind = {_value(kind_of(task))}"
    hoops = task.hoops if isinstance(task, Scenario) else ()
    yield from _fields(
        task, comments=True, without=("quadrotor", "tolerance", "hoops" if isinstance(task, Scenario) else "")
    )
    for name in ("quadrotor", "tolerance"):
        yield from ("", f"[{name}]", *_fields(getattr(task, name), comments=True))
    for i, hoop in enumerate(hoops):
        yield from ("", f"[[hoops]]  # {i + 1}", *_fields(hoop, comments=i == 0))


def _fields(owner: Any, comments: bool, without: Collection[str] = ()) -> Iterator[str]:
    """Yield the fields of a dataclass; one that is None is commented out, because TOML has no null."""
    meanings, before = listed(type(owner)) if comments else {}, ""
    for field in fields(owner):
        if field.name in without:
            continue
        meaning, value = meanings.get(field.name, "").rstrip("."), getattr(owner, field.name)
        if meaning and meaning != before:  # fields that share a comment stand below it
            yield f"# {meaning}"
        yield f"{field.name} = {_value(value)}" if value is not None else f"# {field.name} = ..."
        before = meaning


def _value(value: Any) -> str:
    """Return a value as TOML: text, number, or list."""
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
