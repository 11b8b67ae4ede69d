"""Hoops at the goal, at the start, twice, close together or facing away: all parts agree on what can be flown."""

import math

import pytest

import optimal
from flatgym import Hoop, Quadrotor, Scenario, Tolerance, task
from flatgym.scenarios.scenario import GAP_LEAST
from flatgym.task.scene import GOAL
from optimal.direct.transcription import CLOSE, distinct_hoops

GOAL_AT = (5, 0)
AHEAD = Hoop(2.5, 0, 1)
HOOPS = {
    "at the goal": (Hoop(5, 0, 1),),
    "at the goal, facing back": (Hoop(5, 0, 1, math.pi),),
    "at the goal, facing up": (Hoop(5, 0, 1, math.pi / 2),),
    "at the goal, facing down": (Hoop(5, 0, 1, -math.pi / 2),),
    "beyond the goal, within its tolerance": (Hoop(5.05, 0, 1),),
    "at the start": (Hoop(0, 0, 1),),
    "at the start, facing back": (Hoop(0, 0, 1, math.pi),),
    "twice": (AHEAD, AHEAD),
    "there and back": (AHEAD, Hoop(2.5, 0, 1, math.pi)),
    "0.1 m back": (AHEAD, Hoop(2.4, 0, 1)),
    "facing back": (Hoop(3, 0, 1, math.pi),),
    "facing back, above": (Hoop(3, 4, 1, math.pi),),
    "facing back, behind the start": (Hoop(-1, 2, 1, math.pi),),
    "behind the start": (Hoop(-0.5, 0, 1),),
    "beyond the goal": (Hoop(6, 0, 1),),
    "far beyond the goal": (Hoop(7, 0, 1),),
    "narrowest": (Hoop(2.5, 0, GAP_LEAST),),
    "narrowest, aside": (Hoop(2.5, 0.5, GAP_LEAST, 0.5),),
}
SCENARIOS = {name: Scenario(name, (0, 0), GOAL_AT, hoops=hoops, time_limit=10.0) for name, hoops in HOOPS.items()} | {
    "a slow turner": Scenario("slow", (0, 0), (3, 0), quadrotor=Quadrotor(rate_max=0.1), time_limit=10.0),
    "0.1 mm away": Scenario("near", (0, 0), (1e-4, 0), tolerance=Tolerance(1e-5, 0.2, 0.1)),
}


@pytest.mark.parametrize("name", SCENARIOS)
def test_solver_certificate_fewest_steps_and_environment_agree(name, monkeypatch):
    monkeypatch.setattr("optimal.direct.solver_process.LIMIT", 1.5)  # from one start the solver does not return
    target = SCENARIOS[name]
    solution = optimal.solve(target, max_gap=None, windings=(0,))
    assert solution.solved
    assert optimal.certify(solution.trajectory, target).holds()
    steps = optimal.fewest_steps(target, windings=(0,), time_budget=0.0)
    flown = task.fly_actions(target, steps.actions)[-1]
    assert flown.outcome[0] == GOAL
    assert flown.hoops_passed[0] == len(target.hoops)
    assert steps.lower_bound <= steps.steps <= math.ceil(solution.time / target.dt) + 1


@pytest.mark.parametrize("apart", [1e-3, 1e-4, 1e-6, 1e-8])
@pytest.mark.parametrize("second", [Hoop(0, 0, 1), Hoop(0, 0.3, 1), Hoop(0, 0.1, 0.4)])
def test_hoops_close_together_take_the_time_of_the_gap_that_they_share(apart, second):
    behind = Hoop(AHEAD.x + apart, second.z, second.diameter)
    target = Scenario("close", (0, 0), GOAL_AT, hoops=(AHEAD, behind))
    low, high = max(-0.5, behind.rims[:, 1].min()), min(0.5, behind.rims[:, 1].max())
    shared = Scenario("shared", (0, 0), GOAL_AT, hoops=(Hoop(2.5, (low + high) / 2, high - low),))
    one, both = (optimal.solve(each, max_gap=None, windings=(0,)) for each in (shared, target))
    assert both.time == pytest.approx(one.time, abs=3e-4)
    assert both.certificate.holds()
    assert optimal.fewest_steps(target, windings=(0,), time_budget=0.0).steps <= 56


def test_hoops_are_replaced_by_one_only_where_a_flight_passes_them_at_once():
    def reduced(*hoops, radius=0.0, **kind):
        target = Scenario("reduced", (0, 0), GOAL_AT, hoops=hoops, quadrotor=Quadrotor(radius=radius))
        return distinct_hoops(target, **kind).hoops

    behind, aside = Hoop(2.5 + 1e-6, 0, 0.5), Hoop(2.5 + 1e-6, 0.4, 1)
    assert reduced(AHEAD, behind) == (Hoop(2.5, 0, 0.5),)
    assert reduced(AHEAD, behind, shared=False) == (behind,)
    assert reduced(AHEAD, aside)[0].diameter == pytest.approx(0.6)
    assert reduced(AHEAD, aside, shared=False) == (AHEAD,)
    assert len(reduced(AHEAD, aside, radius=0.31)) == 2
    for other in (
        AHEAD,
        Hoop(2.5 - 1e-6, 0, 1),
        Hoop(2.5 + 1e-6, 0, 1, math.pi),
        Hoop(2.5 + 1e-6, 0, 1, 0.01),
        Hoop(2.5 + 2 * CLOSE[1], 0, 1),
        Hoop(2.5 + 1e-6, 1.5, 1),
        Hoop(2.5 + 1e-6, 1 - GAP_LEAST / 2, 1),
    ):
        assert reduced(AHEAD, other) == (AHEAD, other)
