"""First and second derivatives of the exact step with respect to state, step length and control.

Spherical Bessel functions differentiate into one another,

    j0' = -j1,   j1' = (j0 - 2 j2)/3,   j2' = (2 j1 - 3 j3)/5.

No power series needs to be differentiated, which makes the derivatives cheap.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import casadi as ca

TERMS = 6
"""Terms of the power series: exact to rounding for steps that turn 1 rad, to 1e-9 for 2 rad."""


def _series(a: Any) -> Any:
    """Return the spherical Bessel functions j0 to j3 as power series, shape (4,)."""
    rows = []
    for order in range(4):
        series: Any = 1.0
        for i in range(TERMS - order // 2, 0, -1):
            series = 1 - a * a / (2 * i * (2 * order + 2 * i + 1)) * series
        rows.append(a**order / math.prod(range(1, 2 * order + 2, 2)) * series)
    return ca.vertcat(*rows)


@lru_cache(maxsize=1)
def step_functions() -> tuple[Any, Any, Any]:
    """Return the exact step and its derivatives as CasADi functions of [state, h, thrust, rate] (8,) and gravity.

    The first returns the state after the step (5,). The second returns that state and its Jacobian (5, 8). The third
    also takes multipliers (5,), and returns gradient (8,) and Hessian (8, 8) of their product with the step.
    """
    arc, gravity, costate = ca.SX.sym("arc", 8), ca.SX.sym("g"), ca.SX.sym("l", 5)
    x, z, vx, vz, theta, h, thrust, rate = ca.vertsplit(arc)
    half_turn, bessel = rate * h / 2, ca.SX.sym("j", 4)
    sin, cos, (j0, j1, j2, j3) = ca.sin(theta + half_turn), ca.cos(theta + half_turn), ca.vertsplit(bessel)
    dv, dp = thrust * h, thrust * h * h / 2
    after = ca.vertcat(
        x + vx * h + dp * (j0 * sin - j1 * cos),
        z + vz * h + dp * (j0 * cos + j1 * sin) - gravity * h * h / 2,
        vx + dv * j0 * sin,
        vz + dv * j0 * cos - gravity * h,
        theta + rate * h,
    )
    # j3' is not needed: two derivatives of j0 and j1 reach j3 itself.
    slopes = ca.vertcat(-j1, (j0 - 2 * j2) / 3, (2 * j1 - 3 * j3) / 5, 0)

    def derivative(expression: Any) -> Any:
        through = ca.jacobian(expression, bessel) @ slopes @ ca.jacobian(half_turn, arc)
        return ca.jacobian(expression, arc) + through

    def function(name: str, inputs: list[Any], *expressions: Any) -> Any:
        return ca.Function(name, inputs, ca.cse(ca.substitute(list(expressions), [bessel], [_series(half_turn)])))

    return (
        function("step", [arc, gravity], after),
        function("step_jacobian", [arc, gravity], after, derivative(after)),
        function("step_hessian", [arc, gravity, costate], *_curvature(arc, gravity, costate, bessel)),
    )


def _curvature(arc: Any, gravity: Any, costate: Any, bessel: Any) -> tuple[Any, Any]:
    """Return gradient (8,) and Hessian (8, 8) of L = costate . step.

    The formulas are written by hand; automatic differentiation gives three times as many operations. L is linear
    except for thrust Phi, Phi = j0(a) u + j1(a) w, with a = rate h/2 and m = theta + a. The derivatives of Phi in m, a
    and h are sums of a few products, because the derivatives of u and w in m are rotations of them.
    """
    _, _, vx, vz, theta, h, thrust, rate = ca.vertsplit(arc)
    lx, lz, lvx, lvz, ltheta = ca.vertsplit(costate)
    j0, j1, j2, j3 = ca.vertsplit(bessel)
    d0, d1 = -j1, (j0 - 2 * j2) / 3  # j0', j1'
    dd0, dd1 = -d1, (d0 - 2 * (2 * j1 - 3 * j3) / 5) / 3  # j0'', j1''
    sin, cos, half = ca.sin(theta + rate * h / 2), ca.cos(theta + rate * h / 2), h * h / 2
    a, b, a_h, b_h = half * lx + h * lvx, half * lz + h * lvz, h * lx + lvx, h * lz + lvz
    u, u_m, u_h, u_mh = a * sin + b * cos, a * cos - b * sin, a_h * sin + b_h * cos, a_h * cos - b_h * sin
    v, v_m = lz * sin - lx * cos, lz * cos + lx * sin
    w, w_m, w_h, w_mh, u_hh = half * v, half * v_m, h * v, h * v_m, lx * sin + lz * cos
    phi, phi_m, phi_a = j0 * u + j1 * w, j0 * u_m + j1 * w_m, d0 * u + d1 * w
    phi_am, phi_aa = d0 * u_m + d1 * w_m, dd0 * u + dd1 * w
    phi_h, phi_mh, phi_ah = j0 * u_h + j1 * w_h, j0 * u_mh + j1 * w_mh, d0 * u_h + d1 * w_h
    phi_hh = j0 * u_hh + j1 * v
    # Rate and h change m and a equally: first and second derivative in that direction.
    along, along_h, bent, across = phi_m + phi_a, phi_mh + phi_ah, phi_aa + 2 * phi_am - phi, phi_am - phi
    k, n = rate / 2, h / 2
    gradient = ca.vertcat(
        lx,
        lz,
        lx * h + lvx,
        lz * h + lvz,
        thrust * phi_m + ltheta,
        thrust * (k * along + phi_h) + lx * vx + lz * vz - gravity * (lz * h + lvz) + ltheta * rate,
        phi,
        thrust * n * along + ltheta * h,
    )
    upper = ca.SX(8, 8)
    upper[2, 5], upper[3, 5] = lx, lz
    upper[4, 4], upper[4, 5], upper[4, 6] = -thrust * phi, thrust * (k * across + phi_mh), phi_m
    upper[4, 7], upper[5, 6], upper[6, 7] = thrust * n * across, k * along + phi_h, n * along
    upper[5, 5] = thrust * (k * k * bent + 2 * k * along_h + phi_hh) - gravity * lz
    upper[5, 7] = thrust * (along / 2 + n * (k * bent + along_h)) + ltheta
    upper[7, 7] = thrust * n * n * bent
    return gradient, ca.triu2symm(upper)
