"""Initial guesses of direct shooting: the straight line through the hoops, or a flight found on another grid."""

from __future__ import annotations

import numpy as np

from flatgym.quadrotor import Array
from flatgym.scenarios.scenario import Scenario
from optimal.direct.stages import Stages
from optimal.direct.transcription import geometry, resampled
from optimal.flights.trajectory import Trajectory

DEFAULT_BEND = np.array([0.0, 0.0, 0.3])
"""Detour of the default guess in x [m], z [m], theta [rad]. It has a little tilt, because on vertical displacements
the mirror-symmetric flight is a saddle from which no gradient leads away."""
STRAIGHT_LENGTH = 0.1
"""Length of the way up to which the default guess has no detour [m]. Such short ways gain less than 0.1 % by it, and
from a tilted guess the solver often does not converge."""

RANDOM_BEND = np.array([1.0, 1.0, 1.0])
"""Standard deviations of the detours of random guesses in x [m], z [m], theta [rad]."""


def first_guess(
    scenario: Scenario, steps: tuple[int, ...], winding: int, generator: np.random.Generator | None = None
) -> Array:
    """Return an initial guess for `program`.

    Args:
        scenario: the task.
        steps: of each phase.
        winding: whole turns of the tilt.
        generator: samples duration and detour; None gives the default guess.
    """
    q, lengths = scenario.quadrotor, geometry(scenario).lengths
    duration = 2 * np.sqrt(lengths.sum() / (q.thrust_max - q.gravity)) + 0.3
    bend = DEFAULT_BEND * (lengths.sum() > STRAIGHT_LENGTH)
    if generator is not None:
        duration *= generator.uniform(0.7, 1.8)
        bend = generator.normal(0.0, RANDOM_BEND)
    h = duration * lengths / lengths.sum() / np.array(steps)
    share = np.append(0.0, np.cumsum(np.repeat(h, steps))) / duration
    states = polyline_states(scenario, share, duration, winding, bend)
    controls = np.tile([q.gravity, np.clip(2 * np.pi * winding / duration, -q.rate_max, q.rate_max)], (sum(steps), 1))
    return Stages(steps).pack(h, states.T, controls)


def polyline_states(scenario: Scenario, share: Array, duration: float, winding: int, bend: Array) -> Array:
    """Return states on the polyline through the hoops at constant speed and turn rate, plus a detour, shape (5, nodes).

    Args:
        scenario: the task.
        share: elapsed share of the path at each node, from 0 to 1, shape (nodes,).
        duration: guessed flight time [s].
        winding: whole turns of the tilt.
        bend: amplitudes of half-sine detours in x [m], z [m] and theta [rad], shape (3,).
    """
    points, lengths = geometry(scenario).points, geometry(scenario).lengths
    knots = np.append(0.0, np.cumsum(lengths)) / lengths.sum()
    arch = np.sin(np.pi * share)
    states = np.zeros((5, len(share)))
    for i in range(2):
        states[i] = np.interp(share, knots, points[:, i]) + bend[i] * arch
        states[2 + i] = np.gradient(states[i], share) / duration
    states[4] = 2 * np.pi * winding * share + bend[2] * arch
    states[2:4, [0, -1]] = 0.0
    return states


def guess_along(
    scenario: Scenario, steps: tuple[int, ...], passing_times: Array, tilts: Array, places: Array | None = None
) -> Array:
    """Return a guess that passes the stations at given times with given tilts.

    At known tilts the acceleration is linear in the thrust. The thrust is the one closest to hovering, in the sense of
    least squares, that leads through all hoops and to rest at the goal. It may violate its limits; then it is clipped
    and the states are kept.

    Args:
        scenario: the task.
        steps: of each phase.
        passing_times: times at which hoops and goal are reached, increasing [s], shape (H+1,).
        tilts: tilts at equal distances in time from start to goal, whole turns counted [rad], shape (n,).
        places: distances from the centres of the gaps, along `Hoop.across` [m], shape (H,); None for the centres.
    """
    q, counts = scenario.quadrotor, np.array(steps)
    h = np.diff(passing_times, prepend=0.0) / counts
    dt = np.repeat(h, counts)
    time, stations = np.append(0.0, np.cumsum(dt)), np.cumsum(counts)
    theta = np.interp(time, np.linspace(0.0, passing_times[-1], len(tilts)), tilts)
    middle = (theta[:-1] + theta[1:]) / 2
    push = dt[:, None] * np.column_stack([np.sin(middle), np.cos(middle)])
    # Velocity and position at node i gain push[j] f[j] and reach[i, j] push[j] f[j] from each earlier step j.
    before = np.arange(len(time))[:, None] > np.arange(len(dt))
    reach = np.where(before, time[:, None] - time[:-1] - dt / 2, 0.0)
    start, weight = scenario.start_state, np.array([0.0, -q.gravity])
    free = start[:2] + time[:, None] * start[2:4] + time[:, None] ** 2 / 2 * weight
    targets = geometry(scenario).points[1:].copy()
    if places is not None:
        targets[:-1] += np.array([hoop.across for hoop in scenario.hoops]).reshape(-1, 2) * np.reshape(places, (-1, 1))
    rows = np.vstack([reach[stations] * push[:, axis] for axis in range(2)] + [push.T])
    wanted = np.concatenate([(targets - free[stations]).T.ravel(), -start[2:4] - time[-1] * weight])
    thrust = q.gravity + np.linalg.lstsq(rows, wanted - q.gravity * rows.sum(axis=1), rcond=None)[0]
    states = np.column_stack(
        [
            free + reach @ (push * thrust[:, None]),
            start[2:4] + time[:, None] * weight + before @ (push * thrust[:, None]),
            theta,
        ]
    )
    controls = np.column_stack([thrust, np.diff(theta) / dt])
    return Stages(steps).pack(h, states, np.clip(controls, q.control_low, q.control_high))


def upsampled_guess(flight: Trajectory, coarse: tuple[int, ...], steps: tuple[int, ...]) -> Array:
    """Return a guess for `program` on a grid of `steps` from a flight on a grid of `coarse` steps a phase."""
    ends = flight.breakpoints[np.append(0, np.cumsum(coarse))]
    h = np.diff(ends) / np.array(steps)
    time = np.append(0.0, np.cumsum(np.repeat(h, steps)))
    states, thrust = resampled(flight, time)
    return Stages(steps).pack(h, states, np.column_stack([thrust, np.diff(states[:, 4]) / np.diff(time)]))


def turned_guess(flight: Trajectory, steps: tuple[int, ...], phase: int, turns: int) -> Array:
    """Return a flight on its own grid of `steps` a phase, with whole turns of the tilt added evenly over one phase.

    States after that phase keep their attitude, because they turn by a multiple of 2 pi.
    """
    first = int(Stages(steps).firsts[phase])
    states, controls, dt = flight.states.copy(), flight.controls.copy(), np.diff(flight.breakpoints)
    share = np.clip((np.arange(len(states)) - first) / steps[phase], 0.0, 1.0)
    states[:, 4] += 2 * np.pi * turns * share
    rate_max = flight.quadrotor.rate_max
    controls[:, 1] = np.clip(np.diff(states[:, 4]) / dt, -rate_max, rate_max)
    return Stages(steps).pack(dt[Stages(steps).firsts], states, controls)


def warm_start(flight: Trajectory, steps: tuple[int, ...]) -> Array:
    """Return a flight as a guess for `program` on the flight's own grid."""
    return Stages(steps).pack(np.diff(flight.breakpoints)[Stages(steps).firsts], flight.states, flight.controls)
