"""TODO optimal/direct/guesses.py."""

from __future__ import annotations

import numpy as np

from flatgym.quadrotor import Array
from flatgym.scenarios.scenario import Scenario
from optimal.direct import transcription as tr
from optimal.direct.stages import Stages
from optimal.flights.trajectory import Trajectory

PLAIN_BEND = np.array([0.0, 0.0, 0.3])
"""Detour of the plain start in x [m], z [m], theta [rad]: a little tilt, because on vertical
displacements the mirror-symmetric flight is a saddle from which no gradient leads away."""

DRAWN_BEND = np.array([1.0, 1.0, 1.0])
"""Standard deviations of the detours of drawn starts in x [m], z [m], theta [rad]."""


def first_guess(
    scenario: Scenario, steps: tuple[int, ...], winding: int, generator: np.random.Generator | None = None
) -> Array:
    """Return a start for `program`: the plain one, or a bent and stretched one drawn from `generator`."""
    q, (_, lengths) = scenario.quadrotor, tr.legs(scenario)
    duration, bend = 2 * np.sqrt(lengths.sum() / (q.thrust_max - q.gravity)) + 0.3, PLAIN_BEND
    if generator is not None:
        duration *= generator.uniform(0.7, 1.8)
        bend = generator.normal(0.0, DRAWN_BEND)
    h = duration * lengths / lengths.sum() / np.array(steps)
    share = np.append(0.0, np.cumsum(np.repeat(h, steps))) / duration
    states = tr.guess_states(scenario, share, duration, winding, bend)
    controls = np.tile([q.gravity, np.clip(2 * np.pi * winding / duration, -q.rate_max, q.rate_max)], (sum(steps), 1))
    return Stages(steps).pack(h, states.T, controls)


def upsampled_guess(flight: Trajectory, coarse: tuple[int, ...], steps: tuple[int, ...]) -> Array:
    """Return a flight of `coarse` steps a phase as a start for `program` on a grid of other `steps`."""
    ends = flight.breakpoints[np.append(0, np.cumsum(coarse))]
    h = np.diff(ends) / np.array(steps)
    time = np.append(0.0, np.cumsum(np.repeat(h, steps)))
    states, thrust = tr.resampled(flight, time)
    return Stages(steps).pack(h, states, np.column_stack([thrust, np.diff(states[:, 4]) / np.diff(time)]))


def warm_start(flight: Trajectory, steps: tuple[int, ...]) -> Array:
    """Return a flight as a start for `program` on its own grid."""
    return Stages(steps).pack(np.diff(flight.breakpoints)[Stages(steps).firsts], flight.states, flight.controls)
