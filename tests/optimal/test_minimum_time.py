"""`solve`: three methods agree; only a certified flight has a time."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest

import optimal
from experiments.measurements.sections import REFERENCE_TIMES
from flatgym import SCENARIOS, Hoop, Quadrotor, Tolerance
from optimal import SolveFailed, Status, certify, minimum_time
from optimal.direct.clearance import tighten
from optimal.direct.multistart import search


@pytest.mark.parametrize("name", ["horizontal-6", "ground-6"])
def test_shooting_and_the_flat_method_agree(name):
    shooting, flat = optimal.solve(name), optimal.solve(name, method="flat")
    assert shooting.status is Status.OPTIMAL
    assert flat.solved
    assert shooting.certificate.holds()
    assert flat.certificate.holds()
    assert 0 < flat.time / shooting.time - 1 < 3e-3
    share = np.linspace(0, 1, 50)
    ways = [s.trajectory(share * s.time) for s in (shooting, flat)]
    assert np.abs(ways[0] - ways[1]).max() < 0.1


def test_the_fastest_winding_is_returned_and_its_starts_are_counted():
    solution = optimal.solve("climb")
    assert abs(solution.winding) == 1
    assert abs(solution.time - 1.30037) < 5e-4
    # The costates of winding 0 prune windings of 2; the rotation alone excludes windings of 3.
    assert solution.starts == 9
    assert solution.agreed == 6  # windings 1 and -1
    more = optimal.solve("diagonal", windings=(0,), starts=4, seed=1)
    assert (more.starts, more.agreed) == (4, 4)


def test_pruning_windings_does_not_change_the_optimum():
    alone = [optimal.solve("hoop", windings=(winding,)).time for winding in (0, 3, -3)]
    assert optimal.solve("hoop").time == pytest.approx(min(alone), rel=1e-7)
    assert min(alone[1:]) > 6 * math.pi / SCENARIOS["hoop"].quadrotor.rate_max > alone[0]


# Twelve hoops take as long as all other scenarios.
@pytest.mark.parametrize("name", [name for name, task in SCENARIOS.items() if len(task.hoops) < 12])
def test_named_scenarios_are_solved_and_certified(name):
    solution = optimal.solve(name)
    assert solution.status is (Status.OPTIMAL if solution.certificate.gap <= 1.000001e-3 else Status.LOCALLY_OPTIMAL)
    assert solution.reason == ""
    assert solution.certificate.holds()
    assert solution.certificate.max_control_violation == 0
    assert solution.agreed >= 2
    if name in REFERENCE_TIMES:
        assert abs(solution.time / REFERENCE_TIMES[name] - 1) < 2e-4


def test_limits_at_nodes_only_do_not_count_as_solved():
    lie = optimal.solve("horizontal-3", method="flat", checks="nodes")
    assert lie.status is Status.LIMITS_AT_NODES_ONLY
    assert not lie.solved
    assert not lie.certificate.holds()
    assert lie.certificate.max_control_violation > 1


def test_the_corridors_of_the_flat_method_are_kept_and_their_times_fall():
    seen = []
    solution = optimal.solve("climb", method="flat", max_gap=None, callback=seen.append)
    times = [step.solution.time for step in solution.corridors]
    assert times == sorted(times, reverse=True)
    assert solution.time == times[-1]
    assert set(solution.corridors) <= set(seen)
    assert abs(solution.winding) == 1
    assert solution.start == f"a flight of shooting on the coarse grid, winding {solution.winding}"
    fixed = optimal.solve("horizontal-3", method="flat", corridor="fixed", max_gap=None)
    assert fixed.start == "the slow motion along the central path"
    assert fixed.corridors == ()


def test_certified_locally_optimal_and_proven_are_three_statuses():
    proven, free = (optimal.solve("horizontal-3", max_gap=gap) for gap in (5e-4, None))
    assert (proven.status, free.status) == (Status.OPTIMAL, Status.LOCALLY_OPTIMAL)
    assert proven.headline == f"Certified flight in {proven.time:.4f} s, optimal; proven within 0.05 %."
    gap = 100 * free.certificate.gap
    assert re.fullmatch(r"Certified flight in \S+ s, locally optimal; proven within (\S+) %\.", free.headline)
    assert gap <= float(free.proven_within.split()[0]) < gap + 0.1
    flat = optimal.solve("horizontal-3", "flat", max_gap=None)
    assert "locally optimal between its outer paths" in flat.headline
    rough = replace(flat, status=Status.CERTIFIED)
    assert rough.headline.startswith(f"Certified flight in {flat.time:.4f} s, not optimal; proven within")
    assert not rough.solved
    assert [one.row()["status"] for one in (proven, free, rough)] == [
        Status.OPTIMAL.value, Status.LOCALLY_OPTIMAL.value, Status.CERTIFIED.value,
    ]  # fmt: skip
    unbounded = replace(free, certificate=replace(free.certificate, lower_bound=0.0, gap=math.inf))
    assert unbounded.headline.endswith("locally optimal; nothing proven.")


def test_a_wide_gap_is_never_called_optimal():
    loose = optimal.solve("horizontal-3", max_gap=0.1)
    assert 1e-3 < loose.certificate.gap <= 0.1 + 1e-9
    assert loose.status is Status.LOCALLY_OPTIMAL


@pytest.mark.parametrize(
    ("method", "options", "words"),
    [
        ("shooting", {"checks": "foo"}, "checks='foo' is an option of flat; method 'shooting' takes windings, starts"),
        ("shooting", {"intervals": 16}, "intervals=16 is an option of flat"),
        ("pontryagin", {"nodes": 50}, "nodes=50 is an option of shooting; method 'pontryagin' takes windings"),
        ("pontryagin", {"checks": "nodes"}, "checks='nodes' is an option of flat"),
        ("shooting", {"corridor": "fixed"}, "corridor='fixed' is an option of flat"),
        ("flat", {"corridor": "wide"}, 'corridor must be "flight", "fixed" or an optimal.Corridor, got \'wide\''),
        (
            "flat",
            {"corridor": "flight", "checks": "nodes"},
            "checks='nodes' and intervals=None are options of corridor",
        ),
        ("flat", {"corridor": "flight", "intervals": 16}, "and intervals=16 are options of corridor='fixed'"),
        ("flat", {"starts": 5}, "starts=5 is an option of shooting"),
        ("flat", {"seed": 1}, "seed=1 is an option of shooting"),
    ],
)
def test_an_option_that_the_method_does_not_take_is_refused(monkeypatch, method, options, words):
    for part in ("by_flat_method", "by_shooting", "by_pontryagin"):
        monkeypatch.setattr(minimum_time, part, lambda *_: pytest.fail("a solve began"))
    with pytest.raises(ValueError, match=re.escape(words)):
        optimal.solve("horizontal-3", method, **options)


@pytest.mark.parametrize(("option", "value"), [("max_gap", 0.0), ("max_gap", -1.0), ("time_budget", 0.0)])
def test_a_gap_or_budget_that_is_not_positive_is_refused_before_the_solve(monkeypatch, option, value):
    monkeypatch.setattr(minimum_time, "by_shooting", lambda *_: pytest.fail("a solve began"))
    with pytest.raises(ValueError, match=f"{option} must be positive, got {value}"):
        optimal.solve("horizontal-3", **{option: value})


def test_the_reason_of_a_missing_certificate_names_what_does_not_hold(monkeypatch):
    found = minimum_time.in_fixed_corridor(SCENARIOS["horizontal-3"], "fixed", "nodes", None)
    assert found.reason.startswith("Limits hold at grid nodes only")
    for claim in ("Solved: limits hold", ""):
        claimed = replace(found, status=Status.LOCALLY_OPTIMAL, reason=claim)
        monkeypatch.setattr(minimum_time, "in_fixed_corridor", lambda *_, claimed=claimed: claimed)
        solution = optimal.solve("horizontal-3", "flat", corridor="fixed", raise_on_failure=False)
        assert solution.status is Status.NOT_CERTIFIED
        assert re.match(r"The certificate does not hold: max_control_violation = \S+, at most 1e-09", solution.reason)
        assert solution.headline == Status.NOT_CERTIFIED.value


def straight_down(drop):
    """Return a scenario straight below the start, and the time of the upright flight, thrust_min to thrust_max [s]."""
    task = replace(SCENARIOS["drop"], goal=(0.0, -drop), tolerance=Tolerance(position=1e-6))
    q = task.quadrotor
    return task, math.sqrt(2 * drop * (1 / (q.gravity - q.thrust_min) + 1 / (q.thrust_max - q.gravity)))


@pytest.mark.parametrize("drop", [0.15, 0.02, 0.01, 0.005])
def test_shooting_flies_tiny_ways_straight_down(drop):
    task, straight = straight_down(drop)
    # A tilt while falling gains less than 0.2 %.
    assert straight * (1 - 2e-3) < optimal.solve(task, max_gap=None).time < straight * (1 + 1e-3)


def test_pontryagin_tilts_on_a_short_way_straight_down():
    task, straight = straight_down(0.15)
    assert straight * (1 - 2e-3) < optimal.solve(task, "pontryagin", max_gap=None).time < straight


@pytest.mark.parametrize("drop", [0.02, 0.01, 0.005])
def test_pontryagin_refuses_tiny_ways_straight_down(drop):
    # The vertical flight has no structure of bang and singular arcs: refused, since a flip is no optimum.
    with pytest.raises(optimal.SolveFailed, match=r"direct solution of winding 0 takes .* use method=\"shooting\""):
        optimal.solve(straight_down(drop)[0], "pontryagin", max_gap=None)


def test_a_row_has_plain_values_in_order():
    row = optimal.solve("horizontal-3", windings=(0,)).row()
    first = ["scenario", "method", "time_s", "winding", "status", "iterations", "solve_time_s", "lower_bound_s"]
    assert list(row)[:8] == first
    assert row["gap"] == pytest.approx(row["time_s"] / row["lower_bound_s"] - 1)
    assert set(map(type, row.values())) <= {str, float, int}


def unreachable():
    """A goal beyond the longest phase that the solver considers."""
    return replace(SCENARIOS["diagonal"], goal=(4000.0, 0.0), time_limit=1000.0)


def test_a_failed_solve_has_a_reason_and_no_time():
    with pytest.raises(SolveFailed, match=r"did not converge.*takes at least 28.28 s") as failure:
        optimal.solve(unreachable(), windings=(0,))
    assert failure.value.problem == unreachable()
    solution = optimal.solve(unreachable(), windings=(0,), raise_on_failure=False)
    assert solution.time == math.inf
    assert solution.trajectory is None
    assert solution.status is Status.NOT_CONVERGED
    assert "too far" in solution.reason


def test_unknown_names_and_empty_searches_are_rejected():
    with pytest.raises(
        ValueError, match="unknown method 'flt'; known: shooting, flat, pontryagin; did you mean 'flat'"
    ):
        optimal.solve("hoop", method="flt")
    with pytest.raises(ValueError, match="unknown scenario 'hop'"):
        optimal.solve("hop")
    with pytest.raises(ValueError, match="at least one winding and one start"):
        optimal.solve("hoop", windings=())
    with pytest.raises(ValueError, match="intervals must be at least 4, got 0"):
        optimal.solve("horizontal-3", method="flat", intervals=0)
    with pytest.raises(ValueError, match="checks must be"):
        optimal.solve("horizontal-3", method="flat", checks="often")
    with pytest.raises(ValueError, match="shooting"):
        optimal.solve("hoop", method="pontryagin")


def test_shooting_and_the_indirect_method_agree():
    times = [optimal.solve("climb", method=method).time for method in ("shooting", "pontryagin")]
    assert abs(times[0] / times[1] - 1) < 1e-4
    assert times[1] <= times[0]


def test_a_scenario_outside_the_paper_gets_an_automatic_corridor():
    task = replace(SCENARIOS["horizontal-3"], hoops=(Hoop(1.5, 0.3, 0.8, 0.2),))
    flat, shooting = optimal.solve(task, method="flat", corridor="fixed"), optimal.solve(task)
    assert flat.solved or flat.status is Status.CERTIFIED
    assert flat.certificate.holds()
    assert flat.time >= shooting.time * (1 - 1e-4)


@pytest.mark.parametrize(("name", "radius"), [("high-hoop", 0.1), ("hoop", 0.05), ("hoop", 0.1)])
def test_a_body_keeps_clear_of_the_rims_and_takes_longer(name, radius):
    body = replace(SCENARIOS[name], quadrotor=Quadrotor(radius=radius))
    narrow = replace(body.hoops[0], diameter=body.hoops[0].diameter - 2 * radius)
    point = optimal.solve(replace(SCENARIOS[name], hoops=(narrow,)))
    solution = optimal.solve(body)
    assert solution.solved
    assert solution.certificate.max_path_violation <= 1e-6
    assert point.time - 1e-6 < solution.time < 1.01 * point.time
    # The body would touch a rim on the flight of the point.
    assert optimal.certify(point.trajectory, body).max_path_violation > 1e-3


def test_limits_are_tightened_until_the_certificate_holds():
    # The flight through a gap that is 0.2 um wider violates the narrower gap by half of that.
    scenario = SCENARIOS["high-hoop"]
    plain = search(scenario.with_diameters([scenario.hoops[0].diameter + 2e-7])).shots[0]
    loose = certify(plain.trajectory, scenario)
    repaired, certificate = tighten(scenario, plain, loose)
    assert loose.hoop_clearance == pytest.approx(-1e-7, rel=0.01)
    assert not loose.holds()
    assert certificate.holds()
    assert repaired.trajectory.duration == pytest.approx(plain.trajectory.duration, rel=1e-6)
