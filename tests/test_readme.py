"""README and docs run: their Python blocks, their commands, their tables and their pictures."""

import json
import re
import shlex
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
import typer

from experiments import files
from experiments.cli.app import app
from experiments.publishing import publish
from flatgym import OUTCOMES, SCENARIOS
from flatgym.task.rollout import fly_actions

PAGES = {page.relative_to(files.ROOT).as_posix(): page for page in [*publish.pages(), files.ROOT / "CONTRIBUTING.md"]}
TEXTS = {name: page.read_text(encoding="utf-8") for name, page in PAGES.items()}
README = "README.md"


def code(language):
    """Return the code blocks of a language by page, for pages that have any."""
    fence = re.compile(rf"^```{language}\n(.*?)^```", re.DOTALL | re.MULTILINE)
    found = {
        # Blank lines in front, so that a traceback names the line of the page.
        name: ["\n" * text.count("\n", 0, block.start(1)) + block[1] for block in fence.finditer(text)]
        for name, text in TEXTS.items()
    }
    return {name: blocks for name, blocks in found.items() if blocks}


PYTHON, SHELL = code("python"), code("sh")
COMMANDS = sorted(  # without comments and variables
    {
        re.sub(r"^([A-Z_]+=\S+ )+", "", line.partition("  #")[0].strip())
        for blocks in SHELL.values()
        for text in blocks
        for line in text.splitlines()
    }
)


@pytest.mark.parametrize("name", PYTHON)
def test_the_python_blocks_of_a_page_run_in_order(name, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    namespace = {"__name__": "page"}
    for block in PYTHON[name]:
        exec(compile(block, name, "exec"), namespace)


def parsed(command, words):
    """Parse the arguments of a command of `flatquad` as its command line does, without running it."""
    context = command.make_context(command.name, list(words))
    if hasattr(command, "resolve_command"):
        _, inner, rest = command.resolve_command(context, [*context._protected_args, *context.args])
        return parsed(inner, rest)
    return context.params


@pytest.mark.parametrize("command", [line for line in COMMANDS if line.startswith("flatquad ")])
def test_commands_of_flatquad_exist_with_their_options(command):
    assert parsed(typer.main.get_command(app), shlex.split(command)[1:]) is not None


@pytest.mark.parametrize("words", ["frobnicate", "solve hoop --fast", "train", "solve hoop --dt soon"])
def test_a_command_that_does_not_exist_would_be_noticed(words):
    with pytest.raises(Exception, match=r"No such|Missing|valid number"):
        parsed(typer.main.get_command(app), words.split())


def test_the_other_commands_exist():
    from ray.scripts.scripts import cli as ray_command

    targets = set(re.findall(r"^([a-z]+):", (files.ROOT / "Makefile").read_text(encoding="utf-8"), re.M))
    for command in COMMANDS:
        words = [word for word in command.split() if "=" not in word]
        if not words or words[0] in ("flatquad", "pip"):
            continue
        if words[0] == "ray":
            assert parsed(ray_command, shlex.split(command)[1:]) is not None
        elif words[0] == "make":
            assert set(words[1:]) <= targets, command
        else:
            assert words[:2] == ["python", "-m"], command
            assert find_spec(words[2]), command


def test_extras_named_for_pip_exist():
    from tomllib import loads

    known = loads((files.ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]
    named = {extra for text in TEXTS.values() for part in re.findall(r"(?:flatgym|\.)\[([\w,]+)\]'", text)
             for extra in part.split(",")}  # fmt: skip
    assert named <= set(known)
    assert {"fast", "render", "optimal", "agents"} <= named


def test_every_command_of_flatquad_is_on_the_page_of_commands():
    page = TEXTS["docs/command-line.md"]
    for name in typer.main.get_command(app).commands:
        assert f"\n## {name}\n" in page, name
        assert re.search(rf"^flatquad {name}\b", page, re.M), name


def test_readme_is_short_and_its_example_too():
    assert len(TEXTS[README].splitlines()) <= 150
    assert [len(block.strip().splitlines()) <= 15 for block in PYTHON[README]] == [True]


@pytest.mark.parametrize("page", publish.pages(), ids=lambda page: page.name)
def test_generated_blocks_are_those_of_the_results(page):
    text = page.read_text(encoding="utf-8")
    assert publish.filled(text, page) == text


def test_every_block_stands_on_some_page():
    assert {name for text in TEXTS.values() for name in publish.blocks_in(text)} == set(publish.BLOCKS)


def test_unknown_blocks_and_lone_markers_are_refused():
    page = PAGES[README]
    with pytest.raises(ValueError, match=r"README.md: unknown block 'nothing'; known: flight, "):
        publish.filled("<!-- nothing -->\n<!-- /nothing -->", page)
    for lone in ("<!-- scores -->", "<!-- /scores -->"):
        with pytest.raises(ValueError, match=f"README.md: {lone} has no pair"):
            publish.filled(f"{lone}\n", page)


def test_links_to_pictures_are_relative_to_the_page():
    for page, up in ((PAGES[README], ""), (PAGES["docs/index.md"], "../")):
        assert f"]({up}experiments/results/published/hoop.gif)" in publish.filled(
            "<!-- flight -->\n<!-- /flight -->", page
        )


@pytest.mark.parametrize("name", PAGES)
def test_files_that_a_page_links_to_are_there(name):
    links = re.findall(r"\]\((?!https?:|#)([^)#]+)", re.sub(r"^```.*?^```", "", TEXTS[name], flags=re.DOTALL | re.M))
    generated = {"contributing.md", "changelog.md"} | {link for link in links if link.startswith("api/")}
    for link in links:
        assert link in generated or (PAGES[name].parent / link).stat().st_size > 100, link


@pytest.mark.parametrize("name", ["benchmark.json", "benchmark-full.json", "learners.json"])
def test_published_flights_replay_to_their_scores(name):
    for cell in json.loads((files.PUBLISHED / name).read_text(encoding="utf-8"))["cells"]:
        if "actions" not in cell:
            continue
        flown = fly_actions(SCENARIOS[cell["problem"]], np.array(cell["actions"], dtype=np.float32))
        nominal = cell["episodes"]["nominal"]
        assert [OUTCOMES[flown[-1].outcome[0]]] == list(nominal["outcomes"])
        if nominal["steps"][0] is not None:
            assert len(flown) - 1 == nominal["steps"][0]


def test_results_of_another_version_are_refused(tmp_path, monkeypatch):
    (tmp_path / "paper.json").write_text('{"schema": 0, "rows": []}')
    monkeypatch.setattr(files, "PUBLISHED", Path(tmp_path))
    with pytest.raises(ValueError, match=rf"paper\.json has schema 0, this version reads {files.SCHEMA}"):
        files.published("paper.json")
