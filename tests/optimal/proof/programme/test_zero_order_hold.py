"""The programme for held controls bounds every flight with held controls, and agrees with an enumeration."""

import itertools
import math

import numpy as np
import pytest

from flatgym import Hoop, Quadrotor, Scenario, Tolerance
from flatgym.quadrotor import nearest_turn
from optimal.proof.branches import Branch, PassingInterval, TiltInterval
from optimal.proof.bundle_method import separate
from optimal.proof.dual import Dual
from optimal.proof.programme.stations import Passing, Problem, hoops_apart
from optimal.proof.programme.time_grid import HoldGrid, TimeGrid, hold_grid, time_grid
from tests.optimal.proof.passing import known

GATES = Scenario(
    "gates",
    (0.0, 1.0),
    (6.0, 2.0),
    (Hoop(2, 2, 0.5, 0.3), Hoop(4, 1.5, 0.8, -0.4)),
    floor=0.0,
    ceiling=3.0,
    quadrotor=Quadrotor(rate_max=20.0),
)
WINDOWS = [(0.10, 0.14), (0.30, 0.36)]
COUNT = 24
"""Environment steps of the flights."""


def small(scenario: Scenario, windows=WINDOWS, winding=0, parts=2, reach=2) -> Dual:
    """Return a dual of few steps."""
    problem = Problem(scenario, Tolerance(0.2, 0.4, 0.3), COUNT * scenario.dt, (0.25, 0.6), COUNT)
    grid = hold_grid(COUNT, scenario.dt, scenario.quadrotor.rate_max, reach=reach, parts=parts)
    dual = Dual(problem, grid, Branch(winding), range(len(windows)), known(windows))
    assert dual.apart
    return dual


def anything(dual: Dual, generator) -> np.ndarray:
    """Return random multipliers with admissible signs."""
    y = generator.normal(size=dual.size)
    y[dual.signed] = np.abs(y[dual.signed])
    return y


def lifts(weight, theta, change, h):
    """Return the integral of q . (sin, cos) over a stage by Gauss's rule, for arrays of tilts and their changes."""
    nodes, shares = np.polynomial.legendre.leggauss(16)
    at = (nodes + 1) / 2
    q = weight[0] + (weight[1] - weight[0]) * at[:, None]
    angle = theta[..., None] + change[..., None] * at
    return h / 2 * (q[:, 0] * np.sin(angle) + q[:, 1] * np.cos(angle)) @ shares


def enumerated(dual: Dual, y: np.ndarray) -> float:
    """Return F from its definition: all passing instants and ends of gaps, with integrals by quadrature."""
    problem, grid, tables = dual.problem, dual.grid, dual._tilts
    vehicle, count, dt, d = problem.scenario.quadrotor, grid.steps, grid.dt, grid.angle
    chain, _ = dual._chain(y)
    stations, hoops = dual._stations, len(dual.hoops)
    best = -math.inf
    for passing in itertools.product(*(range(low, high + 1) for low, high in dual._windows.tolist())):
        if any(b <= a for a, b in itertools.pairwise(passing)):
            continue
        weight = np.stack([np.interp(np.arange(count + 1), passing, chain.weights[:, i]) for i in (0, 1)], axis=1)
        weight = weight + chain.common
        rest = -math.inf
        for ends in itertools.product((0, 1), repeat=hoops):
            places = [stations.places[i, end] for i, end in enumerate((0, *ends, 0))]
            total = 0.0
            for i, (a, b) in enumerate(itertools.pairwise(passing)):
                w = chain.weights[i + 1] - chain.weights[i]
                sigma = w / ((b - a) * dt)
                total += sigma @ (places[i + 1] - places[i]) + np.hypot(*w) * chain.curvature[i, b - a]
                if i == hoops:
                    total += problem.position * np.hypot(sigma[0], sigma[1] + chain.tail)
            rest = max(rest, total)
        cuts = sorted({*range(0, count + 1, grid.parts), *passing})
        values = np.full(len(tables.sin), -np.inf)
        values[tables.low[-1] : tables.high[-1] + 1] = -chain.final[tables.low[-1] : tables.high[-1] + 1]
        for a, b in reversed(list(itertools.pairwise(cuts))):
            h, q, reach = (b - a) * dt, weight[[a, b]], math.ceil((b - a) * grid.reach / grid.parts)
            error = d**2 / 8 * vehicle.thrust_max * h / 2 * np.hypot(*q.T).sum() - vehicle.gravity * h * q[:, 1].mean()
            tilt, change = np.arange(tables.low[a], tables.high[a] + 1)[:, None], np.arange(-reach, reach + 1)
            lift = lifts(q, d * (tilt - tables.zero), np.broadcast_to(d * change, (len(tilt), len(change))), h)
            strongest = np.maximum(vehicle.thrust_max * lift, vehicle.thrust_min * lift)
            row = np.full_like(values, -np.inf)
            row[tilt[:, 0]] = (strongest + values[tilt + change]).max(axis=1) + error
            values = row
        best = max(best, rest + values[tables.zero])
    return best + dual._shared(y, chain)


@pytest.mark.parametrize(("parts", "winding"), [(1, 0), (2, 1), (3, 0)])
def test_f_is_the_greatest_value_of_all_chains(parts, winding, generator):
    dual = small(GATES, [(0.12, 0.14), (0.32, 0.33)], winding, parts)
    y = anything(dual, generator)
    assert np.isfinite(dual.evaluate(y).value)
    assert dual.evaluate(y).value == pytest.approx(enumerated(dual, y), rel=1e-10, abs=1e-10)


def test_f_is_convex_and_homogeneous_and_its_slopes_are_subgradients(generator):
    dual = small(GATES)
    points = [anything(dual, generator) for _ in range(4)]
    cuts = [dual(y) for y in points]
    for y, cut in zip(points, cuts, strict=True):
        assert cut.slope @ y == pytest.approx(cut.value, abs=1e-9)
        way = generator.normal(size=dual.size)
        ahead, behind = (dual.evaluate(y + h * way).value for h in (1e-6, -1e-6))
        assert (ahead - behind) / 2e-6 == pytest.approx(cut.slope @ way, abs=1e-4 * np.linalg.norm(cut.slope))
        for z, other in zip(points, cuts, strict=True):
            assert cut.slope @ z <= other.value + 1e-9


def flown(generator, vehicle: Quadrotor, count: int, dt: float):
    """Return states and controls of a flight with random controls, held over steps."""
    rates = np.cumsum(generator.normal(scale=vehicle.rate_max, size=count))
    controls = np.column_stack([
        generator.choice([vehicle.thrust_min, vehicle.thrust_max], count),
        np.clip(rates, -vehicle.rate_max, vehicle.rate_max),
    ])  # fmt: skip
    state = np.zeros(5)
    states = [state]
    for control in controls:
        state = vehicle.step(state, control, dt)
        states.append(state)
    return np.array(states), controls


@pytest.mark.parametrize("vehicle", [Quadrotor(), Quadrotor(0.5, 30.0, 5.0), Quadrotor(3.0, 14.0, 20.0)])
def test_no_flight_with_held_controls_is_excluded(vehicle, generator):
    """A task that a random flight solves has F >= 0 for all multipliers, whatever hoops it passes."""
    dt, chained = 0.1, 0
    for _ in range(6):
        states, controls = flown(generator, vehicle, COUNT, dt)
        at = np.sort(generator.uniform(0.3, 0.9, 2)) * COUNT * dt
        hoops = []
        for time in at:
            k = int(time / dt)
            there = vehicle.step(states[k], controls[k], time - k * dt)
            hoops.append(Hoop(*there[:2], 0.3, math.atan2(there[3], there[2])))
        end = states[-1]
        tilt = abs(float(nearest_turn(end[4])))
        tolerance = Tolerance(0.1, float(np.hypot(*end[2:4])) + 0.01, tilt + 0.01)
        task = Scenario("flown", (0, 0), tuple(end[:2]), tuple(hoops), quadrotor=vehicle, tolerance=tolerance, dt=dt)
        problem = Problem(task, tolerance, COUNT * dt, (), COUNT)
        possible = Passing.possible(problem)
        assert all(low <= time <= high for (low, high), time in zip(possible.windows, at, strict=True))
        winding = round(end[4] / (2 * math.pi))
        for parts, reach in ((4, 5), (16, 9)):
            grid = hold_grid(COUNT, dt, vehicle.rate_max, reach=reach, parts=parts)
            chain = hoops_apart(problem, grid, (0, 1), possible)
            chained += len(chain)
            dual = Dual(problem, grid, Branch(winding), chain, known([(at[i] - 0.1, at[i] + 0.1) for i in chain]))
            for _ in range(10):
                found = dual.evaluate(anything(dual, generator))
                assert np.isfinite(found.value)
                assert found.value + found.rounding >= 0
    assert chained > 6


def test_held_controls_are_bounded_closer_than_controls_that_may_change(generator):
    scenario = Scenario("far", (0.0, 0.0), (3.0, 1.0), dt=0.1)
    problem = Problem(scenario, scenario.tolerance, COUNT * 0.1, (), COUNT)
    free = Dual(problem, time_grid(COUNT * 0.1, 10.0, turn=800), Branch(0))
    held = Dual(problem, hold_grid(COUNT, 0.1, 10.0, reach=120, parts=1), Branch(0))
    for _ in range(10):
        y = anything(held, generator)
        y[-2] = 0.0  # the start is exact where controls are held
        assert held.evaluate(y).value < free.evaluate(y).value


def test_finer_angles_and_more_parts_bound_closer(generator):
    for reaches in ((6, 24), (12, 48)):
        duals = [small(GATES, reach=reach) for reach in reaches]
        y = anything(duals[0], generator)
        assert duals[1].evaluate(y).value < duals[0].evaluate(y).value
    coarse, fine = (small(GATES, parts=parts, reach=24) for parts in (2, 8))
    y = anything(coarse, generator)
    assert fine.evaluate(y).value < coarse.evaluate(y).value


def test_pruned_windows_keep_the_best_chains(generator):
    wide = [(0.06, 0.3), (0.14, 0.44)]
    dual = small(GATES, wide, parts=1)
    y, count = anything(dual, generator), 12
    while separate(dual, [y], count).value < 0:
        count -= 1
    found = separate(dual, [y], count)
    left = dual.prune(found.multipliers)
    left = known(wide).cut((0, 1), left)
    assert left.windows != tuple(wide)
    pruned = Dual(dual.problem, dual.grid, Branch(0), (0, 1), left)
    pruned._curvature = dual._curvature  # a greater least time between the hoops would lower it
    assert pruned.evaluate(found.multipliers).value == dual.evaluate(found.multipliers).value


@pytest.mark.parametrize(("step", "rate"), [(0.02, 10.0), (0.05, 7.3), (0.1, 20.0), (0.02, 5.0)])
def test_a_step_turns_by_at_least_the_greatest_rate_and_hardly_more(step, rate):
    for reach in (8, 29, 58):
        grid = hold_grid(50, step, rate, reach=reach, parts=4)
        assert reach <= grid.reach <= 1.5 * reach + 1
        assert 1 <= grid.reach * grid.angle / (rate * step) < 1 + 2 / reach**2
        assert grid.time == 50 * step
        assert grid.steps * grid.dt == pytest.approx(grid.time, rel=1e-12)


def test_held_controls_need_a_winding():
    problem = Problem(GATES, None, COUNT * 0.1, (), COUNT)
    with pytest.raises(ValueError, match="one winding only"):
        Dual(problem, hold_grid(COUNT, 0.1, 10.0, reach=4, parts=1), Branch(None))


def test_bounds_of_tilts_and_passing_times_restrict_the_chains(generator):
    dual = small(GATES)
    y = anything(dual, generator)
    held = Dual(dual.problem, dual.grid, Branch(0, (TiltInterval(0.5, 1.0, 2.0),)), (0, 1), known(WINDOWS))
    assert held.evaluate(y).value <= dual.evaluate(y).value
    assert PassingInterval(0, 0.1, 0.2) == (0, 0.1, 0.2)
    assert isinstance(dual.grid, HoldGrid)
    assert not isinstance(time_grid(1.0, 10.0), HoldGrid)
    assert isinstance(time_grid(1.0, 10.0), TimeGrid)
