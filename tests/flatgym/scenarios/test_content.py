"""Tasks as plain data: round trips, the digest of the content, and errors that name the fields."""

import hashlib
import json
from dataclasses import fields, replace

import numpy as np
import pytest

import flatgym
from flatgym import DISTRIBUTIONS, SCENARIOS, Distribution, Hoop, Quadrotor, Scenario, Tolerance

TASKS = [*SCENARIOS.values(), *DISTRIBUTIONS.values()]
TRACK = Scenario("own", (0, 1), (6, 1), hoops=(Hoop(2, 1.5, 0.5, 0.1), Hoop(4, 1, 0.5)), floor=0, ceiling=3)


@pytest.mark.parametrize("task", [*TASKS, TRACK], ids=lambda task: task.name)
def test_tasks_survive_their_plain_data(task):
    assert type(task).from_dict(json.loads(task.to_json())) == task
    assert flatgym.scenarios.catalogue.problem(task.to_json()) == task


@pytest.mark.parametrize("task", [*TASKS, TRACK], ids=lambda task: task.name)
def test_the_digest_is_that_of_everything_but_the_name(task):
    assert replace(task, name="other").digest == task.digest
    assert type(task).from_dict(task.to_dict()).digest == task.digest
    content = {key: value for key, value in task.to_dict().items() if key != "name"}
    text = json.dumps(content, sort_keys=True, separators=(",", ":"))
    assert task.digest == hashlib.sha256(text.encode()).hexdigest()


def test_no_two_named_tasks_have_the_same_digest():
    assert len({task.digest for task in TASKS}) == len(TASKS)


CHANGES = {
    "start": (0.0, 1.25), "goal": (6.0, 1.25), "hoops": TRACK.hoops[::-1], "floor": None, "ceiling": 3.5,
    "quadrotor": Quadrotor(rate_max=9), "tolerance": Tolerance(speed=0.3), "dt": 0.01, "time_limit": 6.0,
}  # fmt: skip


@pytest.mark.parametrize("name", [field.name for field in fields(Scenario) if field.name != "name"])
def test_every_other_field_changes_the_digest(name):
    assert replace(TRACK, **{name: CHANGES[name]}).digest != TRACK.digest


def test_equal_numbers_have_equal_digests():
    one = Scenario("one", (0, 0), (5, 0), hoops=[Hoop(2, 0, 1)])
    other = Scenario("other", (-0.0, 0.0), (np.float64(5), np.int64(0)), hoops=(Hoop(2.0, -0.0, 1.0, -0.0),))
    assert one.digest == other.digest
    assert (
        Distribution("a", hoops=[1, 2], diameter=[1, 2]).digest
        == Distribution("b", hoops=(1, 2), diameter=(1.0, 2.0)).digest
    )


@pytest.mark.parametrize(
    ("kind", "change", "words"),
    [
        (Scenario, {"ceilling": 3}, r"Scenario has no field 'ceilling'; known: name, .*; did you mean 'ceiling'\?"),
        (Scenario, {"hoops": [{"x": 1, "z": 1, "diametre": 1}]}, r"hoops\[0\] has no field 'diametre'; known: x, z, "),
        (Scenario, {"quadrotor": {"thrust": 20}}, "Scenario.quadrotor has no field 'thrust'; known: thrust_min"),
        (Scenario, {"tolerance": 0.1}, "Scenario.tolerance must be a table of position, speed, angle, got 0.1"),
        (Scenario, {"hoops": [{"x": 1, "z": 1}]}, r"Scenario.hoops\[0\] lacks the field 'diameter'"),
        (Scenario, {"hoops": [1]}, r"Scenario.hoops\[0\] must be a table of x, z, diameter, angle, got 1"),
        (Scenario, {"hoops": {"x": 1}}, "Scenario.hoops must be a tuple of hoops, got"),
        (Scenario, {"kind": "distribution"}, "expected kind = 'scenario', got 'distribution'"),
        (Distribution, {"half_with": 3}, "Distribution has no field 'half_with'; .*did you mean 'half_width'"),
        (Distribution, {"tolerance": {"positon": 3}}, "Distribution.tolerance has no field 'positon'"),
        (Distribution, {"kind": "scenario"}, "expected kind = 'distribution', got 'scenario'"),
    ],
)  # fmt: skip
def test_wrong_fields_are_named_with_the_known_ones(kind, change, words):
    data = (TRACK if kind is Scenario else DISTRIBUTIONS["random-hoops"]).to_dict()
    with pytest.raises(ValueError, match=words):
        kind.from_dict(data | change)


def test_a_missing_field_and_a_thing_that_is_no_table_are_named():
    with pytest.raises(ValueError, match="Scenario lacks the field 'goal'"):
        Scenario.from_dict({"name": "x", "start": [0, 0]})
    with pytest.raises(ValueError, match="a distribution must be a table of its fields"):
        Distribution.from_dict([])
