"""Batches: answers independent of the workers and in order; robust to errors, kills, full disks and damaged files."""

import errno
import functools
import json
import signal
import subprocess
import sys
import time
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

import optimal
from experiments.measurements.sections import uniform_goal
from flatgym import SCENARIOS, Scenario
from optimal import Status, batch, fewest_steps_many, solve_many, store
from optimal.direct import program as shooting_program
from optimal.parallel import unordered
from optimal.store import decoded, encoded, stored_answers

GOALS = [uniform_goal(np.random.default_rng((7, i)), i) for i in range(6)]
TIMES = ("solve_time",)


def facts(answer):
    """Return every field of an answer except its wall times, exactly."""
    values = {field.name: getattr(answer, field.name) for field in fields(answer) if field.name not in TIMES}
    flight = values.pop("trajectory", None)
    if flight is not None:
        values |= {name: getattr(flight, name).tobytes() for name in ("breakpoints", "states", "controls")}
    return {name: value.tobytes() if isinstance(value, np.ndarray) else value for name, value in values.items()}


def test_answers_depend_neither_on_the_workers_nor_on_the_order():
    for many in (solve_many, fewest_steps_many):
        alone = many(GOALS, jobs=1)
        assert [answer.scenario for answer in alone] == GOALS
        together = many(GOALS[::-1], jobs=2)[::-1]
        assert [facts(answer) for answer in together] == [facts(answer) for answer in alone]


def test_a_failed_scenario_has_an_answer_and_does_not_stop_the_others():
    far = replace(SCENARIOS["diagonal"], goal=(4000.0, 0.0), time_limit=1000.0)
    answers = solve_many(["horizontal-3", far, "hoop"], jobs=1, method="pontryagin", windings=(0,))
    assert [answer.status for answer in answers] == [Status.LOCALLY_OPTIMAL, answers[1].status, Status.INTERRUPTED]
    assert not answers[1].solved
    assert "shooting" in answers[2].reason
    assert answers[2].time == np.inf
    steps = fewest_steps_many([far, "horizontal-3"], jobs=1, windings=(0,))
    assert [answer.steps for answer in steps] == [np.inf, 44]
    assert "too far" in steps[0].reason


def test_equal_scenarios_are_solved_once():
    reported = []
    answers = solve_many(["horizontal-3"] * 3, jobs=1, windings=(0,), progress=lambda *counts: reported.append(counts))
    assert reported == [(1, 1)]
    assert answers[0] is answers[2]
    assert solve_many([], jobs=1) == []


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"starts": 2, "tries": 3}, "unknown options tries; solve has method, windings"),
        ({"raise_on_failure": True}, "unknown options raise_on_failure"),
        ({"backend": "dask"}, "unknown backend 'dask'; known: loky, ray"),
        ({"jobs": 0}, "jobs must be a number of processes, or -1 for one a core, got 0"),
        ({"method": "flat", "store": "."}, "a store keeps flights of method='shooting' only, got 'flat'"),
    ],
)
def test_invalid_arguments_are_rejected_before_any_work(arguments, words):
    with pytest.raises(ValueError, match=words):
        solve_many(["hoop"], **arguments)
    with pytest.raises(ValueError, match="unknown scenario 'hop'"):
        solve_many(["hop"])


def test_stored_answers_are_read_to_the_bit_and_not_computed_again(tmp_path):
    reported = []
    for many, tasks in ((solve_many, GOALS[:2]), (fewest_steps_many, [GOALS[0], unreachable()])):
        first = many(tasks, jobs=1, store=tmp_path)
        again = many(tasks, jobs=1, store=tmp_path, progress=lambda *counts: reported.append(counts))
        assert not reported
        for one, other in zip(first, again, strict=True):
            assert facts(one) == facts(other)
            assert all(type(getattr(one, f.name)) is type(getattr(other, f.name)) for f in fields(one))
    assert len(list(tmp_path.iterdir())) == 4
    solve_many(GOALS[:1], jobs=1, store=tmp_path, seed=1)
    assert len(list(tmp_path.iterdir())) == 5


def unreachable():
    """A goal that cannot be reached within the time limit."""
    return replace(SCENARIOS["horizontal-6"], time_limit=1.0)


def damaged(text, how):
    data = json.loads(text)
    if how == "half":
        return text[: len(text) // 2]
    if how == "empty":
        return ""
    if how == "version":
        return json.dumps(data | {"version": "0.0"})
    if how == "schema":
        return json.dumps(data | {"schema": 0})
    if how == "no answer":
        return "[]"
    data["answer"]["time"] *= 0.9
    return json.dumps(data)


@pytest.mark.parametrize(
    ("how", "words"),
    [
        ("half", "Unterminated|Expecting"),
        ("empty", "Expecting"),
        ("version", "written as schema 1 by version 0.0, wanted 1 by"),
        ("schema", "schema 0"),
        ("no answer", "no answer in it"),
        ("number", "checksum"),
    ],
)
def test_a_damaged_file_is_moved_aside_and_replaced(tmp_path, how, words):
    (first,) = solve_many(GOALS[:1], jobs=1, store=tmp_path, windings=(0,))
    (path,) = tmp_path.iterdir()
    bad = damaged(path.read_text(), how)
    for number in (1, 2):
        path.write_text(bad)
        with pytest.warns(UserWarning, match=f"{path.name} cannot be used .*({words}).*moved aside as"):
            (again,) = solve_many(GOALS[:1], jobs=1, store=tmp_path, windings=(0,))
        assert facts(again) == facts(first)
        assert decoded(path.read_text(), GOALS[0]).time == first.time
        aside = [other for other in tmp_path.iterdir() if other != path]
        assert len(aside) == number
        assert all(other.read_text() == bad and ".set-aside" in other.name for other in aside)


def test_the_answer_for_another_scenario_is_rejected():
    (answer,) = solve_many(GOALS[:1], jobs=1, windings=(0,))
    with pytest.raises(ValueError, match="it is the answer for"):
        decoded(encoded(answer), GOALS[1])


def test_a_full_disk_is_reported_and_finished_answers_stay(tmp_path, monkeypatch):
    written, write = [], store.write_text

    def full(path, text):
        if len(written) == 2:
            raise OSError(errno.ENOSPC, "No space left on device")
        written.append(path)
        write(path, text)

    monkeypatch.setattr(store, "write_text", full)
    with pytest.raises(OSError, match=r"No space left.*earlier answers stay.*\.json") as failure:
        solve_many(GOALS[:4], jobs=1, store=tmp_path, windings=(0,))
    assert failure.value.errno == errno.ENOSPC
    assert sorted(tmp_path.iterdir()) == sorted(written)
    monkeypatch.undo()
    reported = []
    solve_many(GOALS[:4], jobs=1, store=tmp_path, windings=(0,), progress=lambda *counts: reported.append(counts))
    assert reported == [(1, 2), (2, 2)]


STUCK_X = 3.0037
"""The x of the goal whose solver calls do not return [m]."""


def program_that_may_be_stuck(shape, warm):
    """Build the solver of a shape, which does not return for the goal at STUCK_X."""
    solver = shooting_program.program(shape, warm)

    def run(**values):
        while values["p"][1] == STUCK_X:
            pass
        return solver(**values)

    run.stats = solver.stats
    return run


def with_stuck_calls(ask):
    """Return a solver, for any process, some of whose calls do not return."""

    @functools.wraps(ask)
    def asked(problem, **options):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("optimal.direct.shooting.program", program_that_may_be_stuck)
            patch.setattr("optimal.direct.solver_process.LIMIT", 1.5)
            return ask(problem, **options)

    return asked


@pytest.mark.parametrize(("many", "options", "lost"), [(solve_many, {"starts": 1}, 2), (fewest_steps_many, {}, 3)])
def test_a_batch_names_the_one_in_twenty_whose_calls_do_not_return(many, options, lost, monkeypatch):
    name = many.__name__.removesuffix("_many")
    goals = [replace(SCENARIOS["horizontal-3"], goal=(x / 10000, 0)) for x in range(30030, 30050)]
    assert goals[7].goal[0] == STUCK_X
    monkeypatch.setattr(batch, name, with_stuck_calls(getattr(batch, name)))
    answers = many(goals, jobs=2, windings=(0,), **options)
    left = [answer for answer in answers if answer.status not in (Status.LOCALLY_OPTIMAL, Status.BEST_KNOWN)]
    assert [(answer.scenario, answer.status) for answer in left] == [(goals[7], Status.NOT_CONVERGED)]
    assert left[0].reason == f"{lost} of the solver's calls did not return within 1.5 s."
    assert {answer.reason for answer in answers} == {"", left[0].reason}


SCRIPT = """
import sys
import numpy as np
import optimal
from experiments.measurements.sections import uniform_goal
goals = [uniform_goal(np.random.default_rng((7, i)), i) for i in range(40)]
optimal.solve_many(goals, jobs=1, store=sys.argv[1], windings=(0,))
"""


def test_a_killed_batch_resumes_from_its_store(tmp_path):
    child = subprocess.Popen([sys.executable, "-c", SCRIPT, str(tmp_path)], cwd=Path(optimal.__file__).parents[1])
    until = time.monotonic() + 60
    while len(list(tmp_path.glob("[!.]*.json"))) < 5 and child.poll() is None and time.monotonic() < until:
        time.sleep(0.005)
    child.send_signal(signal.SIGKILL)
    child.wait()
    kept = {path: path.stat().st_mtime_ns for path in tmp_path.glob("[!.]*.json")}
    assert 5 <= len(kept) < 40
    goals, reported = [uniform_goal(np.random.default_rng((7, i)), i) for i in range(40)], []
    answers = solve_many(goals, jobs=1, store=tmp_path, windings=(0,), progress=lambda *counts: reported.append(counts))
    assert len(reported) == 40 - len(kept)
    assert all(path.stat().st_mtime_ns == when for path, when in kept.items())
    assert [answer.scenario for answer in answers] == goals
    assert len(list(tmp_path.glob("[!.]*.json"))) == 40


def test_an_answer_is_found_under_any_name_of_its_scenario(tmp_path):
    short = Scenario("short", (0, 0), (1, 0))
    (answer,) = fewest_steps_many([short], jobs=1, store=tmp_path)
    renamed, other = replace(short, name="a/b"), replace(short, dt=0.01)
    (again,) = fewest_steps_many([renamed], jobs=1, store=tmp_path)
    assert len(list(tmp_path.iterdir())) == 1
    assert (again.scenario, again.steps) == (renamed, answer.steps)
    assert [one.scenario for one in stored_answers(tmp_path, renamed)] == [renamed]
    assert stored_answers(tmp_path, other) == []
    next(tmp_path.iterdir()).write_text("{}")
    assert stored_answers(tmp_path, short) == []


def blocks_interrupts(_):
    """Return whether the process that runs this, such as a worker, is spared by Ctrl-C."""
    return signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, ())


def test_workers_are_spared_by_an_interrupt_of_the_terminal_and_their_parent_is_not():
    assert list(unordered(blocks_interrupts, [1, 2, 3], 2, "loky")) == [True] * 3
    assert not blocks_interrupts(None)
