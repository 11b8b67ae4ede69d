"""Forged proofs are rejected: `Proof.check` trusts neither branches, nor grid, nor verdict."""

import math

from flatgym import SCENARIOS
from flatgym.task.transition import CONTACT_SLACK
from optimal.proof.lower_bound import Proof, Verdict
from optimal.proof.step_bound import least_steps, relaxed_scenario


def test_the_verdict_impossible_is_checked():
    assert not Proof(SCENARIOS["hoop"], None, math.inf, math.inf, Verdict.IMPOSSIBLE).check()


def test_the_relaxed_floor_includes_the_contact_slack():
    assert relaxed_scenario(SCENARIOS["ground-6"]).floor <= -CONTACT_SLACK


def test_a_time_just_short_of_a_step_does_not_exclude_that_step():
    scenario = SCENARIOS["horizontal-6"]
    for steps in range(1, 200):
        whole = steps * scenario.dt
        just, short = (Proof(scenario, None, t, 9.0, Verdict.CLOSED) for t in (whole, math.nextafter(whole, 0)))
        assert (least_steps(just), least_steps(short)) == (steps + 1, steps)
