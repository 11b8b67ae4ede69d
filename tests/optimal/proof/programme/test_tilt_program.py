"""The dynamic programme bounds every tilt, the bound is tight, and each of its correction terms is needed."""

import math
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np
import pytest
from scipy.optimize import brentq, minimize

from flatgym import Quadrotor
from optimal.proof.branches import TiltInterval
from optimal.proof.programme.rounding import UNIT_ROUNDOFF
from optimal.proof.programme.tilt_program import tilts
from optimal.proof.programme.time_grid import LEAST_STEPS, TimeGrid, angles_for, time_grid
from tests.optimal.proof.one_weight import greatest_integral

VEHICLES = (Quadrotor(), Quadrotor(thrust_min=0.5, thrust_max=30, rate_max=5), Quadrotor(3, 14, 20))
POINTS, WEIGHTS = np.polynomial.legendre.leggauss(12)


class TiltBound(NamedTuple):
    """The bound of the theorem without the interpolation errors, and their sum for the weight."""

    value: float
    interpolation: float


class TiltProgram:
    """The bound of the theorem for one vehicle, grid and class of flights."""

    def __init__(self, quadrotor, grid, winding, slack=0.0, held=()) -> None:
        self.quadrotor, self.grid, self.slack = quadrotor, grid, slack
        self.tilts = tilts(grid, winding, slack, held)
        self.possible = self.tilts.possible

    def __call__(self, weight, first, last) -> TiltBound:
        grid, length = self.grid, np.hypot(*weight.T)
        share = grid.angle**2 / 8 * grid.dt * self.quadrotor.thrust_max
        interpolation = share * float((length[:-1] + length[1:]).sum()) / 2
        whole = greatest_integral(self.quadrotor, grid, self.tilts, weight, first, last, self.slack)
        return TiltBound(whole - interpolation, interpolation)


def bound(most: TiltBound) -> float:
    return most.value + most.interpolation


@dataclass(frozen=True)
class Tilt:
    """A tilt that is linear between instants."""

    time: np.ndarray
    angle: np.ndarray

    def __call__(self, t):
        return np.interp(t, self.time, self.angle)


def integral(vehicle: Quadrotor, grid: TimeGrid, weight: np.ndarray, tilt: Tilt) -> float:
    """Return the integral of q . a with the best thrust, by Gauss quadrature between all kinks."""
    instants = grid.dt * np.arange(grid.steps + 1)

    def lift(t):
        q = np.stack([np.interp(t, instants, weight[:, i]) for i in (0, 1)])
        return q[0] * np.sin(tilt(t)) + q[1] * np.cos(tilt(t))

    pieces = np.union1d(instants, tilt.time[tilt.time < instants[-1]])
    inside = np.linspace(pieces[:-1], pieces[1:], 9).T
    values = lift(inside)
    rows, columns = np.nonzero(values[:, :-1] * values[:, 1:] < 0)
    switches = [brentq(lift, inside[i, j], inside[i, j + 1], xtol=1e-14) for i, j in zip(rows, columns, strict=True)]
    ends = np.union1d(pieces, switches)
    half = np.diff(ends) / 2
    t = ends[:-1, None] + half[:, None] * (POINTS + 1)
    along = lift(t)
    reward = np.maximum(vehicle.thrust_max * along, vehicle.thrust_min * along)
    return float(half @ (reward @ WEIGHTS)) - vehicle.gravity * float(np.trapezoid(weight[:, 1], instants))


def random_weight(generator, grid: TimeGrid, kinks: int = 2) -> np.ndarray:
    """Return a random q with kinks at instants, shape (N+1, 2)."""
    knots = np.unique([0, grid.steps, *generator.integers(1, grid.steps, kinks)])
    values = generator.normal(size=(len(knots), 2)) * 10 ** generator.uniform(-1, 1)
    return np.stack([np.interp(np.arange(grid.steps + 1), knots, values[:, i]) for i in (0, 1)], axis=1)


def random_tilt(generator, grid: TimeGrid, end: float) -> Tilt:
    """Return a tilt from 0 to `end` with random piecewise constant rates, one of them at its limit."""
    time = np.append(np.sort(generator.uniform(0, grid.time, 11)), grid.time)
    time = np.append(0.0, time)
    rates, widths, mean = generator.choice([-1.0, -0.3, 0.0, 0.5, 1.0], 12), np.diff(time), end / grid.time
    rates = rates - rates @ widths / grid.time
    room = np.where(rates > 0, grid.rate_max - mean, grid.rate_max + mean) / np.maximum(np.abs(rates), 1e-9)
    rates = mean + rates * room.min()
    assert np.abs(rates).max() <= grid.rate_max * (1 + 1e-12)
    return Tilt(time, np.append(0.0, np.cumsum(rates * widths)))


def greedy_tilt(grid: TimeGrid, weight: np.ndarray, end: float, share: float = 0.5) -> Tilt:
    """Return the tilt that follows q within its rate and end, and makes its whole turns from a share of T on."""
    time = grid.dt * np.linspace(0, grid.steps, 4 * grid.steps + 1)
    q = np.stack([np.interp(time, time[::4], weight[:, i]) for i in (0, 1)])
    wanted = np.unwrap(np.arctan2(*q))
    wanted[time > share * time[-1]] += 2 * np.pi * np.round((end - wanted[-1]) / (2 * np.pi))
    angle = [0.0]
    for aim, step, left in zip(wanted[1:], np.diff(time), time[-1] - time[1:], strict=True):
        low = max(angle[-1] - grid.rate_max * step, end - grid.rate_max * left)
        high = min(angle[-1] + grid.rate_max * step, end + grid.rate_max * left)
        angle.append(min(max(aim, low), high))
    return Tilt(time, np.array(angle))


def slow_sum(
    vehicle: Any, weight: Any, sin: Any, cos: Any, dt: Any, first: Any, last: Any, low: Any, high: Any, target: int
) -> tuple[Any, list[int]]:
    """Return M_j and its sequence from the definition, in the arithmetic of its arguments; sin and cos by index."""
    strongest, weakest, gravity = vehicle
    rows: list[dict[int, Any]] = []
    for k in reversed(range(len(weight))):
        q_x, q_z = weight[k]
        row = {}
        for i in range(low[k], high[k] + 1):
            lift = q_x * sin[i] + q_z * cos[i]
            reward = dt * (max(strongest * lift, weakest * lift) - gravity * q_z)
            if not rows:
                row[i] = reward - last * abs(i - target)
            elif after := [rows[-1][j] for j in (i - 1, i, i + 1) if j in rows[-1]]:
                row[i] = reward + max(after)
        rows.append(row)
    rows.reverse()
    best, at = max((value - first * abs(i), i) for i, value in rows[0].items())
    sequence = [at]
    for row in rows[1:]:
        sequence.append(max((j for j in (sequence[-1] - 1, sequence[-1], sequence[-1] + 1) if j in row), key=row.get))
    return best, sequence


def reach(grid: TimeGrid, winding: int, slack: float = 0.0) -> tuple[list[int], list[int]]:
    """Return the least and greatest multiples of d reachable by the rate limit alone."""
    far, target = math.ceil(slack / grid.angle), winding * grid.turn
    low = [max(-(k + 1), target - far - (grid.steps - k)) for k in range(grid.steps)]
    high = [min(k + 1, target + far + (grid.steps - k)) for k in range(grid.steps)]
    return low, high


def slow(vehicle, grid, weight, first, last, winding=0, slack=0.0):
    """Return M_0 and M_1 and their sequences [rad] in plain Python."""
    low, high = reach(grid, winding, slack)
    angles = {i: grid.angle * i for i in range(min(low), max(high) + 1)}
    sin, cos = ({i: function(a) for i, a in angles.items()} for function in (math.sin, math.cos))
    limits, d, target = (vehicle.thrust_max, vehicle.thrust_min, vehicle.gravity), grid.angle, winding * grid.turn
    sums = [
        slow_sum(limits, part.tolist(), sin, cos, grid.dt, first * d, last * d, low, high, target)
        for part in (weight[:-1], weight[1:])
    ]
    return [best for best, _ in sums], [d * np.array(sequence) for _, sequence in sums]


def tuned(program: TiltProgram, weight: np.ndarray) -> tuple[float, float]:
    """Return the penalties that minimise the bound of a programme."""
    options = {"xatol": 1e-4, "fatol": 1e-8}
    found = minimize(lambda x: bound(program(weight, *np.exp(x))), [0.0, 0.0], method="Nelder-Mead", options=options)
    return tuple(np.exp(found.x).tolist())


def smooth(grid: TimeGrid) -> np.ndarray:
    """Return a linear weight for which a flight to the right is fastest, larger at its end."""
    share = np.linspace(0.0, 1.0, grid.steps + 1)[:, None]
    return np.array([1.0, 0.6]) + share * np.array([-2.4, 0.5])


def best(vehicle: Quadrotor, grid: TimeGrid, weight: np.ndarray, winding: int, slack: float = 0.0) -> float:
    """Return the greatest integral over the tilts that follow q."""
    shares = np.linspace(0.12, 0.16, 17) if winding else (0.5,)
    ends = 2 * np.pi * winding + slack * np.array([-1.0, 0.0, 1.0])
    return max(integral(vehicle, grid, weight, greedy_tilt(grid, weight, e, share)) for e in ends for share in shares)


# Soundness.


@pytest.mark.parametrize("vehicle", VEHICLES, ids=["default", "slow", "agile"])
@pytest.mark.parametrize("winding", [0, 1, -2])
def test_no_admissible_tilt_exceeds_the_bound(vehicle, winding, generator):
    for slack in (0.0, 0.1, 0.7):
        grid = time_grid(generator.uniform(1.1, 1.5) * 4 * np.pi / vehicle.rate_max, vehicle.rate_max, turn=40)
        program, weight = TiltProgram(vehicle, grid, winding, slack), random_weight(generator, grid)
        ends = 2 * np.pi * winding + slack * np.array([-1.0, 0.0, generator.uniform(-1, 1), 1.0])
        tilts = [random_tilt(generator, grid, end) for end in ends for _ in range(3)]
        tilts += [greedy_tilt(grid, weight, end, share) for end in ends for share in (0.1, 0.5, 0.9)]
        flown = max(integral(vehicle, grid, weight, tilt) for tilt in tilts)
        for penalties in ((0.0, 0.0), (0.2, 3.0), (3.0, 0.2), tuned(program, weight)):
            assert flown <= bound(program(weight, *penalties))


@pytest.mark.parametrize("vehicle", VEHICLES, ids=["default", "slow", "agile"])
def test_no_held_tilt_exceeds_the_bound_of_its_branch(vehicle, generator):
    grid = TimeGrid(57, 40, vehicle.rate_max)
    weight = random_weight(generator, grid)
    for share in (0.25, 0.5, 0.8):
        instant = round(share * grid.steps) * grid.dt
        for winding in (0, 1):
            tilts = [random_tilt(generator, grid, 2 * np.pi * winding) for _ in range(6)]
            tilts.append(greedy_tilt(grid, weight, 2 * np.pi * winding))
            for tilt in tilts:
                angle, flown = float(tilt(instant)), integral(vehicle, grid, weight, tilt)
                # Held to a point, from one side, from the other side, and within an interval.
                for low, high in ((angle, angle), (angle, math.inf), (-math.inf, angle), (angle - 0.1, angle + 0.01)):
                    program = TiltProgram(vehicle, grid, winding, 0.0, [TiltInterval(share, low, high)])
                    assert program.possible
                    assert flown <= bound(program(weight, 0.3, 0.3))


def test_one_programme_on_the_circle_bounds_all_windings(generator):
    grid = TimeGrid(90, 60, 10.0)
    for _ in range(5):
        weight = random_weight(generator, grid)
        whole = TiltProgram(Quadrotor(), grid, None)(weight, 0.4, 0.4)
        for winding in (-1, 0, 1):
            assert bound(TiltProgram(Quadrotor(), grid, winding)(weight, 0.4, 0.4)) <= bound(whole) + 1e-9


def test_a_held_tilt_may_turn_away_immediately():
    # The tilt turns to the angle of q, back for the instant, to q again, and back for the end, at the rate limit.
    # Samples next to the instant are up to dt away from it, and up to d in angle. This matters most where q is large.
    grid, vehicle = TimeGrid(160, 40, 10.0), Quadrotor()
    middle, time = grid.steps / 2 * grid.dt, grid.dt * np.linspace(0, grid.steps, 4 * grid.steps + 1)
    away = np.minimum(np.minimum(time, time[-1] - time), np.abs(time - middle))
    tilt = Tilt(time, np.minimum(np.pi / 2, grid.rate_max * away))
    program = TiltProgram(vehicle, grid, 0, 0.0, [TiltInterval(0.5, 0.0, 0.0)])
    for before, after in ((0.1, 2.0), (2.0, 0.1)):
        strength = np.where(np.arange(grid.steps + 1) <= grid.steps // 2, before, after)
        weight = np.column_stack([strength, np.zeros(grid.steps + 1)])
        flown = integral(vehicle, grid, weight, tilt)
        # An instant of the grid counts as between two, so the bounds are wider by one more angle.
        assert flown <= bound(program(weight, *tuned(program, weight))) < 1.03 * flown


def test_holding_the_tilt_never_raises_the_bound_and_one_half_keeps_it(generator):
    grid = TimeGrid(60, 48, 10.0)
    for _ in range(5):
        weight = random_weight(generator, grid)
        free = TiltProgram(Quadrotor(), grid, 0)(weight, 0.4, 0.4).value
        low, high = (
            TiltProgram(Quadrotor(), grid, 0, 0.0, [TiltInterval(0.5, *part)])(weight, 0.4, 0.4).value
            for part in ((-math.inf, 0.2), (0.2, math.inf))
        )
        assert max(low, high) == pytest.approx(free, abs=1e-12)
        assert min(low, high) <= free + 1e-12


def test_a_winding_that_takes_longer_than_the_duration_is_impossible():
    grid = time_grid(1.0, 10.0)  # 10 rad
    possible = {winding: TiltProgram(Quadrotor(), grid, winding).possible for winding in (-2, -1, 0, 1, 2)}
    assert possible == {-2: False, -1: True, 0: True, 1: True, 2: False}
    assert TiltProgram(Quadrotor(), grid, 2, slack=4 * np.pi - 10).possible
    assert not TiltProgram(Quadrotor(), grid, 0, held=[TiltInterval(0.25, 3.0, math.inf)]).possible
    assert TiltProgram(Quadrotor(), grid, 0, held=[TiltInterval(0.25, 2.4, math.inf)]).possible


# Tightness.


@pytest.mark.parametrize(("vehicle", "winding"), [(VEHICLES[0], 0), (VEHICLES[0], 1), (VEHICLES[1], 0)])
def test_the_bound_falls_with_the_square_of_the_angle_towards_a_flight(vehicle, winding):
    turns, bounds = (100, 200, 400, 800), []
    for turn in turns:
        grid = TimeGrid(turn * 2, turn, vehicle.rate_max)  # time for two turns
        program, weight = TiltProgram(vehicle, grid, winding), smooth(grid)
        bounds.append(bound(program(weight, *tuned(program, weight))))
    falls = -np.diff(bounds)
    assert (falls > 0).all()
    order = -np.polyfit(np.log2(turns[1:]), np.log2(falls), 1)[0]
    assert 1.8 < order < 2.2
    assert 0 < bounds[-1] - best(vehicle, grid, weight, winding) < 2e-4 * bounds[-1]


# Each correction term is needed.


def tight(winding=0, slack=0.0, reverse=False):
    """Return a programme, a weight, penalties of a tight bound, and the integral of a flight close to the bound."""
    grid, vehicle = TimeGrid(200, 100, 10.0), Quadrotor()
    weight, program = smooth(grid), TiltProgram(vehicle, grid, winding, slack)
    weight = weight[::-1] if reverse else weight
    return program, weight, tuned(program, weight), best(vehicle, grid, weight, winding, slack)


def test_the_bound_fails_without_the_interpolation_term():
    grid = TimeGrid(24, 12, 10.0)
    half = grid.angle / 2
    weight = np.tile([math.sin(half), math.cos(half)], (grid.steps + 1, 1))
    tilt = greedy_tilt(grid, weight, 0.0)
    most = TiltProgram(Quadrotor(), grid, 0)(weight, 0.0, 0.0)
    flown = integral(Quadrotor(), grid, weight, tilt)
    assert most.value < flown - 0.5 * most.interpolation
    assert flown <= most.value + most.interpolation


@pytest.mark.parametrize("slack", [0.0, 0.1])
@pytest.mark.parametrize("winding", [0, 1])
def test_the_bound_fails_without_the_penalty_terms(winding, slack):
    program, weight, (first, last), flown = tight(winding, slack)
    whole, d = bound(program(weight, first, last)), program.grid.angle
    assert flown <= whole
    assert whole - first * d / 2 < flown
    assert whole - last * (slack + d / 2) < flown
    if slack:
        assert whole - last * slack < flown


@pytest.mark.parametrize("reverse", [False, True])
def test_the_bound_fails_with_only_one_of_the_sums(reverse):
    program, weight, (first, last), flown = tight(reverse=reverse)
    sums, _ = slow(Quadrotor(), program.grid, weight, first, last)
    most, d = program(weight, first, last), program.grid.angle
    rest = (first + last) * d / 2 + most.interpolation
    assert flown <= sum(sums) / 2 + rest
    assert sums[1 if reverse else 0] + rest < flown


def test_the_programme_agrees_with_its_definition(generator):
    for winding, slack, vehicle in ((0, 0.0, VEHICLES[0]), (1, 0.1, VEHICLES[1]), (-1, 0.3, VEHICLES[2])):
        grid = TimeGrid(41, 30, vehicle.rate_max)
        weight, first, last = random_weight(generator, grid), *generator.uniform(0, 2, 2)
        most = TiltProgram(vehicle, grid, winding, slack)(weight, first, last)
        sums, _ = slow(vehicle, grid, weight, first, last, winding, slack)
        d = grid.angle
        value = sum(sums) / 2 + first * d / 2 + last * (slack + d / 2)
        assert most.value == pytest.approx(value, abs=1e-12, rel=1e-12)
        lengths = np.hypot(*weight.T)
        interpolation = d**2 / 8 * grid.dt * vehicle.thrust_max * (lengths[:-1] + lengths[1:]).sum() / 2
        assert most.interpolation == pytest.approx(interpolation, rel=1e-12)


# The grid.


@pytest.mark.parametrize("vehicle", VEHICLES, ids=["default", "slow", "agile"])
def test_the_time_of_a_grid_is_rounded_downwards(vehicle, generator):
    # More digits of pi than a double has, from below.
    pi = Fraction(314159265358979323846264338327950288419, 10**38)
    for _ in range(300):
        steps, turn = (int(n) for n in generator.integers([2, 20], [5000, 2000]))
        grid = TimeGrid(steps, turn, vehicle.rate_max * float(generator.uniform(0.5, 2)))
        exact = 2 * pi * steps / turn / Fraction(grid.rate_max)
        assert exact * (1 - 16 * Fraction(UNIT_ROUNDOFF)) < Fraction(grid.time) <= exact


def test_a_grid_has_the_requested_duration_and_relaxes_the_rate_little(generator):
    for time in generator.uniform(0.05, 4, 60):
        for turn, cell in ((50, 0.0), (100, 0.01), (400, 0.0)):
            grid = time_grid(time, 10.0, turn=turn, cell=cell)
            assert grid.time == time
            assert grid.valid
            least = max(turn, math.ceil(LEAST_STEPS * 2 * math.pi / (10.0 * time)))  # a hundred instants, however short
            assert least <= grid.turn <= round(1.2 * least)
            assert grid.steps >= LEAST_STEPS
            assert grid.steps % grid.stride == 0
            assert grid.stride == max(1, round(cell / (grid.angle / 10.0)))
            # The angle exceeds that of the greatest rate by less than the steps that fill the last cell.
            assert 1 <= grid.angle / (grid.dt * 10.0) <= 1 + grid.stride / (grid.steps - grid.stride)
            shorter = replace(grid, steps=grid.steps - grid.stride)
            assert not shorter.valid


def test_a_smaller_gap_gives_smaller_angles():
    assert angles_for(1e-3) == 400
    assert angles_for(1e-3 / 4) == 800
    assert angles_for(1.0) == 100
