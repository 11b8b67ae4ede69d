"""F agrees with its formula and is convex, and no multipliers exclude the time of an existing flight."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from flatgym import SCENARIOS, Hoop, Quadrotor, Scenario, Tolerance
from optimal.direct.shooting import solve_coarse
from optimal.flights.trajectory import Trajectory
from optimal.proof.branches import Branch, TiltInterval
from optimal.proof.bundle_method import separate
from optimal.proof.dual import Dual
from optimal.proof.initial_multipliers import kink_shares, multipliers
from optimal.proof.tilt_program import TiltProgram
from optimal.proof.time_grid import TimeGrid, time_grid

TURN = 100
"""Angles of a turn, few for fast tests."""
MISS = 1e-5
"""A flight on the coarse grid misses goal, hoops and heights by a few 1e-6 [m]."""
LOW = Scenario("low", (0, 0), (6, 0.3), ceiling=0.33)
GATES = Scenario("gates", (0.0, 1.0), (6.0, 2.0), (Hoop(2, 2, 0.5, 0.3), Hoop(4, 1.5, 0.8, -0.4)), 0.0, 3.0)
FLOWN = {
    "horizontal-6": (SCENARIOS["horizontal-6"], 0),
    "climb": (SCENARIOS["climb"], 1),
    "drop": (SCENARIOS["drop"], -1),
    "ground-6": (SCENARIOS["ground-6"], 0),
    "low": (LOW, 0),
    "hoop": (SCENARIOS["hoop"], 0),
    "high-hoop": (SCENARIOS["high-hoop"], 1),
    "gates": (GATES, 0),
    "body": (replace(GATES, quadrotor=Quadrotor(radius=0.1)), 0),
    "agile": (Scenario("agile", (0, 0), (-3, 4), quadrotor=Quadrotor(3, 14, 20)), 0),
}


@cache
def flight(name: str, tolerant: bool = False):
    """Return a flight on the coarse grid."""
    shot = solve_coarse(*FLOWN[name], tolerant=tolerant)
    assert shot.converged
    return shot


def replayed(flight: Trajectory) -> Trajectory:
    """Return the exact replay of the controls of a flight, whose own states are consistent to solver tolerance only."""
    states = [flight.states[0]]
    for control, length in zip(flight.controls, np.diff(flight.breakpoints), strict=True):
        states.append(flight.quadrotor.step(states[-1], control, length))
    return replace(flight, states=np.array(states))


class Flown:
    """A flight that hovers first, for the duration of the grid, and the dual of a branch to which it belongs."""

    def __init__(self, name: str, tolerant: bool = False, width: float = 0.0, held: float = math.inf) -> None:
        self.scenario, self.shot = FLOWN[name][0], flight(name, tolerant)
        self.way = replayed(self.shot.trajectory)
        self.grid = time_grid(self.way.duration, self.scenario.quadrotor.rate_max, turn=TURN)
        self.hover = self.grid.time - self.way.duration
        self.times = self.hover + self.way.breakpoints[np.cumsum(self.shot.steps)[:-1]]
        shares = self.times / self.grid.time
        tilt = float(self.way.state(max(0.0, 0.4 * self.grid.time - self.hover))[4])
        # The bound of the tilt at 0.4 T is applied at the nearest instant, hence one angle wider.
        room = held + self.grid.angle
        self.branch = Branch(
            self.shot.winding,
            tuple((share - width, share + width) for share in shares),
            () if math.isinf(held) else (TiltInterval(0.4, tilt - room, tilt + room),),
        )
        self.tolerance = self.scenario.tolerance if tolerant else None
        self.kinks = kink_shares(self.scenario, self.shot)
        self.dual = Dual(self.scenario, self.grid, self.branch, self.tolerance, self.kinks)
        self.costates = multipliers(self.scenario, self.shot, self.kinks)

    def around(self, generator, spread: float) -> np.ndarray:
        """Return random multipliers around the costates, with admissible signs."""
        y = self.costates / np.linalg.norm(self.costates) + spread * generator.normal(size=self.dual.size)
        y[self.dual.signed] = np.abs(y[self.dual.signed])
        return y


def value(dual: Dual, y: np.ndarray) -> float:
    return max(cut.value for cut in dual(y))


def anything(dual: Dual, generator) -> np.ndarray:
    """Return random multipliers with admissible signs."""
    y = generator.normal(size=dual.size)
    y[dual.signed] = np.abs(y[dual.signed])
    return y


def duals() -> dict[str, Dual]:
    """Return duals with every kind of constraint."""
    grid, gates = TimeGrid(70, 60, 10.0), ((0.2, 0.4), (0.55, 0.6))
    return {
        "free": Dual(SCENARIOS["diagonal"], grid, Branch(0)),
        "tolerant": Dual(SCENARIOS["climb"], grid, Branch(1), Tolerance(0.2, 0.4, 0.3)),
        "held": Dual(SCENARIOS["climb"], grid, Branch(0, (), (TiltInterval(0.5, 0.1, math.inf),))),
        "gates": Dual(GATES, grid, Branch(0, gates), Tolerance(), (0.2, 0.5, 0.7)),
        "body": Dual(replace(GATES, quadrotor=Quadrotor(radius=0.1)), grid, Branch(1, gates), None, (0.25,)),
    }


# The definition of F.


def weight_of(scenario, grid, times, kinks, y):
    """Return q at the instants, directly from its definition."""
    heights = [sign for sign, height in ((1.0, scenario.floor), (-1.0, scenario.ceiling)) if height is not None]
    hoops = y[4 : 4 + 2 * len(scenario.hoops)].reshape(-1, 2)
    bends = y[4 + hoops.size : -2].reshape(len(heights), len(kinks))
    weight = []
    for i in range(grid.steps + 1):
        share = i / grid.steps
        q = y[0:2] + share * y[2:4]
        for time, kink in zip(times, hoops, strict=True):
            q = q + max(0.0, share - time) * kink
        for sign, row in zip(heights, bends, strict=True):
            for kink, strength in zip(kinks, row, strict=True):
                q = q + np.array([0.0, sign * strength * max(0.0, share - round(kink * grid.steps) / grid.steps)])
        weight.append(q)
    return np.array(weight)


def support(scenario, grid, kinks, tolerance, weight, y):
    """Return R(q), directly from its formula."""
    heights = [(s, h) for s, h in ((1.0, scenario.floor), (-1.0, scenario.ceiling)) if h is not None]
    hoops = y[4 : 4 + 2 * len(scenario.hoops)].reshape(-1, 2) / grid.time
    bends = y[4 + hoops.size : -2].reshape(len(heights), len(kinks)) / grid.time
    slope = y[2:4] / grid.time + hoops.sum(axis=0)
    slope[1] += sum(sign * row.sum() for (sign, _), row in zip(heights, bends, strict=True))
    least = -slope @ (np.array(scenario.goal) - scenario.start)
    if tolerance is not None:
        least -= tolerance.position * np.hypot(*slope) + tolerance.speed * np.hypot(*weight[-1])
    for hoop, kink in zip(scenario.hoops, hoops, strict=True):
        least += kink @ (hoop.centre - scenario.start)
        least -= (hoop.diameter / 2 - scenario.quadrotor.radius) * abs(kink @ hoop.across)
    for (sign, height), row in zip(heights, bends, strict=True):
        least += sign * row.sum() * (height - scenario.start[1])
    return least


@pytest.mark.parametrize("tolerance", [None, Tolerance(0.3, 0.4, 0.5)])
def test_f_is_the_greatest_integral_minus_the_support_function(tolerance, generator):
    kinks, held = (0.2, 0.5, 0.77), (TiltInterval(0.4, -1.0, 2.0),)
    for scenario, times in ((GATES, (0.3, 0.5)), (replace(GATES, hoops=()), ()), (replace(LOW, floor=-0.1), ())):
        grid, vehicle = TimeGrid(90, 60, 10.0), scenario.quadrotor
        branch = Branch(1, tuple((time, time) for time in times), held)
        dual = Dual(scenario, grid, branch, tolerance, kinks)
        program = TiltProgram(vehicle, grid, 1, tolerance.angle if tolerance else 0.0, held)
        for _ in range(5):
            y = anything(dual, generator)
            (cut,) = dual(y)
            weight = weight_of(scenario, grid, times, kinks, y)
            most = program(weight, *(vehicle.thrust_max / vehicle.rate_max * y[-2:]))
            expected = most.value + most.interpolation - support(scenario, grid, kinks, tolerance, weight, y)
            assert cut.value == pytest.approx(expected, abs=1e-11)


@pytest.mark.parametrize("kind", duals())
def test_f_is_convex_and_homogeneous_and_its_slopes_are_subgradients(kind, generator):
    dual = duals()[kind]
    points = [anything(dual, generator) for _ in range(6)]
    cuts = [dual(y) for y in points]
    for y, found in zip(points, cuts, strict=True):
        for factor in (1e-6, 3.7, 1e6):
            for scaled, cut in zip(dual(factor * y), found, strict=True):
                assert scaled.value == pytest.approx(factor * cut.value, rel=1e-10, abs=1e-12 * factor)
                np.testing.assert_allclose(scaled.slope, cut.slope, atol=1e-10)
        for cut in found:
            assert cut.slope @ y == pytest.approx(cut.value, abs=1e-10)
            assert 0 < cut.rounding < 1e-10
        for z, others in zip(points, cuts, strict=True):
            for share in (0.2, 0.5, 0.9):
                between = value(dual, share * y + (1 - share) * z)
                ends = [max(cut.value for cut in each) for each in (found, others)]
                assert between <= share * ends[0] + (1 - share) * ends[1] + 1e-10
            for cut, other in zip(found, others, strict=True):
                assert cut.slope @ z <= other.value + 1e-10


def mirrored(scenario: Scenario) -> Scenario:
    hoops = tuple(replace(hoop, x=-hoop.x, angle=math.pi - hoop.angle) for hoop in scenario.hoops)
    return replace(scenario, start=(-scenario.start[0], scenario.start[1]),
                   goal=(-scenario.goal[0], scenario.goal[1]), hoops=hoops)  # fmt: skip


def test_the_mirrored_task_has_the_mirrored_multipliers(generator):
    grid, kinks = TimeGrid(80, 60, 10.0), (0.3, 0.6)
    branch = Branch(1, ((0.2, 0.3), (0.6, 0.6)), (TiltInterval(0.5, -0.5, 4.0),))
    other = Branch(-1, branch.passing, (TiltInterval(0.5, -4.0, 0.5),))
    dual = Dual(GATES, grid, branch, Tolerance(), kinks)
    twin = Dual(mirrored(GATES), grid, other, Tolerance(), kinks)
    turned = np.ones(dual.size)
    turned[0 : dual.vectors : 2] = -1
    for _ in range(5):
        y = anything(dual, generator)
        for cut, image in zip(dual(y), twin(turned * y), strict=True):
            assert image.value == pytest.approx(cut.value, abs=1e-11)


def test_f_is_invariant_under_translation(generator):
    grid, kinks, branch = TimeGrid(80, 60, 10.0), (0.3, 0.6), Branch(0, ((0.2, 0.3), (0.6, 0.6)))
    there = replace(GATES, start=(100.0, -49.0), goal=(106.0, -48.0), floor=-50.0, ceiling=-47.0,
                    hoops=tuple(replace(hoop, x=hoop.x + 100, z=hoop.z - 50) for hoop in GATES.hoops))  # fmt: skip
    here, away = (Dual(scenario, grid, branch, None, kinks) for scenario in (GATES, there))
    for _ in range(5):
        y = anything(here, generator)
        assert value(away, y) == pytest.approx(value(here, y), abs=1e-10)


def test_relaxed_tasks_have_larger_values(generator):
    grid, kinks, branch = TimeGrid(80, 60, 10.0), (0.3, 0.6), Branch(0, ((0.25, 0.25), (0.6, 0.6)))
    wide = tuple(replace(hoop, diameter=hoop.diameter + 0.1) for hoop in GATES.hoops)
    strict = Dual(GATES, grid, branch, Tolerance(), kinks)
    for easier in (
        Dual(replace(GATES, hoops=wide), grid, branch, Tolerance(), kinks),
        Dual(replace(GATES, floor=-0.1), grid, branch, Tolerance(), kinks),
        Dual(replace(GATES, ceiling=3.1), grid, branch, Tolerance(), kinks),
        *(Dual(GATES, grid, branch, Tolerance(*wider), kinks) for wider in ((0.2,), (0.1, 0.3), (0.1, 0.2, 0.2))),
    ):
        rises = np.array([value(easier, y) - value(strict, y) for y in (anything(strict, generator) for _ in range(6))])
        assert (rises > 0).all()
    tight = Dual(GATES, grid, branch, None, kinks)
    tiny = Dual(GATES, grid, branch, Tolerance(1e-9, 1e-9, 1e-9), kinks)
    y = anything(tight, generator)
    y[-2:] += 50.0  # otherwise the last tilt gains by ending one angle off
    assert value(tight, y) < value(strict, y)
    assert value(tiny, y) == pytest.approx(value(tight, y), abs=1e-6)


def exact(scenario, grid, times, kinks, tolerance, winding, y):
    """Return F in extended precision, by an independent implementation of the dynamic programme."""
    wide = np.longdouble
    pi, y = wide(4) * np.arctan(wide(1)), y.astype(wide)
    d = 2 * pi / grid.turn
    dt, vehicle = d / wide(grid.rate_max), scenario.quadrotor
    exact_grid = type("Grid", (), {"time": dt * grid.steps, "steps": grid.steps})
    share = np.arange(grid.steps + 1).astype(wide) / grid.steps
    q = y[0:2] + share[:, None] * y[2:4]
    for time, kink in zip(times, y[4 : 4 + 2 * len(times)].reshape(-1, 2), strict=True):
        q = q + np.maximum(share - wide(round(time * grid.steps)) / grid.steps, 0)[:, None] * kink
    bends = y[4 + 2 * len(times) : -2]
    for sign, row in zip((1, -1), np.split(bends, 2), strict=True):  # of a floor and a ceiling, or of neither
        for strength, kink in zip(row, kinks, strict=False):
            q[:, 1] += sign * strength * np.maximum(share - wide(round(kink * grid.steps)) / grid.steps, 0)
    first, last = wide(vehicle.thrust_max) / wide(vehicle.rate_max) * y[-2:]
    slack, target = wide(tolerance.angle if tolerance else 0.0), winding * grid.turn
    index, far = np.arange(-grid.steps - 1, grid.steps + 2), math.ceil(float(slack / d))
    sums = []
    for part in (q[:-1], q[1:]):
        values = -last * d * np.abs(index - target)
        for k in reversed(range(grid.steps)):
            lift = part[k, 0] * np.sin(d * index) + part[k, 1] * np.cos(d * index)
            values = values + dt * (
                np.maximum(wide(vehicle.thrust_max) * lift, wide(vehicle.thrust_min) * lift)
                - wide(vehicle.gravity) * part[k, 1]
            )
            out = (np.abs(index) > k + 1) | (np.abs(index - target) > far + grid.steps - k)
            values = np.where(out, -np.inf, values)
            if k > 0:
                padded = np.concatenate([[-np.inf], values, [-np.inf]])
                values = np.maximum(np.maximum(padded[:-2], padded[2:]), values)
        sums.append((values - first * d * np.abs(index)).max())
    lengths = np.sqrt((q**2).sum(axis=1))
    interpolation = d**2 / 8 * dt * wide(vehicle.thrust_max) * (lengths[:-1] + lengths[1:]).sum() / 2
    value = sum(sums) / 2 + first * d / 2 + last * (slack + d / 2) + interpolation
    return value - support(scenario, exact_grid, kinks, tolerance, q, y)


def test_the_rounding_bound_covers_the_floating_point_error(generator):
    below = []
    far = replace(SCENARIOS["diagonal"], goal=(1e6 / 3, 1e5 / 7))  # where the sums of R lose most
    for scenario, times, tolerance in (
        (SCENARIOS["diagonal"], (), None),
        (GATES, (0.25, 0.6), Tolerance()),
        (far, (), Tolerance()),
    ):
        grid, kinks = TimeGrid(60, 40, 10.0), (0.3, 0.6)
        dual = Dual(scenario, grid, Branch(1, tuple((time, time) for time in times)), tolerance, kinks)
        for _ in range(10):
            y = anything(dual, generator)
            (cut,) = dual(y)
            lost = exact(scenario, grid, times, kinks, tolerance, 1, y) - cut.value
            assert abs(lost) < cut.rounding
            below.append(lost > 0)
    assert any(below)


# Flights.


def identity(flown: Flown, y: np.ndarray) -> tuple[float, float]:
    """Return the integral of q . a over a flight by quadrature, and the same by two integrations by parts."""
    grid, way = flown.grid, flown.way
    shares = flown.times / grid.time
    hoops = y[4 : 4 + 2 * len(shares)].reshape(-1, 2)
    signs = [s for s, h in ((1.0, flown.scenario.floor), (-1.0, flown.scenario.ceiling)) if h is not None]
    at = np.rint(np.array(flown.kinks) * grid.steps) / grid.steps
    vectors = [*hoops, *([0.0, sign * k] for sign, row in zip(signs, np.split(y[4 + hoops.size : -2], len(signs))
               if signs else (), strict=True) for k in row)]  # fmt: skip
    bends = list(zip([*shares, *np.tile(at, len(signs))], map(np.array, vectors), strict=True))

    def weight(t):
        share = t[..., None] / grid.time
        return y[0:2] + share * y[2:4] + sum((np.maximum(share - s, 0.0) * k for s, k in bends), np.zeros(2))

    def place(t):
        return way(max(0.0, t - flown.hover)) - flown.scenario.start

    cuts = np.array([s * grid.time for s, _ in bends])
    ends = np.union1d(way.breakpoints + flown.hover, cuts[cuts > flown.hover])
    points, weights = np.polynomial.legendre.leggauss(8)
    half = np.diff(ends) / 2
    t = ends[:-1, None] + half[:, None] * (points + 1)
    integral = half @ ((weight(t) * way(np.clip(t - flown.hover, 0, way.duration), 2)).sum(axis=-1) @ weights)
    slope = (y[2:4] + sum((k for _, k in bends), np.zeros(2))) / grid.time
    end = way.state(way.duration)
    parts = weight(np.array(grid.time)) @ end[2:4] - slope @ place(grid.time)
    return float(integral), float(parts + sum(k / grid.time @ place(s * grid.time) for s, k in bends))


CASES = [(name, False) for name in FLOWN] + [("horizontal-6", True), ("climb", True), ("hoop", True), ("gates", True)]


@pytest.mark.parametrize(("name", "tolerant"), CASES)
def test_every_flight_satisfies_the_identity_and_both_bounds(name, tolerant, generator):
    flown = Flown(name, tolerant, width=0.02)
    scenario, grid = flown.scenario, flown.grid
    for spread in (0.0, 0.1, 1.0):
        y = flown.around(generator, spread)
        integral, parts = identity(flown, y)
        assert integral == pytest.approx(parts, abs=1e-9)
        weight = weight_of(scenario, grid, flown.times / grid.time, flown.kinks, y)
        least = support(scenario, grid, flown.kinks, flown.tolerance, weight, y)
        assert least <= integral + MISS
        assert integral <= least + value(flown.dual, y)


@pytest.mark.parametrize(("name", "tolerant"), CASES)
def test_no_multipliers_exclude_the_time_of_a_flight(name, tolerant, generator):
    for width, held in ((0.0, math.inf), (0.03, 0.1)):
        flown = Flown(name, tolerant, width, held)
        assert flown.dual.possible
        tries = [flown.around(generator, spread) for spread in (0.0, 0.01, 0.1, 1.0, 10.0) for _ in range(4)]
        assert min(value(flown.dual, y) for y in tries) > 0
        assert separate(flown.dual, flown.costates, max_evaluations=15).value > 0
        # The test is not vacuous: the costates come close to zero.
        if not width:
            assert value(flown.dual, flown.costates / np.linalg.norm(flown.costates)) < 0.05


def test_a_flight_that_belongs_to_no_branch_may_be_excluded():
    flown = Flown("high-hoop")
    wrong = replace(flown.branch, winding=-2)
    assert separate(Dual(flown.scenario, flown.grid, wrong, None, ()), flown.costates).value < 0
    early = replace(flown.branch, passing=((0.2, 0.21),))
    assert separate(Dual(flown.scenario, flown.grid, early, None, ()), flown.costates).value < 0


# Passing times.


def test_the_interval_value_bounds_every_passing_time(generator):
    grid = TimeGrid(80, 60, 10.0)
    scenario = Scenario("gate", (0, 0), (3, 1), (Hoop(1.5, 0.5, 0.6),))
    for first, last in ((20, 24), (30, 50), (0, 80)):
        whole = Dual(scenario, grid, Branch(0, ((first / 80, last / 80),)))
        for _ in range(4):
            y = anything(whole, generator)
            for at in range(first, last + 1, max(1, (last - first) // 6)):
                assert value(Dual(scenario, grid, Branch(0, ((at / 80, at / 80),))), y) <= value(whole, y) + 1e-12


def test_the_ends_of_a_passing_interval_alone_are_not_a_bound():
    # The weights make F nearly equal at both ends of the interval. The loss between them is all that thrust can do
    # against the kink. Downwards, gravity adds to thrust.
    grid, scenario, vehicle = TimeGrid(80, 60, 10.0), SCENARIOS["hoop"], Quadrotor()
    along, down = [-2.904, 0.0, 4.0, 0.0, 0.2, 0.0, 0.5, 0.5], [0.0, -2.52, 0.0, 4.0, 0.0, 0.2, 0.5, 0.5]
    up = [0.0, 2.52, 0.0, -4.0, 0.0, -0.2, 0.5, 0.5]
    intervals = ((0.4, 0.6), (0.4, 0.4), (0.5, 0.5), (0.6, 0.6))
    duals = [Dual(scenario, grid, Branch(0, (interval,))) for interval in intervals]
    for y in map(np.array, (along, down, up)):
        whole, first, middle, last = (value(dual, y) for dual in duals)
        term = (vehicle.thrust_max * math.hypot(*y[4:6]) + vehicle.gravity * y[5]) * grid.time * 0.2**2 / 8
        assert whole == pytest.approx(max(first, last) + term, abs=1e-12)
        assert middle <= whole
        if y[5] >= 0:
            assert whole - 0.8 * term < middle


def test_passing_intervals_are_relaxed_scenario_to_instants(generator):
    grid, scenario = TimeGrid(80, 60, 10.0), SCENARIOS["hoop"]
    y = generator.normal(size=8) ** 2
    narrow = Dual(scenario, grid, Branch(0, ((30.3 / 80, 40.6 / 80),)))
    assert value(narrow, y) == value(Dual(scenario, grid, Branch(0, ((30 / 80, 41 / 80),))), y)
    assert len(narrow(y)) == 2
    assert len(Dual(scenario, grid, Branch(0, ((30 / 80, 30 / 80),)))(y)) == 1
    assert len(Dual(GATES, grid, Branch(0, ((0.2, 0.3), (0.4, 0.5))), None, (0.5,))(np.ones(12))) == 4


def test_a_branch_with_hoops_in_the_wrong_order_is_empty():
    grid = TimeGrid(120, 60, 10.0)
    assert Dual(GATES, grid, Branch(0, ((0.2, 0.3), (0.3, 0.5)))).possible
    assert Dual(GATES, grid, Branch(0, ((0.2, 0.5), (0.1, 0.3)))).possible
    assert not Dual(GATES, grid, Branch(0, ((0.6, 0.7), (0.2, 0.5)))).possible
    assert not Dual(GATES, grid, Branch(5, ((0.2, 0.3), (0.3, 0.5)))).possible
