"""A saved proof as plain data, and whether its branches cover all flights."""

from __future__ import annotations

import itertools
import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from flatgym.quadrotor import Array
from flatgym.scenarios.scenario import Scenario, Tolerance

SCHEMA = 2
"""Version of the files that are read."""
MOST_PIECES = 200_000
"""Most pieces into which the flights of one winding are cut to see whether all are covered."""
Interval = tuple[float, float]
Key = tuple[str, float]


class TooLarge(Exception):
    """A proof is too large for this checker."""


@dataclass(frozen=True)
class Stage:
    """A grid, the hoops of its chain, and multipliers.

    Attributes:
        steps, turn: number of time steps, and of angles of a whole turn.
        stride: chains pass hoops at multiples of this number of instants.
        duration: duration of the grid [s]; None for the one in which the vehicle turns by one angle in a time step.
        rate_max: greatest rate that the grid is made for [rad/s].
        parts, step: for held controls, instants in one environment step, and its length [s]; else 0.
        hoops: indices of the hoops of the chain.
        multipliers: shape (2 (m + 2) + kinks + 2,).
    """

    steps: int
    turn: int
    stride: int
    duration: float | None
    rate_max: float
    parts: int
    step: float
    hoops: tuple[int, ...]
    multipliers: Array


@dataclass(frozen=True)
class Branch:
    """A class of flights: by winding (None for all), by tilts at shares of T, by passing times as shares of T."""

    winding: int | None
    held: tuple[tuple[float, float, float], ...]
    passing: tuple[tuple[int, float, float], ...]
    stages: tuple[Stage, ...]


@dataclass(frozen=True)
class Claimed:
    """What a saved proof claims: no flight of the scenario takes the time [s], or that number of held steps."""

    scenario: Scenario
    tolerance: Tolerance | None
    time: float
    kinks: tuple[float, ...]
    steps: int
    common: tuple[Stage, ...]
    branches: tuple[Branch, ...]


def read(path: str | Path) -> Claimed:
    """Return what a saved proof claims; a ValueError for a file that is not a proof."""
    try:
        data = json.loads(Path(path).read_text(encoding="utf-8"))
        if data["schema"] != SCHEMA:
            raise ValueError(f"schema {data['schema']!r}, this checker reads {SCHEMA}")
        plain = data["proof"]
        near = plain["tolerance"]
        return Claimed(
            scenario=Scenario.from_dict(plain["scenario"]),
            tolerance=None if near is None else Tolerance(**near),
            time=_number(plain["time"]),
            kinks=tuple(map(_number, plain["kinks"])),
            steps=int(plain["steps"]),
            common=tuple(map(_stage, plain["common"])),
            branches=tuple(map(_branch, plain["excluded"])),
        )
    except (KeyError, TypeError, AttributeError, ValueError) as error:
        raise ValueError(f"not a proof: {type(error).__name__}: {error}") from None


def _number(text: str) -> float:
    return float.fromhex(text)


def _stage(plain: dict[str, Any]) -> Stage:
    grid = plain["grid"]
    length = grid.get("duration")
    return Stage(
        steps=int(grid["steps"]),
        turn=int(grid["turn"]),
        stride=int(grid.get("stride", 1)),
        duration=None if length is None else _number(length),
        rate_max=_number(grid["rate_max"]),
        parts=int(grid.get("parts", 0)),
        step=_number(grid["step"]) if "step" in grid else 0.0,
        hoops=tuple(map(int, plain["hoops"])),
        multipliers=np.array(list(map(_number, plain["multipliers"])), dtype=np.float64),
    )


def _branch(plain: dict[str, Any]) -> Branch:
    return Branch(
        winding=None if plain["winding"] is None else int(plain["winding"]),
        held=tuple((_number(share), _number(low), _number(high)) for share, low, high in plain["held"]),
        passing=tuple((int(hoop), _number(low), _number(high)) for hoop, low, high in plain["passing"]),
        stages=tuple(map(_stage, plain["stages"])),
    )


def all_covered(claimed: Claimed) -> bool:
    """Return whether every flight belongs to a branch.

    Raises:
        TooLarge: for more pieces than MOST_PIECES.
    """
    if any(branch.winding is None and not branch.held and not branch.passing for branch in claimed.branches):
        return True
    slack = claimed.tolerance.angle if claimed.tolerance else 0.0
    most = (claimed.scenario.quadrotor.rate_max * claimed.time + slack) * (1 + 1e-12) / (2 * math.pi)
    return all(
        _winding_covered([branch for branch in claimed.branches if branch.winding == winding])
        for winding in range(-math.floor(most), math.floor(most) + 1)
    )


def _winding_covered(branches: list[Branch]) -> bool:
    """Return whether boxes cover all tilts and passing times: every piece between neighbouring ends lies in one."""
    boxes = [_box(branch) for branch in branches]
    keys = sorted({key for box in boxes for key in box})
    ends = [sorted({end for box in boxes if key in box for end in box[key] if math.isfinite(end)}) for key in keys]
    if math.prod(len(cuts) + 1 for cuts in ends) > MOST_PIECES:
        raise TooLarge("its branches are too many")
    pieces = [list(itertools.pairwise([-math.inf, *cuts, math.inf])) for cuts in ends]
    return all(
        any(all(_inside(piece, box.get(key)) for key, piece in zip(keys, place, strict=True)) for box in boxes)
        for place in itertools.product(*pieces)
    )


def _box(branch: Branch) -> dict[Key, Interval]:
    box: dict[Key, Interval] = {}
    bounds: list[tuple[Key, float, float]] = [(("tilt", at), low, high) for at, low, high in branch.held]
    bounds += [(("hoop", float(hoop)), low, high) for hoop, low, high in branch.passing]
    for key, low, high in bounds:
        least, most = box.get(key, (-math.inf, math.inf))
        box[key] = (max(low, least), min(high, most))
    return box


def _inside(piece: Interval, interval: Interval | None) -> bool:
    return interval is None or (interval[0] <= piece[0] and piece[1] <= interval[1])
