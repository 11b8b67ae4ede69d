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
    duration, bend = 2 * np.sqrt(lengths.sum() / (q.thrust_max - q.gravity)) + 0.3, DEFAULT_BEND
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


def upsampled_guess(flight: Trajectory, coarse: tuple[int, ...], steps: tuple[int, ...]) -> Array:
    """Return a guess for `program` on a grid of `steps` from a flight on a grid of `coarse` steps a phase."""
    ends = flight.breakpoints[np.append(0, np.cumsum(coarse))]
    h = np.diff(ends) / np.array(steps)
    time = np.append(0.0, np.cumsum(np.repeat(h, steps)))
    states, thrust = resampled(flight, time)
    return Stages(steps).pack(h, states, np.column_stack([thrust, np.diff(states[:, 4]) / np.diff(time)]))


def warm_start(flight: Trajectory, steps: tuple[int, ...]) -> Array:
    """Return a flight as a guess for `program` on the flight's own grid."""
    return Stages(steps).pack(np.diff(flight.breakpoints)[Stages(steps).firsts], flight.states, flight.controls)
