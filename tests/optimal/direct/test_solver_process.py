"""The solver process: it changes no answer, gives up calls that do not return, and outlives neither call nor parent."""

import contextlib
import multiprocessing
import os
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

import optimal
from flatgym import SCENARIOS
from optimal import SolveFailed, Status
from optimal.direct import solver_process
from optimal.direct.guesses import first_guess
from optimal.direct.program import Shape, bounds, coarse_steps, program
from optimal.direct.shooting import solve_coarse
from optimal.direct.solver_process import LIMIT, MOST_LOST, SolverLost, call, lost_calls
from optimal.discrete.replanning import RemainingTask, remaining_trajectory, replan

ROOT = Path(optimal.__file__).parents[1]


def question(name="horizontal-6", winding=0):
    """Return the arguments and values of a call that solves a scenario on the coarse grid."""
    scenario = SCENARIOS[name]
    shape = Shape(coarse_steps(scenario), False, False)
    guess = first_guess(scenario, shape.steps, winding)
    return (shape, False), {"x0": guess, **bounds(scenario, shape, winding)}


def stuck(*_):
    """Build a solver that does not return."""

    def run(**_):
        while True:
            pass

    return run


def stuck_at_the_first_guess(shape, warm):
    """Build the solver of `question` that does not return from its guess."""
    solver, guess = program(shape, warm), question()[1]["x0"]

    def run(**values):
        while np.array_equal(values["x0"], guess):
            pass
        return solver(**values)

    run.stats = solver.stats
    return run


def killed(*_):
    """Build a solver during whose call the process is killed."""
    return lambda **_: os.kill(os.getpid(), signal.SIGKILL)


def pid(*_):
    """Build a solver that raises an error which holds the number of its process."""

    def run(**_):
        raise KeyError(os.getpid())

    return run


def process_number():
    """Return the number of the solver process."""
    arguments, values = question()
    with pytest.raises(KeyError) as error:
        call(pid, arguments, **values)
    return error.value.args[0]


def alive(number):
    """Return whether a process runs."""
    state = subprocess.run(["ps", "-o", "stat=", "-p", str(number)], capture_output=True, text=True).stdout.strip()
    return bool(state) and not state.startswith("Z")


def ends(number, within):
    """Return whether a process ends within a time [s]."""
    until = time.monotonic() + within
    while alive(number) and time.monotonic() < until:
        time.sleep(0.02)
    return not alive(number)


@contextlib.contextmanager
def limit(seconds):
    """Let calls count as lost after a time [s]."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(solver_process, "LIMIT", seconds)
        patch.setattr(solver_process, "LIMIT_PER_UNKNOWN", 0.0)
        yield


@pytest.mark.parametrize(("name", "winding"), [("horizontal-6", 0), ("hoop", 1)])
def test_a_call_gives_the_same_numbers_as_in_this_process(name, winding):
    arguments, values = question(name, winding)
    found, run = call(program, arguments, **values), program(*arguments)
    here = run(**values)
    assert found.x.tobytes() == np.array(here["x"]).tobytes()
    assert found.multipliers.tobytes() == np.array(here["lam_g"]).tobytes()
    assert (found.converged, found.iterations) == (True, run.stats()["iter_count"])


def test_a_call_that_does_not_return_is_given_up():
    (arguments, values), before = question(), process_number()
    with limit(0.2):
        lost = call(stuck, arguments, **values)
    assert not lost.converged
    assert lost.message == "1 of the solver's calls did not return within 0.2 s."
    np.testing.assert_array_equal(lost.x, values["x0"])
    assert not alive(before)
    assert call(program, arguments, **values).converged


def test_a_task_ends_at_its_last_permitted_lost_call():
    arguments, values = question()
    with limit(0.1), lost_calls() as lost:
        for _ in range(MOST_LOST):
            call(stuck, arguments, **values)
        with pytest.raises(SolverLost, match=r"3 of the solver's calls did not return within 0\.1 s"):
            call(stuck, arguments, **values)
    assert len(lost) == MOST_LOST + 1
    with lost_calls() as lost:
        call(program, arguments, **values)
    assert not lost
    assert str(lost) == ""


def test_a_start_that_does_not_return_is_named_and_the_others_count(monkeypatch):
    monkeypatch.setattr("optimal.direct.shooting.program", stuck_at_the_first_guess)
    with limit(1.5):
        solution = optimal.solve("horizontal-6", windings=(0,), max_gap=None)
        steps = optimal.fewest_steps("horizontal-6", windings=(0,), time_budget=0.0)
    assert solution.solved
    assert solution.reason == "1 of the solver's calls did not return within 1.5 s."
    assert (steps.steps, steps.reason) == (61, solution.reason)


@pytest.mark.parametrize("ask", [optimal.solve, optimal.fewest_steps])
def test_a_task_whose_calls_do_not_return_fails_with_the_reason(ask, monkeypatch):
    monkeypatch.setattr("optimal.direct.shooting.program", stuck)
    words = "did not converge.*3 of the solver's calls did not return within 0.1 s"
    with limit(0.1), pytest.raises(SolveFailed, match=words) as failure:
        ask("horizontal-6")
    assert failure.value.result.status is Status.NOT_CONVERGED
    assert failure.value.result.reason.startswith("3 of the solver's calls")


def test_a_plan_whose_calls_do_not_return_is_none(monkeypatch):
    flight = optimal.fewest_steps("horizontal-3", windings=(0,), time_budget=0.0)
    task, rest = RemainingTask.of(flight.scenario, flight.states[9]), remaining_trajectory(flight, 9, flight.scenario)
    assert len(replan(task, rest, 0).actions) == flight.steps - 9
    monkeypatch.setattr("optimal.discrete.program.program", stuck)
    with limit(0.1):
        assert replan(task, rest, 0) is None


def test_an_error_in_the_process_is_raised_here_and_the_process_goes_on():
    (arguments, values), before = question(), process_number()
    with pytest.raises(RuntimeError, match="Ill-posed problem"):
        call(program, arguments, **values | {"lbg": values["ubg"] + 1})
    assert process_number() == before


def test_a_process_that_is_killed_is_reported_and_replaced():
    arguments, values = question()
    with pytest.raises(RuntimeError, match="ended with exit code -9; run again, with more free memory"):
        call(killed, arguments, **values)
    assert call(program, arguments, **values).converged


def test_threads_share_the_process():
    windings = [0, 1, -1, 0]
    alone = [solve_coarse(SCENARIOS["diagonal"], winding) for winding in windings]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(lambda winding: solve_coarse(SCENARIOS["diagonal"], winding), windings))
    for one, other in zip(alone, together, strict=True):
        assert one.trajectory.states.tobytes() == other.trajectory.states.tobytes()


def _solve_in_a_child(answers):
    answers.put((process_number(), solve_coarse(SCENARIOS["horizontal-3"]).converged))


def test_a_daemonic_child_of_a_fork_has_a_process_of_its_own():
    context, before = multiprocessing.get_context("fork"), process_number()
    answers = context.Queue()
    child = context.Process(target=_solve_in_a_child, args=(answers,), daemon=True)
    child.start()
    number, converged = answers.get(timeout=60)
    child.join()
    assert converged
    assert number != before
    assert ends(number, within=10)
    assert process_number() == before


HANGS = """
import signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored in jobs in the background of a shell
from tests.optimal.direct.test_solver_process import call, process_number, question, stuck
print(process_number(), flush=True)
arguments, values = question()
call(stuck, arguments, **values)
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_a_signal_ends_a_script_in_a_call_that_does_not_return(number):
    script = subprocess.Popen(
        [sys.executable, "-c", HANGS], cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    solver = int(script.stdout.readline())
    time.sleep(0.2)
    begun = time.monotonic()
    script.send_signal(number)
    script.wait(10)
    assert time.monotonic() - begun < 2
    assert script.returncode == -number
    at_once = number == signal.SIGINT or sys.platform == "linux"
    assert ends(solver, within=2 if at_once else 2 * LIMIT)
    assert script.communicate()[1].count("Traceback") == (number == signal.SIGINT)
