"""Verification of a solved flight: its controls against the signs of the switching functions.

The solution of a boundary-value problem satisfies the equations of a given structure. It is an extremal only if its
controls maximise the Hamiltonian at every instant. If not, the switching functions suggest another structure.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from flatgym.quadrotor import Array
from optimal.indirect.arcs import ArcControl
from optimal.indirect.costates import SIGN_TOLERANCE, Flags, hamiltonian, misalignment, signs_agree, switching_functions
from optimal.indirect.extremal import POINTS, Extremal, ExtremalFlight, control_arcs, costate_samples


def verify(
    result: Extremal, flight: ExtremalFlight, structure: tuple[ArcControl, ...], durations: Array
) -> tuple[Extremal, list[tuple[ArcControl, float]]]:
    """Compare the controls of a flight with the signs of the switching functions.

    Args:
        result: the attempt so far.
        flight: the flight of the solved equations.
        structure, durations: its arcs.

    Returns:
        The result, converged if all signs agree; and the pieces of the flight with the controls that the
        switching functions suggest, with their durations [s].
    """
    q, singular = flight.quadrotor, np.repeat(np.isnan(flight.controls[:, 1]), POINTS)
    width, state, control, costate = costate_samples(flight)
    p, rate = costate[:, 4], control[:, 1]
    aligned = np.abs(misalignment(state, costate)) <= SIGN_TOLERANCE
    followed = (np.abs(p) <= SIGN_TOLERANCE) & aligned & (np.abs(rate) <= q.rate_max)
    agreed = signs_agree(state, control, costate, q) & (followed | ~singular)
    result = replace(
        result,
        switches=control_arcs(structure, durations),
        sign_agreement=1.0 if agreed.all() else float(width[agreed].sum() / width.sum()),
        hamiltonian_drift=float(np.ptp(hamiltonian(state, control, costate, q))),
    )
    if agreed.all():
        message = "Solved: Pontryagin's conditions hold, including the signs of the switching functions."
        result = replace(result, message=message, converged=True, time=flight.duration, trajectory=flight)
    lift, slip = switching_functions(state, costate)
    thrust = np.where(lift > 0, q.thrust_max, q.thrust_min)
    turning = _suggested_turning(singular, p, rate, lift, slip, q.rate_max)
    labels = zip(thrust.tolist(), (turning * q.rate_max).tolist(), strict=True)
    return result, [((f, turn or None), length) for (f, turn), length in zip(labels, width.tolist(), strict=True)]


def _suggested_turning(singular: Flags, p: Array, rate: Array, lift: Array, slip: Array, rate_max: float) -> Array:
    """Return the sign of the rate that the switching functions suggest, 0 for a singular arc, shape (n,).

    Args:
        singular: whether a sample is on a singular arc.
        p: costate of the tilt.
        rate: rate of the flight [rad/s].
        lift, slip: q . e and q . e'.
        rate_max: limit of the rate [rad/s].
    """
    turning = np.where(singular, 0.0, np.sign(p))
    # Where q turns faster than rate_max, the tilt turns at the limit from before to after that part of the arc. For a
    # parabolic rate, the bang arc is sqrt(3) times as long as that part. It begins where the rate is below the limit by
    # twice the excess of the peak.
    if (peak := np.abs(rate[singular]).max(initial=0.0)) > rate_max:
        fast = singular & (np.abs(rate) > max(3 * rate_max - 2 * peak, rate_max / 2))
        turning[fast] = np.sign(rate[fast])
    # If p has the wrong sign while the tilt passes q, or on both sides of a switch, the arc should be singular there.
    wrong = np.flatnonzero(turning * rate < 0)
    for run in np.split(wrong, np.flatnonzero(np.diff(wrong) > 1) + 1):
        lifted = run[lift[run] > 0]
        if len(set(np.sign(slip[lifted]))) > 1 or len(set(turning[lifted])) > 1:
            turning[lifted] = 0.0
    return turning
