"""Outer paths of a scenario: those of the package pass, and a small change that breaks one requirement is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import optimal
from flatgym.scenarios.catalogue import SCENARIOS
from flatgym.scenarios.scenario import Hoop
from optimal.paths.corridors import Corridor, corridor, is_printed, paper_corridor
from optimal.paths.curves import BSplinePath, PolynomialPath, Resting
from optimal.paths.gates import hoop_coordinates
from optimal.paths.passage import require_passage

SMALL = 1e-4
"""A change that breaks a requirement [m]."""
SPLINE = corridor(SCENARIOS["slalom"])


def moved(path: BSplinePath, step: tuple[float, float], *, at: float) -> BSplinePath:
    """Return a spline with its control points moved by a step, all but those at the ends, most near one s."""
    points = np.array(path.points)
    share = np.linspace(0.0, 1.0, len(points))
    near = np.maximum(1 - np.abs(share - at) / 0.1, 0.0)
    near[:3] = near[-3:] = 0.0
    return replace(path, points=tuple(map(tuple, points + near[:, None] * step)))


@pytest.mark.parametrize("name", SCENARIOS)
def test_corridors_of_the_package_pass(name):
    require_passage(corridor(SCENARIOS[name]), SCENARIOS[name])
    if is_printed(SCENARIOS[name]):
        require_passage(paper_corridor(SCENARIOS[name]), SCENARIOS[name])


@pytest.mark.parametrize("index", [0, 1])
def test_a_path_that_leaves_a_gap_is_refused_with_its_place(index):
    task, s = SCENARIOS["slalom"], hoop_coordinates(SCENARIOS["slalom"])[1]
    outwards = np.sign((SPLINE.paths[index](s) - task.hoops[1].centre) @ task.hoops[1].across)
    inside, outside = (
        tuple(moved(path, tuple(sign * SMALL * outwards * task.hoops[1].across), at=s) if i == index else path
        for i, path in enumerate(SPLINE.paths))
        for sign in (-1, 1)
    )  # fmt: skip
    require_passage(Corridor(inside, SPLINE.ends), task)
    with pytest.raises(ValueError, match=rf"outer path {index} leaves the gap of hoops\[1\] at s = {s:.4g}: it is"):
        require_passage(Corridor(outside, SPLINE.ends), task)


def test_paths_that_pass_a_hoop_one_after_the_other_are_refused():
    ahead = tuple(SMALL * SCENARIOS["slalom"].hoops[1].direction)
    paths = (moved(SPLINE.paths[0], ahead, at=hoop_coordinates(SCENARIOS["slalom"])[1]), SPLINE.paths[1])
    with pytest.raises(ValueError, match=r"leaves the gap of hoops\[1\] at s = .* from the hoop's line"):
        require_passage(Corridor(paths, SPLINE.ends), SCENARIOS["slalom"])


def test_a_hoop_that_is_not_crossed_is_refused():
    beyond = replace(SCENARIOS["horizontal-3"], name="beyond", hoops=(Hoop(4.0, 0.0, 0.5),))
    with pytest.raises(ValueError, match=r"outer path 0 does not cross hoops\[0\].*between s = 0 and s = 1"):
        require_passage(paper_corridor(SCENARIOS["horizontal-3"]), beyond)


@pytest.mark.parametrize(("name", "side"), [("floor", 0), ("ceiling", 1)])
def test_a_path_that_crosses_floor_or_ceiling_is_refused_with_its_place(name, side):
    walls = paper_corridor(SCENARIOS["horizontal-6"])
    for limit, allowed in ((1.0, True), (1.0 - SMALL, False)):
        task = replace(SCENARIOS["horizontal-6"], name="flat", **{name: limit * (-1, 1)[side]})
        if allowed:
            require_passage(walls, task)
        else:
            with pytest.raises(ValueError, match=rf"outer path \d crosses the {name} at s = .*: it is at z ="):
                require_passage(walls, task)


def test_a_corridor_between_other_places_is_refused():
    walls = paper_corridor(SCENARIOS["horizontal-6"])
    with pytest.raises(ValueError, match=r"at s = 1 the outer paths and their weights give \(6, 0\) m, but the goal"):
        require_passage(walls, replace(SCENARIOS["horizontal-6"], goal=(6.0, SMALL)))
    with pytest.raises(ValueError, match=r"at s = 0 the outer paths"):
        require_passage(Corridor(walls.paths, np.array([[0.6, 0.4], [0.5, 0.5]])), SCENARIOS["horizontal-6"])


def test_the_flat_method_flies_an_own_corridor_and_refuses_one_before_any_solve(monkeypatch):
    walls, name = paper_corridor(SCENARIOS["horizontal-3"]), "horizontal-3"
    own, fixed = (optimal.solve(name, "flat", corridor=each, max_gap=None) for each in (walls, "fixed"))
    assert own.time == fixed.time
    monkeypatch.setattr("optimal.flat.planning.optimise", lambda *_: pytest.fail("a solve began"))
    with pytest.raises(ValueError, match="but the goal of 'horizontal-6' is"):
        optimal.solve("horizontal-6", "flat", corridor=walls)


def test_an_outer_path_that_stands_still_is_refused_with_its_place():
    halting = PolynomialPath(((0.0, 0.0, 9.0, -14.0, 6.0), (1.0,)))
    moving = Resting(PolynomialPath(((0.0, 1.0), (-1.0,))))
    derivative = np.polynomial.Polynomial([0, 18, -42, 24])
    still = sorted(root for root in derivative.roots().real if 1e-9 < root < 1 - 1e-9)
    with pytest.raises(ValueError, match=rf"path 0 is degenerate: its derivative vanishes at s = {still[0]:.4g}"):
        optimal.plan([halting, moving])
