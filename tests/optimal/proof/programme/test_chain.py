"""F agrees with an enumeration of all chains, is convex, and no windows lose a flight."""

import itertools
import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from flatgym import SCENARIOS, Hoop, Quadrotor, Scenario, Tolerance
from optimal.direct.shooting import solve_coarse
from optimal.proof.branches import Branch, TiltInterval
from optimal.proof.bundle_method import separate
from optimal.proof.dual import Dual
from optimal.proof.initial_multipliers import kink_shares, multipliers
from optimal.proof.programme.stations import Passing, Problem, Stations, hoops_apart
from optimal.proof.programme.tilt_program import tilts
from optimal.proof.programme.time_grid import TimeGrid, time_grid
from tests.optimal.proof.one_weight import greatest_integral
from tests.optimal.proof.passing import known

GATES = Scenario("gates", (0.0, 1.0), (6.0, 2.0), (Hoop(2, 2, 0.5, 0.3), Hoop(4, 1.5, 0.8, -0.4)), 0.0, 3.0)
THREE = replace(GATES, hoops=(*GATES.hoops, Hoop(5, 2, 0.4, 0.1)))
BODY = replace(GATES, quadrotor=Quadrotor(radius=0.1))


def anything(dual: Dual, generator) -> np.ndarray:
    """Return random multipliers with admissible signs."""
    y = generator.normal(size=dual.size)
    y[dual.signed] = np.abs(y[dual.signed])
    return y


def enumerated(dual: Dual, y: np.ndarray) -> float:
    """Return F from its definition, by enumeration of passing instants and ends of gaps."""
    problem, grid, tables = dual.problem, dual.grid, dual._tilts
    vehicle, steps, dt = problem.scenario.quadrotor, grid.steps, grid.dt
    chain, _ = dual._chain(y)
    stations, hoops = dual._stations, len(dual.hoops)
    scale = vehicle.thrust_max / vehicle.rate_max
    acceleration = vehicle.thrust_max + vehicle.gravity
    shared = dual._shared(y, chain)
    best = [-math.inf, -math.inf]
    cell, stride = grid.cell, grid.stride
    for passing in itertools.product(*(range(low, high + 1, stride) for low, high in dual._windows.tolist())):
        if any(b <= a for a, b in itertools.pairwise(passing)):
            continue
        weight = np.stack([np.interp(np.arange(steps + 1), passing, chain.weights[:, i]) for i in (0, 1)], axis=1)
        weight = weight + chain.common
        for ends in itertools.product((0, 1), repeat=hoops):
            places = [stations.places[i, end] for i, end in enumerate((0, *ends, 0))]
            rest = 0.0
            for i, (a, b) in enumerate(itertools.pairwise(passing)):
                w = chain.weights[i + 1] - chain.weights[i]
                sigma = w / ((b - a) * dt)
                rest += sigma @ (places[i + 1] - places[i])
                least = max((b - a) * dt - 2 * cell, dual._least[i] - 2 * cell)
                number = (i > 0) + (i < hoops)
                terms = acceleration / least + stations.far[i] / least**3 if number else 0.0
                rest += number * np.hypot(*w) * terms * cell**2 / 4
                if i == hoops:
                    rest += problem.position * np.hypot(sigma[0], sigma[1] + chain.tail)
            for begin in (0, 1):
                best[begin] = max(best[begin], rest + one_sum(vehicle, grid, tables, weight, begin, scale * y[-2:]))
    return sum(best) / 2 + shared


def one_sum(vehicle, grid, tables, weight, begin, penalties):
    """Return M_begin of the tilt programme in plain Python."""
    count, d, dt = grid.steps, grid.angle, grid.dt
    width = len(tables.sin) - 2
    values: dict[int, float] = {}
    for k in reversed(range(count)):
        q = weight[k + begin]
        row = {}
        for i in range(tables.low[k], tables.high[k] + 1):
            lift = q[0] * tables.sin[i] + q[1] * tables.cos[i]
            reward = max(vehicle.thrust_max * lift, vehicle.thrust_min * lift) - vehicle.gravity * q[1]
            reward = dt * (reward + d**2 / 8 * vehicle.thrust_max * np.hypot(*q))
            near = [i - 1, i, i + 1]
            if tables.circular:
                near = [(n - 1) % width + 1 for n in near]
            after = max((values[n] for n in near if n in values), default=-math.inf)
            row[i] = reward + (after if k < count - 1 else -penalties[1] * d * tables.last[i])
        values = row
    return max(value - penalties[0] * d * tables.first[i] for i, value in values.items())


def toys() -> dict[str, Dual]:
    """Return small duals with every kind of constraint."""
    tolerance, found = Tolerance(0.2, 0.4, 0.3), {}
    for name, scenario, windows in (
        ("gates", GATES, [(0.25, 0.35), (0.45, 0.55)]),
        ("cells", GATES, [(0.2, 0.4), (0.5, 0.7)]),
        ("body", BODY, [(0.25, 0.4), (0.35, 0.55)]),
        ("three", THREE, [(0.17, 0.18), (0.33, 0.38), (0.53, 0.55)]),
    ):
        grid = TimeGrid(30, 24, 10.0, 2 if name == "cells" else 1)
        problem = Problem(scenario, tolerance if name != "body" else None, grid.time, (0.3, 0.6))
        for winding in (None, 0, 1):
            held = (TiltInterval(0.5, -1.0, 4.0),) if winding == 1 else ()
            found[f"{name} {winding}"] = Dual(problem, grid, Branch(winding, held), problem.hoops, known(windows))
    return found


TOYS = toys()


@pytest.mark.parametrize("name", TOYS)
def test_f_is_the_greatest_value_of_all_chains(name, generator):
    dual = TOYS[name]
    y = anything(dual, generator)
    assert np.isfinite(dual.evaluate(y).value)
    assert dual.evaluate(y).value == pytest.approx(enumerated(dual, y), rel=1e-11, abs=1e-11)


@pytest.mark.parametrize("winding", [None, 0, 1])
def test_without_hoops_f_is_the_bound_of_the_tilt_programme(winding, generator):
    scenario, grid = SCENARIOS["diagonal"], TimeGrid(90, 60, 10.0)
    dual = Dual(Problem(scenario, None, grid.time), grid, Branch(winding))
    for _ in range(5):
        y = anything(dual, generator)
        weight = y[0:2] + np.linspace(0, 1, grid.steps + 1)[:, None] * (y[2:4] - y[0:2])
        most = greatest_integral(scenario.quadrotor, grid, tilts(grid, winding), weight, *(2 * y[-2:]))
        expected = most + (y[2:4] - y[0:2]) @ (np.array(scenario.goal) - scenario.start) / (grid.steps * grid.dt)
        assert dual(y).value == pytest.approx(expected, abs=1e-10)


@pytest.mark.parametrize("name", TOYS)
def test_f_is_convex_and_homogeneous_and_its_slopes_are_subgradients(name, generator):
    dual = TOYS[name]
    points = [anything(dual, generator) for _ in range(5)]
    cuts = [dual(y) for y in points]
    for y, cut in zip(points, cuts, strict=True):
        assert cut.slope @ y == pytest.approx(cut.value, abs=1e-9)
        assert 0 < cut.rounding < 1e-9 * max(1.0, abs(cut.value))
        assert dual(3.7 * y).value == pytest.approx(3.7 * cut.value, rel=1e-10)
        way = generator.normal(size=dual.size)
        ahead, behind = (dual.evaluate(y + h * way).value for h in (1e-6, -1e-6))
        assert (ahead - behind) / 2e-6 == pytest.approx(cut.slope @ way, abs=1e-4 * np.linalg.norm(cut.slope))
        for z, other in zip(points, cuts, strict=True):
            assert cut.slope @ z <= other.value + 1e-9
            assert dual.evaluate((y + z) / 2).value <= (cut.value + other.value) / 2 + 1e-9


def test_the_mirrored_task_has_the_mirrored_multipliers(generator):
    hoops = tuple(replace(hoop, x=-hoop.x, angle=math.pi - hoop.angle) for hoop in GATES.hoops)
    twin = replace(GATES, goal=(-6.0, 2.0), hoops=hoops)
    grid, windows = TimeGrid(60, 48, 10.0), [(0.5, 0.6), (0.8, 0.9)]
    here, there = (
        Dual(Problem(scenario, Tolerance(), grid.time, (0.4,)), grid, Branch(winding), (0, 1), known(windows))
        for scenario, winding in ((GATES, 1), (twin, -1))
    )
    turned = np.ones(here.size)
    turned[0 : here.vectors : 2] = -1
    for _ in range(3):
        y = anything(here, generator)
        assert there.evaluate(turned * y).value == pytest.approx(here.evaluate(y).value, abs=1e-10)


def exact_grid(dual: Dual) -> tuple[np.longdouble, np.longdouble]:
    """Return angle and time step of a grid in extended precision."""
    angle = 8 * np.arctan(np.longdouble(1)) / dual.grid.turn
    return angle, angle / np.longdouble(dual.grid.rate_max)


def exact_sums(dual: Dual, q: np.ndarray, penalties: np.ndarray, winding: int | None) -> list[np.longdouble]:
    """Return both sums of the tilt programme in extended precision, for the weight q at the instants."""
    wide, vehicle, tables, steps = np.longdouble, dual.problem.scenario.quadrotor, dual._tilts, dual.grid.steps
    high, low, g = wide(vehicle.thrust_max), wide(vehicle.thrust_min), wide(vehicle.gravity)
    d, dt = exact_grid(dual)
    position = np.arange(1, len(tables.sin) - 1)
    index = position - 1 if winding is None else position - 1 - np.argmin(tables.first[1:-1])
    first, last = high / wide(vehicle.rate_max) * penalties * d
    rewards, sums = dt * d**2 / 8 * high * np.sqrt((q**2).sum(axis=1)), []
    for begin in (0, 1):
        values = -last * tables.last[1:-1].astype(wide)
        for n in reversed(range(steps)):
            if n < steps - 1:
                near = [np.roll(values, 1), np.roll(values, -1)]
                if winding is not None:
                    near[0][0] = near[1][-1] = -np.inf
                values = np.maximum(np.maximum(*near), values)
            lift = q[n + begin, 0] * np.sin(d * index) + q[n + begin, 1] * np.cos(d * index)
            values = values + dt * (np.maximum(high * lift, low * lift) - g * q[n + begin, 1]) + rewards[n + begin]
            values = np.where((position < tables.low[n]) | (position > tables.high[n]), -np.inf, values)
        sums.append((values - first * tables.first[1:-1].astype(wide)).max())
    return sums


def exact(dual: Dual, y: np.ndarray, winding: int | None) -> np.longdouble:
    """Return F in extended precision, for windows of one instant each, by an independent implementation."""
    wide, problem, steps = np.longdouble, dual.problem, dual.grid.steps
    scenario, vehicle, y = problem.scenario, problem.scenario.quadrotor, y.astype(np.longdouble)
    d, dt = exact_grid(dual)
    high, g = wide(vehicle.thrust_max), wide(vehicle.gravity)
    passing = dual._windows[:, 0]
    weights, kappa = y[: dual.vectors].reshape(-1, 2), dual._signs * y[dual.vectors : -2]
    k = np.arange(steps + 1)
    segment = np.clip(np.searchsorted(passing, k, side="right") - 1, 0, len(passing) - 2)
    share = (k - passing[segment]).astype(wide) / np.diff(passing)[segment]
    q = weights[segment] + share[:, None] * (weights[segment + 1] - weights[segment])
    at = np.tile(np.rint(np.array(problem.kinks) * steps), len(kappa) // max(len(problem.kinks), 1))
    q[:, 1] += (np.maximum(k[:, None] - at, 0).astype(wide) / steps) @ kappa
    sums = exact_sums(dual, q, y[-2:], winding)
    places = [np.zeros((2, 2), wide)]
    for i in dual.hoops:
        hoop = scenario.hoops[i]
        centre = np.array([hoop.x, hoop.z], wide) - np.array(scenario.start, wide)
        angle, half = wide(hoop.angle), wide(hoop.diameter) / 2 - wide(vehicle.radius)
        across = np.array([-np.sin(angle), np.cos(angle)])
        places.append(np.array([centre - half * across, centre + half * across]))
    places.append(np.tile(np.array(scenario.goal, wide) - np.array(scenario.start, wide), (2, 1)))
    tail, rest = kappa.sum() / (dt * steps), wide(0)
    best = [wide(0), wide(-np.inf)]
    for i in range(len(passing) - 1):
        time = dt * (passing[i + 1] - passing[i])
        sigma = (weights[i + 1] - weights[i]) / time
        number = (i > 0) + (i < len(passing) - 2)
        least = max((passing[i + 1] - passing[i] - 2) * dt, wide(dual._least[i]) - 2 * dt)
        terms = (high + g) / least + wide(dual._stations.far[i]) / least**3 if number else wide(0)
        rest += number * np.sqrt(((weights[i + 1] - weights[i]) ** 2).sum()) * terms * dt**2 / 4
        ways = [[sigma @ (after - before) for after in places[i + 1]] for before in places[i]]
        best = [max(best[0] + ways[0][end], best[1] + ways[1][end]) for end in (0, 1)]
    rest += wide(problem.position) * np.sqrt(sigma[0] ** 2 + (sigma[1] + tail) ** 2)
    rest += wide(problem.speed) * np.sqrt((q[-1] ** 2).sum())
    rest += (kappa @ (places[-1][0, 1] - dual._heights.astype(wide))) / (dt * steps)
    first, last = high / wide(vehicle.rate_max) * y[-2:]
    return sum(sums) / 2 + rest + max(best) + first * d / 2 + last * (wide(problem.slack) + d / 2)


def test_the_rounding_bound_covers_the_floating_point_error(generator):
    below = []
    far = replace(SCENARIOS["diagonal"], goal=(1e6 / 3, 1e5 / 7))  # where the sums lose most
    grid = TimeGrid(90, 40, 10.0)
    for scenario, windows, tolerance in (
        (SCENARIOS["diagonal"], (), None),
        (GATES, (0.4, 0.95), Tolerance()),
        (far, (), Tolerance()),
    ):
        for winding in (None, 1):
            problem = Problem(scenario, tolerance, grid.time, (0.3, 0.6))
            instants = [(round(t / grid.dt) * grid.dt,) * 2 for t in windows]
            dual = Dual(problem, grid, Branch(winding), range(len(windows)), known(instants))
            dual._windows[1:-1] = dual._windows[1:-1, :1]  # one instant, whatever the outward rounding added
            for _ in range(5):
                y = anything(dual, generator)
                found = dual.evaluate(y)
                lost = exact(dual, y, winding) - found.value
                assert abs(lost) < found.rounding
                below.append(lost > 0)
    assert any(below)


def test_f_is_invariant_under_translation(generator):
    away = replace(GATES, start=(100.0, -49.0), goal=(106.0, -48.0), floor=-50.0, ceiling=-47.0,
                   hoops=tuple(replace(hoop, x=hoop.x + 100, z=hoop.z - 50) for hoop in GATES.hoops))  # fmt: skip
    grid, windows = TimeGrid(60, 48, 10.0), [(0.5, 0.6), (0.8, 0.9)]
    here, there = (
        Dual(Problem(scenario, Tolerance(), grid.time, (0.4,)), grid, Branch(0), (0, 1), known(windows))
        for scenario in (GATES, away)
    )
    for _ in range(3):
        y = anything(here, generator)
        assert there.evaluate(y).value == pytest.approx(here.evaluate(y).value, abs=1e-9)


def test_hoops_that_are_too_close_are_dropped():
    grid = TimeGrid(60, 40, 10.0)
    close = replace(GATES, hoops=(GATES.hoops[0], Hoop(2.05, 2, 0.5, 0.3), GATES.hoops[1]))
    problem = Problem(close, None, grid.time)
    assert hoops_apart(problem, grid, problem.hoops, Passing.possible(problem)) == (0, 2)
    assert not Dual(problem, grid, Branch(), (0, 1, 2), Passing.possible(problem)).apart
    at_goal = Problem(replace(GATES, hoops=(Hoop(5.9, 2.0, 0.5),)), Tolerance(), grid.time)
    assert hoops_apart(at_goal, grid, (0,), Passing.possible(at_goal)) == ()
    assert Stations(at_goal, (0,)).near[-1] == 0.0


@cache
def random_track(seed: int):
    """Return a random track of hoops, and a flight through it on the coarse grid."""
    generator = np.random.default_rng(seed)
    count, place, hoops = 2 + seed % 3, np.zeros(2), []
    for _ in range(count):
        place = place + np.array([1.5 + generator.uniform(0, 1), generator.uniform(-1, 1)])
        hoops.append(Hoop(*place.tolist(), 0.6, float(generator.uniform(-0.5, 0.5))))
    scenario = Scenario("track", (0, 0), (float(place[0]) + 2.0, float(place[1])), tuple(hoops))
    return scenario, solve_coarse(scenario, 0)


@pytest.mark.parametrize("cell", [0.0, 0.02])
@pytest.mark.parametrize("seed", range(6))
def test_no_multipliers_exclude_a_flown_time_and_no_window_loses_the_flight(seed, cell, generator):
    scenario, shot = random_track(seed)
    assert shot.converged
    kinks, flown = kink_shares(scenario, shot), 1.01 * shot.trajectory.duration
    grid = time_grid(flown, 10.0, turn=60, cell=cell)
    problem = Problem(scenario, None, grid.time, kinks)
    possible = Passing.possible(problem)
    hoops = hoops_apart(problem, grid, problem.hoops, possible)
    hover = problem.duration - shot.trajectory.duration
    passing = hover + shot.trajectory.breakpoints[np.cumsum(shot.steps)[:-1]]
    assert all(low <= t <= high for t, (low, high) in zip(passing, possible.windows, strict=True))
    costates = multipliers(scenario, shot, kinks)
    costates /= np.linalg.norm(costates)
    for branch in (Branch(), Branch(0)):
        near = [(t - 0.05, t + 0.05) for t in passing]
        dual = Dual(problem, grid, branch, hoops, known([near[i] for i in hoops]))
        assert len(hoops) == len(passing)
        assert separate(dual, [costates], 5).value > 0
        for spread in (0.0, 0.03, 0.3):
            y = costates + spread * generator.normal(size=dual.size)
            y[dual.signed] = np.abs(y[dual.signed])
            assert dual.evaluate(y).value > 0
            left = dual.prune(y)
            assert left is not None
            both = zip(passing, left.windows, strict=True)
            assert all(low - 1e-9 <= t <= high + 1e-9 for t, (low, high) in both)
            both = zip(np.diff(passing), left.durations, strict=True)
            assert all(low - 1e-9 <= t <= high + 1e-9 for t, (low, high) in both)
