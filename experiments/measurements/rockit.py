"""The baseline of the solver: the same free-time problem in rockit, a general optimal-control toolbox.

rockit comes from the university of the paper. Multiple shooting with one Runge-Kutta step per interval,
Ipopt on expanded graphs, and the same steps, tolerance and initial guess as ours. rockit caches the program: every
solve but the first is warm.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable

import casadi as ca
import numpy as np

from flatgym.scenarios.scenario import Scenario
from optimal.direct.guesses import first_guess
from optimal.direct.stages import Stages


def rockit_solver(scenario: Scenario, nodes: int) -> Callable[[], tuple[float, int]]:
    """Return a function that solves a scenario without hoops and height limits; it returns T [s] and iterations.

    Args:
        scenario: start, goal and vehicle.
        nodes: number of steps.

    Raises:
        ValueError: for a scenario with hoops, a floor or a ceiling.
    """
    if scenario.hoops or scenario.floor is not None or scenario.ceiling is not None:
        raise ValueError(f"rockit solves scenarios without hoops, floor and ceiling, got {scenario.name!r}")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # its dependencies warn on import
        from rockit import FreeTime, MultipleShooting, Ocp
    q, stages = scenario.quadrotor, Stages((nodes,))
    guess = first_guess(scenario, (nodes,), 0)
    ocp = Ocp(T=FreeTime(float(guess[stages.lengths[0]]) * nodes))
    states, (thrust, rate) = [ocp.state() for _ in range(5)], [ocp.control() for _ in range(2)]
    slopes = (states[2], states[3], thrust * ca.sin(states[4]), thrust * ca.cos(states[4]) - q.gravity, rate)
    for i, state in enumerate(states):
        ocp.set_der(state, slopes[i])
        ocp.subject_to(ocp.at_t0(state) == scenario.start_state[i])
        ocp.subject_to(ocp.at_tf(state) == scenario.goal_state[i])
        ocp.set_initial(state, guess[stages.states[:, i]])
    for i, control in enumerate((thrust, rate)):
        ocp.subject_to(q.control_low[i] <= (control <= q.control_high[i]))
        ocp.set_initial(control, guess[stages.controls[:, i]])
    ocp.add_objective(ocp.T)
    quiet = {"print_time": False, "ipopt.print_level": 0, "ipopt.sb": "yes"}
    ocp.solver("ipopt", {"expand": True, "ipopt.tol": 1e-9, **quiet})
    ocp.method(MultipleShooting(N=nodes, M=1, intg="rk"))

    def solve() -> tuple[float, int]:
        solution = ocp.solve()
        return float(np.asarray(solution.value(ocp.T))), int(solution.stats["iter_count"])

    return solve
