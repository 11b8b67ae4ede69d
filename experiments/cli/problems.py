"""`flatquad list`, `init` and `show`: the named scenarios and distributions, and those in files of one's own."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pandas as pd
import typer

import flatgym
from experiments.cli.options import AsJson, ProblemName
from experiments.files import cache_folder, check_output
from experiments.formats import lower_bound
from experiments.terminal import cell, messages, paragraph, screen, show, show_record, table
from flatgym import Distribution, Hoop, Scenario
from flatgym.docstrings import listed
from flatgym.files import write_text
from flatgym.scenarios import catalogue
from flatgym.scenarios.catalogue import Problem
from flatgym.scenarios.files import SUFFIXES, to_text
from flatgym.scenarios.reference import reference

EXAMPLES = "Example: flatquad list --json"
INIT_EXAMPLES = "Example: flatquad init my_track.toml; flatquad init my_slalom.toml --scenario slalom"
SHOW_EXAMPLES = "Example: flatquad show my_track.toml --out my_track.svg; flatquad show random-hoops-3-0"
EXAMPLE = Scenario(
    "my_track",
    start=(0.0, 1.0),
    goal=(8.0, 1.0),
    hoops=(Hoop(2.5, 1.5, 0.8), Hoop(5.0, 2.5, 0.8, 0.5), Hoop(7.0, 1.5, 0.8, -0.5)),
    floor=0.0,
    ceiling=4.0,
)
"""The track that `flatquad init` writes."""
KNOWN = ("time_s", "lower_bound_s", "k_star", "k_lower_bound", "proven")
"""What may be known of a scenario's optimum: T* and its lower bound; K*, its lower bound, and whether it is proven."""


def list_problems(as_json: AsJson = False) -> None:
    """List the named scenarios with their best-known solutions, and the distributions of random scenarios."""
    scenarios = [scenario_row(scenario) for scenario in flatgym.SCENARIOS.values()]
    distributions = [distribution_row(distribution) for distribution in flatgym.DISTRIBUTIONS.values()]
    if as_json:
        # dtype object keeps whole numbers whole in columns that also hold None.
        show(pd.DataFrame([*scenarios, *distributions], dtype=object), as_json)
        return
    head = ["scenario", "goal [m]", "hoops", "floor", "T* [s]", "lower bound", "K*", "proven"]
    table("Scenarios", head, [known_solution(row) for row in scenarios], optional=("floor", "hoops"))
    paragraph(
        "T*: the best-known flight time, exactly from rest to rest; no flight is faster than the lower bound. "
        "K*: the fewest environment steps known, with the tolerance at the goal; proven if no flight takes fewer."
    )
    keys = ("scenario", "goal", "hoops")
    table(
        "Distributions", ["distribution", "goal, one for each episode", "hoops"],
        [[cell(row[key]) for key in keys] for row in distributions],
    )  # fmt: skip


def known_solution(row: dict[str, Any]) -> list[str]:
    """Return the cells of a scenario; the lower bound is rounded down."""
    keys = ("scenario", "goal", "hoops", "floor")
    time, bound = row["time_s"], row["lower_bound_s"]
    return [
        *(cell(row[key]) for key in keys),
        "-" if time is None else f"{time:.5f}",
        "-" if bound is None else lower_bound(bound),
        cell(row["k_star"]),
        "-" if row["proven"] is None else "yes" if row["proven"] else "no",
    ]


def init(
    path: Annotated[Path, typer.Argument(help="The file to write, a .toml or .json file.", show_default=False)],
    scenario: Annotated[
        str, typer.Option(help="Scenario or distribution to copy.", show_default="a track with three hoops")
    ] = "",
) -> None:
    """Write a scenario as a file to edit: TOML with comments, or JSON."""
    if path.is_file():
        raise ValueError(f"{path} exists already and is not replaced; give another name")
    task = replace(catalogue.problem(scenario) if scenario else EXAMPLE, name=path.stem)
    write_text(check_output(path, SUFFIXES), to_text(task, path.suffix))
    messages.print(f"written: {path.resolve()}", soft_wrap=True)
    messages.print(f"Edit it, then run `flatquad show {path}` and `flatquad solve {path} --steps`.", soft_wrap=True)


def show_problem(
    scenario: ProblemName,
    out: Annotated[Path | None, typer.Option(help="Draw it to a .svg, .png or .html file.", show_default=False)] = None,
    as_json: AsJson = False,
) -> None:
    """Show a scenario or distribution: its fields, and what is known of its optimum."""
    task = catalogue.problem(scenario)
    known = known_answers(task) if isinstance(task, Scenario) else {}
    if out is not None:
        draw(task, out)
        messages.print(f"picture: {out.resolve()}", soft_wrap=True)
    if as_json:
        row = {"label": catalogue.label(task), "digest": task.digest, **known, "content": task.to_dict()}
        show(pd.DataFrame([row], dtype=object), as_json)
        return
    show_record(dict(described(task)) | optimum_lines(known), False, catalogue.label(task))
    screen.print()
    if isinstance(task, Scenario) and task.hoops:
        head = ["hoop", "x [m]", "z [m]", "diameter [m]", "angle [rad]", "angle [deg]", "from the last [m]"]
        table("Hoops, in order of passage", head, hoop_cells(task), optional=("angle [deg]", "from the last [m]"))


def described(owner: Any, prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the fields of a task or of a part of it, with their units, and their values."""
    meanings = listed(type(owner))
    for field in fields(owner):
        value = getattr(owner, field.name)
        unit = re.search(r"\[[^\]]+\]", meanings.get(field.name, ""))
        name = " ".join(filter(None, [prefix, field.name, unit and unit[0]]))
        if is_dataclass(value):
            yield from described(value, field.name)
        elif isinstance(owner, Scenario) and field.name == "hoops":
            yield name, len(value)
        else:
            yield name, ", ".join(f"{x:g}" for x in value) if isinstance(value, tuple) else value
    if not prefix:
        yield "digest", owner.digest[:16]


def hoop_cells(scenario: Scenario) -> list[list[str]]:
    """Return a row for each hoop: its number, its fields, and the distance from the point before it."""
    points = [scenario.start, *((hoop.x, hoop.z) for hoop in scenario.hoops)]
    return [
        [
            f"{i}",
            *(f"{value:g}" for value in (hoop.x, hoop.z, hoop.diameter)),
            *(f"{value:.4g}" for value in (hoop.angle, math.degrees(hoop.angle), math.dist(points[i - 1], points[i]))),
        ]
        for i, hoop in enumerate(scenario.hoops, start=1)
    ]


def known_answers(scenario: Scenario) -> dict[str, Any]:
    """Return T*, K* and their bounds, with KNOWN as keys: shipped, else the best of this machine's; None if unknown."""
    if (known := reference(scenario)) is not None:
        values = known.time, known.time_lower_bound, known.k_star, known.k_lower_bound, known.proven
        return dict(zip(KNOWN, values, strict=True))
    from optimal import FewestSteps, Solution
    from optimal.store import stored_answers

    answers = stored_answers(cache_folder(), scenario)
    solved = [answer for answer in answers if isinstance(answer, Solution) and math.isfinite(answer.time)]
    counted = [answer for answer in answers if isinstance(answer, FewestSteps) and math.isfinite(answer.steps)]
    time = min((answer.time for answer in solved), default=None)
    bound = max((answer.certificate.lower_bound for answer in solved), default=None)
    steps = min((int(answer.steps) for answer in counted), default=None)
    least = max((answer.lower_bound for answer in counted), default=None)
    return dict(zip(KNOWN, (time, bound, steps, least, steps and steps == least), strict=True))


def optimum_lines(known: dict[str, Any]) -> dict[str, Any]:
    """Return what is known of the optimum in words; nothing for a distribution."""
    if not known:
        return {}
    proof = "proven" if known["proven"] else f"no flight takes fewer than {known['k_lower_bound']}"
    return {
        "T* [s]": "unknown; run `flatquad solve`" if known["time_s"] is None else f"{known['time_s']:.5f}",
        "lower bound of T* [s]": None if known["lower_bound_s"] is None else lower_bound(known["lower_bound_s"]),
        "K* [steps]": "unknown; run `flatquad solve --steps`"
        if known["k_star"] is None
        else f"{known['k_star']}, {proof}",
    }


def draw(task: Problem, path: Path) -> None:
    """Draw a scenario, or the first sample of a distribution, with the best flight that is known, if any."""
    from agents.evaluation.optima import stored_flight
    from experiments.publishing.scenarios import write_sketch
    from flatgym.task.rollout import open_loop_states

    scenario = task if isinstance(task, Scenario) else task.scenario(0, 0)
    flight = reference(scenario) or stored_flight(scenario, cache_folder())
    states = np.zeros((0, 5)) if flight is None else open_loop_states(scenario, flight.actions)
    write_sketch(path, scenario, states)


def scenario_row(scenario: Scenario) -> dict[str, Any]:
    """Return a named scenario and its best-known solution."""
    return {
        "scenario": scenario.name,
        "kind": "scenario",
        "start": _point(scenario.start),
        "goal": _point(scenario.goal),
        "hoops": len(scenario.hoops),
        "floor": scenario.floor,
        "dt_s": scenario.dt,
        **known_answers(scenario),
    }


def distribution_row(distribution: Distribution) -> dict[str, Any]:
    """Return a distribution under the same keys; the optima of its scenarios are None."""
    low, high = distribution.hoops
    goal = f"within {distribution.half_width:g} m in x and z, at least {distribution.least_distance:g} m away"
    if distribution.leg is not None:
        shortest, longest = distribution.leg
        goal = f"the end of a track with legs of {shortest:g} to {longest:g} m"
    return {
        "scenario": distribution.name,
        "kind": "distribution",
        "start": _point((0.0, 0.0)),
        "goal": goal,
        "hoops": low if low == high else f"{low} to {high}",
        "floor": None,
        "dt_s": distribution.dt,
        **dict.fromkeys(KNOWN),
    }


def _point(point: tuple[float, float]) -> str:
    return f"({point[0]:g}, {point[1]:g})"
