"""`flatquad list`, `init` and `show`: files are written once, read back, drawn, and what is known of them is shown."""

import json
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest

from experiments.cli.problems import EXAMPLE, known_answers
from experiments.files import cache_folder
from experiments.play.session import Session
from flatgym import DISTRIBUTIONS, SCENARIOS, reference
from flatgym.scenarios.files import load
from optimal import fewest_steps
from optimal.store import Store
from tests.experiments.cli.shell import flatquad


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """A working directory and a cache that nobody shares."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setenv("COLUMNS", "100")
    return tmp_path


@pytest.mark.parametrize("name", ["my_track.toml", "my_track.json", "new/folder/my_track.toml"])
def test_init_writes_a_file_that_reads_back_and_is_never_replaced(monkeypatch, capsys, folder, name):
    status, out, err = flatquad(monkeypatch, capsys, "init", name)
    assert (status, out) == (0, "")
    assert f"flatquad show {name}" in err
    assert load(folder / name) == EXAMPLE
    (folder / name).write_text("mine")
    status, _, err = flatquad(monkeypatch, capsys, "init", name)
    assert status == 2
    assert "exists already and is not replaced" in err
    assert (folder / name).read_text() == "mine"


@pytest.mark.parametrize("source", ["slalom", "random-hoops-3-0", "random-track"])
def test_init_copies_any_task(monkeypatch, capsys, source):
    assert flatquad(monkeypatch, capsys, "init", "copy.toml", "--scenario", source)[0] == 0
    task = SCENARIOS.get(source) or DISTRIBUTIONS.get(source) or DISTRIBUTIONS["random-hoops"].scenario(3, 0)
    assert load("copy.toml") == replace(task, name="copy")
    assert load("copy.toml").digest == task.digest


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("init", "track.yaml"), "unknown ending '.yaml' of track.yaml; known: .toml, .json"),
        (("init", "track.toml", "--scenario", "slalm"), "did you mean 'slalom'"),
        (("show", "nothing.toml"), "there is no file nothing.toml; `flatquad init nothing.toml` writes an example"),
        (("show", "hoop", "--out", "hoop.gif"), "unknown ending '.gif' of hoop.gif; known: .svg, .png, .html"),
        (("solve", "random-goal.toml"), "there is no file random-goal.toml"),
    ],
)
def test_bad_arguments_are_named(monkeypatch, capsys, folder, arguments, words):
    status, out, err = flatquad(monkeypatch, capsys, *arguments)
    assert (status, out) == (2, "")
    assert words in err
    assert list(folder.iterdir()) == []


def test_show_prints_the_fields_with_units_and_every_hoop(monkeypatch, capsys):
    flatquad(monkeypatch, capsys, "init", "my_track.toml")
    status, out, _ = flatquad(monkeypatch, capsys, "show", "my_track.toml")
    assert status == 0
    lines = [" ".join(line.split()) for line in out.splitlines()]
    for line in (f"my_track-{EXAMPLE.digest[:8]}", "goal [m] 8, 1", "quadrotor thrust_max [m/s^2] 20", "ceiling [m] 4",
                 "2 5 2.5 0.8 0.5 28.65 2.693", "K* [steps] unknown; run `flatquad solve --steps`"):  # fmt: skip
        assert line in lines


def test_show_knows_what_is_shipped(monkeypatch, capsys):
    _, out, _ = flatquad(monkeypatch, capsys, "show", "slalom", "--json")
    (row,) = json.loads(out)
    best = reference("slalom")
    assert (row["k_star"], row["k_lower_bound"], row["time_s"]) == (best.k_star, best.k_lower_bound, best.time)
    assert (row["label"], row["digest"]) == ("slalom", SCENARIOS["slalom"].digest)
    assert load_json_content(row) == SCENARIOS["slalom"]
    _, out, _ = flatquad(monkeypatch, capsys, "show", "random-track")
    assert "K*" not in out


def load_json_content(row):
    """Return the task in the JSON of `flatquad show`."""
    return type(SCENARIOS["hoop"]).from_dict(row["content"])


def test_show_knows_what_was_solved_here_under_any_name(monkeypatch, capsys, folder):
    short = replace(EXAMPLE, name="short", hoops=(), goal=(1.5, 1.0))
    assert set(known_answers(short).values()) == {None}
    best = fewest_steps(short, time_budget=0.0)
    Store(cache_folder(), {"ask": "a test"}).write(best)
    (folder / "again.json").write_text(replace(short, name="again").to_json())
    _, out, _ = flatquad(monkeypatch, capsys, "show", "again.json", "--out", "again.svg")
    assert f"K* [steps] {best.steps}" in " ".join(out.split())
    assert f"flown in {best.steps} steps" in (folder / "again.svg").read_text()


@pytest.mark.parametrize("name", ["hoop", "ground-6", "random-hoops-3-0", "random-track"])
def test_pictures_are_drawn_with_every_hoop(monkeypatch, capsys, folder, name):
    for ending in ("svg", "html"):
        assert flatquad(monkeypatch, capsys, "show", name, "--out", f"picture.{ending}")[0] == 0
    drawing = ElementTree.parse(folder / "picture.svg").getroot()
    task = SCENARIOS.get(name) or DISTRIBUTIONS["random-hoops" if "hoops" in name else "random-track"].scenario(
        *((3, 0) if "hoops" in name else (0, 0))
    )
    texts = [element.text for element in drawing.iter() if element.tag.endswith("text")]
    assert texts[1:] == [f"{i + 1}" for i in range(len(task.hoops))]
    assert (folder / "picture.html").read_text().startswith("<!doctype html>")


def test_a_picture_of_the_environment(monkeypatch, capsys, folder):
    assert flatquad(monkeypatch, capsys, "show", "hoop", "--out", "hoop.png")[0] == 0
    assert (folder / "hoop.png").read_bytes().startswith(b"\x89PNG")


def test_what_solve_finds_is_kept_for_the_later_commands(monkeypatch, capsys, folder):
    (folder / "short.toml").write_text("start = [0, 0]\ngoal = [1.5, 0]\n")
    (folder / "cache").write_text("a file, so that no folder can be made")
    status, _, err = flatquad(monkeypatch, capsys, "solve", "short.toml", "--steps", "--proof-time", "1")
    assert status == 0
    assert "not kept for later commands" in err
    (folder / "cache").unlink()
    _, out, _ = flatquad(monkeypatch, capsys, "solve", "short.toml", "--steps", "--proof-time", "1", "--json")
    (solved,) = json.loads(out)
    _, out, _ = flatquad(monkeypatch, capsys, "show", "short.toml", "--json")
    (known,) = json.loads(out)
    same = ("time_s", "lower_bound_s", "k_star", "k_lower_bound", "proven")
    assert {key: known[key] for key in same} == {key: solved[key] for key in same}
    task = load("short.toml")
    session = Session("short.toml")
    assert session.reference.k_star == known["k_star"]
    np.testing.assert_allclose(session.ghost[-1][0:2], task.goal, atol=task.tolerance.position)
