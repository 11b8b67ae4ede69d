"""Proofs on disk: plain JSON with exact numbers and nothing executable.

Numbers are written as hexadecimal floating-point text, so that reading returns the same numbers to the bit, infinities
included. A file is only data: `Proof.check` recomputes what it claims.
"""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from flatgym.files import write_text
from flatgym.scenarios.scenario import Scenario, Tolerance
from optimal.proof.branch_and_bound import ExcludedBranch
from optimal.proof.branches import Branch, PassingInterval, TiltInterval
from optimal.proof.programme.tilt_program import Grid
from optimal.proof.programme.time_grid import HoldGrid, TimeGrid
from optimal.proof.stages import Stage

SCHEMA = 2
"""Version of the file format."""
NUMBERS = ("time", "flown", "wall_time")


def encode(fields: dict[str, Any]) -> str:
    """Return the fields of a proof as the text of its file."""
    plain = dict(fields)
    plain["scenario"] = fields["scenario"].to_dict()
    plain["tolerance"] = None if fields["tolerance"] is None else asdict(fields["tolerance"])
    plain["verdict"] = fields["verdict"].name
    plain["kinks"] = _hexadecimal(fields["kinks"])
    plain["common"] = [_plain_stage(stage) for stage in fields["common"]]
    plain["excluded"] = [_plain_branch(*each) for each in fields["excluded"]]
    for name in NUMBERS:
        plain[name] = float(fields[name]).hex()
    return json.dumps({"schema": SCHEMA, "proof": plain}, allow_nan=False) + "\n"


def decode(text: str) -> dict[str, Any]:
    """Return the fields of a proof from the text of its file; the verdict by name.

    Raises:
        ValueError: for text that is not a proof of this schema.
    """
    try:
        data = json.loads(text)
        if data["schema"] != SCHEMA:
            raise ValueError(f"schema {data['schema']}, expected {SCHEMA}")
        fields = dict(data["proof"])
        fields["scenario"] = Scenario.from_dict(fields["scenario"])
        fields["tolerance"] = None if fields["tolerance"] is None else Tolerance(**fields["tolerance"])
        fields["kinks"] = _numbers(fields["kinks"])
        fields["common"] = tuple(_stage(each) for each in fields["common"])
        fields["excluded"] = tuple(_branch(each) for each in fields["excluded"])
        for name in NUMBERS:
            fields[name] = float.fromhex(fields[name])
    except (KeyError, TypeError, AttributeError, ValueError) as error:
        raise ValueError(f"not a proof: {error}") from None
    return fields


def write(path: str | Path, fields: dict[str, Any]) -> Path:
    """Write the fields of a proof to a file, and return its path."""
    path = Path(path)
    write_text(path, encode(fields))
    return path


def _hexadecimal(numbers: Any) -> list[str]:
    return [float(number).hex() for number in numbers]


def _numbers(plain: Any) -> tuple[float, ...]:
    return tuple(float.fromhex(number) for number in plain)


def _plain_branch(branch: Branch, stages: tuple[Stage, ...]) -> dict[str, Any]:
    return {
        "winding": branch.winding,
        "held": [_hexadecimal(held) for held in branch.held],
        "passing": [[int(hoop), *_hexadecimal(interval)] for hoop, *interval in branch.passing],
        "stages": [_plain_stage(stage) for stage in stages],
    }


def _plain_stage(stage: Stage) -> dict[str, Any]:
    hoops, multipliers = [int(hoop) for hoop in stage.hoops], _hexadecimal(stage.multipliers)
    return {"grid": _plain_grid(stage.grid), "hoops": hoops, "multipliers": multipliers}


def _stage(plain: dict[str, Any]) -> Stage:
    hoops = tuple(int(hoop) for hoop in plain["hoops"])
    return Stage(_grid(plain["grid"]), hoops, np.array(_numbers(plain["multipliers"])))


def _branch(plain: dict[str, Any]) -> ExcludedBranch:
    stages = tuple(_stage(each) for each in plain["stages"])
    held = tuple(TiltInterval(*_numbers(each)) for each in plain["held"])
    passing = tuple(PassingInterval(int(hoop), *_numbers(interval)) for hoop, *interval in plain["passing"])
    winding = None if plain["winding"] is None else int(plain["winding"])
    return ExcludedBranch(Branch(winding, held, passing), stages)


def _plain_grid(grid: Grid) -> dict[str, Any]:
    """Return a grid as plain data; a grid for held controls has `parts` and `step`."""
    return {name: value.hex() if isinstance(value, float) else value for name, value in asdict(grid).items()}


def _grid(plain: dict[str, Any]) -> Grid:
    values: dict[str, Any] = {
        name: float.fromhex(value) if isinstance(value, str) else None if value is None else int(value)
        for name, value in plain.items()
    }
    return HoldGrid(**values) if "parts" in values else TimeGrid(**values)
