"""The README runs, and its numbers are those of the committed results."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from experiments import files
from experiments.publishing import publish
from flatgym import OUTCOMES, SCENARIOS
from flatgym.task.rollout import fly_actions

TEXT = (files.ROOT / "README.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"```python\n(.*?)```", TEXT, re.DOTALL)


@pytest.mark.parametrize("code", BLOCKS, ids=[re.findall(r"import (\w+)", block)[-1] for block in BLOCKS])
def test_every_code_block_runs(code, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    exec(compile(code, "README.md", "exec"), {})


def test_tables_are_those_of_the_results():
    assert publish.filled(TEXT) == TEXT


@pytest.mark.parametrize("name", ["scores", "environments"])
def test_a_table_without_its_place_is_named(name):
    for text in (TEXT.replace(f"<!-- {name} -->", ""), TEXT + f"<!-- {name} -->\n<!-- /{name} -->"):
        with pytest.raises(ValueError, match=f"README.md must hold one block <!-- {name} -->"):
            publish.filled(text)


def test_every_picture_is_there():
    pictures = re.findall(r"!\[[^]]+\]\(([^)]+)\)", TEXT)
    assert pictures
    assert all((Path(files.ROOT) / picture).stat().st_size > 1000 for picture in pictures)


@pytest.mark.parametrize("name", ["benchmark.json", "learners.json"])
def test_published_flights_replay_to_their_scores(name):
    for cell in json.loads((files.PUBLISHED / name).read_text(encoding="utf-8"))["cells"]:
        if "actions" not in cell:
            continue
        flown = fly_actions(SCENARIOS[cell["problem"]], np.array(cell["actions"], dtype=np.float32))
        calm = cell["flights"]["calm"]
        assert [OUTCOMES[flown[-1].outcome[0]]] == list(calm["outcomes"])
        if calm["steps"][0] is not None:
            assert len(flown) - 1 == calm["steps"][0]


def test_results_of_another_version_are_refused(tmp_path, monkeypatch):
    (tmp_path / "paper.json").write_text('{"schema": 0, "rows": []}')
    monkeypatch.setattr(files, "PUBLISHED", tmp_path)
    with pytest.raises(ValueError, match=r"paper\.json has schema 0, this version reads 1"):
        files.published("paper.json")
