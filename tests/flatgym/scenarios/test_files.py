"""Files of scenarios: what is written reads back, and what is damaged or doubtful is refused with the file's name."""

import json
import math
from dataclasses import replace
from pathlib import Path

import gymnasium as gym
import jsonschema
import pytest
from hypothesis import given
from hypothesis import strategies as st

import flatgym
from flatgym import DISTRIBUTIONS, SCENARIOS, Distribution, Hoop, Quadrotor, Scenario, Tolerance
from flatgym.scenarios import catalogue
from flatgym.scenarios.files import SUFFIXES, load, to_text
from flatgym.scenarios.schema import schema

TRACK = Scenario("own", (0, 1), (6, 1), hoops=(Hoop(2, 1.5, 0.5, 0.1), Hoop(4, 1, 0.5)), floor=0, ceiling=3)
TASKS = [*SCENARIOS.values(), *DISTRIBUTIONS.values(), TRACK, Distribution("near", half_width=3.0, hoops=(1, 2))]


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("task", TASKS, ids=lambda task: task.name)
def test_a_written_task_reads_back(task, suffix, tmp_path):
    path = tmp_path / f"track{suffix}"
    path.write_text(to_text(task, suffix), encoding="utf-8")
    assert load(path) == task
    assert catalogue.problem(str(path)) == catalogue.problem(path) == task


@given(st.text(st.characters(codec="utf-8"), min_size=1), st.floats(-1e6, 1e6), st.floats(1e-7, 1e6))
def test_any_name_and_number_survive_toml(tmp_path_factory, name, x, width):
    path = tmp_path_factory.mktemp("toml") / "track.toml"
    task = Scenario(name, (0, 0), (3, 0), hoops=(Hoop(x, 0, width),))
    path.write_bytes(to_text(task, ".toml").encode())
    assert load(path) == task


def test_a_written_file_explains_every_field():
    text = to_text(replace(TRACK, ceiling=None), ".toml")
    for word in ("[m]", "[s]", "[rad]", "[rad/s]", "[m/s^2]", "# ceiling = ...", "[[hoops]]  # 2", "[tolerance]"):
        assert word in text


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_defaults_may_be_left_out_and_the_name_is_that_of_the_file(suffix, tmp_path):
    path = tmp_path / f"my_track{suffix}"
    toml, dotted = "start = [0, 0]\ngoal = [5, 0]\n", '{"start": [0, 0], "goal": [5, 0]}'
    path.write_text(toml if suffix == ".toml" else "\ufeff" + dotted, encoding="utf-8")  # with a byte order mark
    assert load(path) == Scenario("my_track", (0, 0), (5, 0))


def test_a_file_flies_in_an_environment(tmp_path):
    path = tmp_path / "track.toml"
    path.write_text(to_text(TRACK, ".toml"), encoding="utf-8")
    for one in (str(path), path):
        assert gym.make("FlatQuad-v0", scenario=one).unwrapped.scenario == TRACK
        envs = gym.make_vec("FlatQuad-v0", num_envs=2, vectorization_mode="vector_entry_point", scenario=one)
        assert envs.unwrapped.config.problem == TRACK
    assert flatgym.scenario(str(path)) == TRACK


START = "start = [0, 1]\ngoal = [6, 1]\n"
HOOP = "[[hoops]]\nx = 2\nz = 1\ndiameter = 1\n"


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("t.toml", START + "ceilling = 3", "t.toml: Scenario has no field 'ceilling'; .*did you mean 'ceiling'"),
        ("t.toml", START + HOOP + "angel = 1", r"t.toml: Scenario.hoops\[0\] has no field 'angel'; .*mean 'angle'"),
        ("t.toml", START + HOOP + "angle = 90", "t.toml: Hoop.angle is in radians .* 90 degrees are 1.5708"),
        ("t.toml", START + "[tolerance]\nangle = 5.7", "t.toml: Tolerance.angle is in radians"),
        ("t.toml", START + HOOP + HOOP, r"t.toml: Scenario.hoops\[1\] repeats Scenario.hoops\[0\]: .*; leave one out"),
        ("t.toml", START + "floor = 2", "t.toml: Scenario.start lies at z = 1.0 m, below the floor at 2.0 m"),
        ("t.toml", START + "ceiling = 0.5", "t.toml: Scenario.start lies at z = 1.0 m, above the ceiling at 0.5 m"),
        ("t.toml", START + "[quadrotor]\nthrust_max = 5", "t.toml: .*cannot hover"),
        ("t.toml", START + "start = [1, 1]\nfloor = 0", r"t.toml: Cannot overwrite a value \(at line 3, column 15\)"),
        ("t.toml", START + "floor = \ndt = 1", r"t.toml: .*\(at line 3, column 9\)"),
        ("t.toml", START + "[tolerance\nangle = 1", r"t.toml: .*\(at line 3, column 11\)"),
        ("t.toml", "kind = 'senario'\n" + START, "t.toml: unknown kind 'senario'; .*did you mean 'scenario'"),
        ("t.toml", "kind = 'distribution'\nhoop = [1, 2]", "t.toml: Distribution has no field 'hoop'; .*'hoops'"),
        ("t.toml", "kind = 'distribution'\nturn = 90", "t.toml: Distribution.turn must lie within half a turn, pi"),
        ("t.toml", "goal = [6, 1]", "t.toml: Scenario lacks the field 'start'"),
        ("t.toml", START + "dt = nan", "t.toml: Scenario.dt must be finite, got nan"),
        ("t.json", '{"start": [0, 0],\n "goal": [5 0]}', "t.json: .*line 2 column 13"),
        ("t.json", '{"start": [0, 0], "start": [0, 1]}', "t.json: the field 'start' is given twice"),
        ("t.json", "[1, 2]", "t.json: a scenario must be a table of its fields, got"),
        ("t.json", "[" * 100_000, "t.json: .*recursion"),
        ("t.json", '{"start": [0, 0], "goal": [1e999, 0]}', r"t.json: Scenario.goal\[0\] must be finite, got inf"),
    ],
)
def test_a_wrong_file_is_refused_with_its_name_and_the_place(name, text, words, tmp_path):
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ValueError, match=words):
        load(path)


def test_files_that_are_missing_binary_or_of_another_kind_are_named(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ValueError, match=r"there is no file my\.toml; `flatquad init my\.toml` writes an example"):
        flatgym.scenario("my.toml")
    (tmp_path / "bad.toml").write_bytes(b"name = '\xff'")
    with pytest.raises(ValueError, match=r"bad\.toml is no UTF-8 text"):
        flatgym.scenario("bad.toml")
    with pytest.raises(ValueError, match=r"track.yaml: a scenario's file ends in .toml or .json"):
        load("track.yaml")
    (tmp_path / "mine.toml").write_text(START, encoding="utf-8")
    with pytest.raises(ValueError, match=r"unknown scenario 'mine'; .*did you mean 'mine.toml'"):
        flatgym.scenario("mine")


@pytest.mark.parametrize("name", ["start", "goal"])
def test_a_start_or_goal_inside_a_rim_is_refused(name, tmp_path):
    hoop = Hoop(3, 1, 1, math.pi / 2)  # rims at x = 2.5 and 3.5
    points = {"start": (0.0, 1.0), "goal": (6.0, 1.0)} | {name: (2.4, 1.05)}
    body = Quadrotor(radius=0.2)
    path = tmp_path / "t.json"
    path.write_text(Scenario("t", **points, hoops=(hoop,), quadrotor=body).to_json(), encoding="utf-8")
    with pytest.raises(ValueError, match=rf"Scenario.{name} .* lies 0.112 m from a rim of Scenario.hoops\[0\]"):
        load(path)
    path.write_text(Scenario("t", **points, hoops=(hoop,), quadrotor=Quadrotor(radius=0.1)).to_json())
    assert load(path).quadrotor.radius == 0.1


def test_a_hoop_may_be_passed_twice_with_another_between(tmp_path):
    there, back = Hoop(2, 1, 1), Hoop(3, 1, 1, math.pi)
    path = tmp_path / "t.json"
    path.write_text(replace(TRACK, hoops=(there, back, there)).to_json(), encoding="utf-8")
    assert len(load(path).hoops) == 3


def test_a_sample_of_a_distribution_has_a_name():
    assert flatgym.scenario("random-hoops-3-0") == DISTRIBUTIONS["random-hoops"].scenario(3, 0)
    assert flatgym.scenario("random-track-3-12") == DISTRIBUTIONS["random-track"].scenario(3, 12)
    for name in ("random-hoops-3", "random-hoops-3-x", "slalom-3-0", "random-hoops-3-" + "9" * 30):
        with pytest.raises(ValueError, match="unknown scenario"):
            flatgym.scenario(name)


def test_texts_and_labels_tell_tasks_apart_by_content():
    other = replace(SCENARIOS["hoop"], hoops=(Hoop(2.5, 3.2, 0.5),))  # called hoop
    for task in (*TASKS, other, DISTRIBUTIONS["random-hoops"].scenario(3, 0)):
        assert catalogue.problem(catalogue.text(task)) == task
    assert catalogue.text("hoop") == catalogue.label("hoop") == "hoop"
    assert catalogue.label("random-hoops-3-0") == "random-hoops-3-0"
    assert catalogue.label(other) == f"hoop-{other.digest[:8]}"
    assert catalogue.label(replace(other, name="a/b ü")) == f"a-b-ü-{other.digest[:8]}"
    named = replace(DISTRIBUTIONS["random-goal"], half_width=5.0)
    assert catalogue.label(named) == f"random-goal-{named.digest[:8]}"


CHECK = jsonschema.Draft202012Validator(schema())


@pytest.mark.parametrize("task", TASKS, ids=lambda task: task.name)
def test_the_schema_accepts_every_task(task):
    CHECK.validate(task.to_dict())
    CHECK.validate(json.loads(to_text(task, ".json")))


@pytest.mark.parametrize(
    "change",
    [{"colour": 1}, {"goal": [1]}, {"hoops": [{"x": 1}]}, {"dt": "fast"}, {"kind": "distribution"}, {"floor": [0]}],
)
def test_the_schema_refuses_what_the_dataclass_refuses(change):
    data = TRACK.to_dict() | change
    assert not CHECK.is_valid(data)
    with pytest.raises(ValueError, match=r"\w"):
        catalogue.problem(json.dumps(data))


def test_the_schema_describes_every_field():
    for kind, described in schema()["$defs"].items():
        for name, field in described["properties"].items():
            assert name == "kind" or field["description"], (kind, name)
    units = schema()["$defs"]
    assert "[rad]" in units["Hoop"]["properties"]["angle"]["description"]
    assert "[m/s^2]" in units["Quadrotor"]["properties"]["gravity"]["description"]
    assert units["Tolerance"]["properties"]["speed"] == {
        "type": "number", "description": "maximum speed [m/s].", "default": Tolerance().speed,
    }  # fmt: skip


def test_the_published_schema_is_that_of_the_dataclasses():
    """To write it anew: json.dumps(schema(), indent=1)."""
    published = Path(__file__).parents[3] / "docs" / "scenario.schema.json"
    assert json.loads(published.read_text(encoding="utf-8")) == json.loads(json.dumps(schema()))


def test_the_file_in_the_documentation_can_be_read(tmp_path):
    page = (Path(__file__).parents[3] / "docs" / "extending.md").read_text(encoding="utf-8")
    path = tmp_path / "documented.toml"
    path.write_text(page.partition("```toml\n")[2].partition("```")[0], encoding="utf-8")
    found = load(path)
    assert (found.name, found.hoops[1], found.quadrotor.rate_max) == ("my_track", Hoop(5, 2.5, 0.8, 0.5), 8)
    assert load(path) == replace(found, dt=Scenario("x", (0, 0), (1, 0)).dt, time_limit=5.0)
    assert CHECK.is_valid(found.to_dict())
