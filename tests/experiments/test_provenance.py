"""Provenance of results, and results files that cannot be read."""

import json
from importlib.metadata import version

import pytest

from agents.evaluation import versions
from experiments import provenance as module
from experiments.files import SCHEMA, read_json, write_json
from experiments.provenance import commit, processor, provenance


def test_results_say_command_versions_machine_and_commit():
    words = provenance("flatquad benchmark")
    assert words["command"] == "flatquad benchmark"
    assert words["schema"] == SCHEMA
    assert words["machine"]["cores"] >= 1
    assert {"flatgym", "torch", "python"} <= words["versions"].keys()
    assert json.loads(json.dumps(words)) == words


def test_outside_a_clone_there_is_no_commit(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "ROOT", tmp_path)
    assert commit() is None


def test_a_system_that_does_not_name_its_processor_names_its_kind(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "CPU_INFO", tmp_path / "missing")
    assert processor()


def test_what_was_written_is_read(tmp_path):
    path = tmp_path / "cell.json"
    assert read_json(path) is None
    write_json(path, {"schema": SCHEMA, "steps": [1, None]})
    assert read_json(path) == {"schema": SCHEMA, "steps": [1, None]}


@pytest.mark.parametrize("text", ['{"schema": 1, "st', "[]", '{"schema": 0}', "\x00\x00", ""])
def test_an_unreadable_file_is_moved_aside_and_named(tmp_path, capsys, text):
    path = tmp_path / "cell.json"
    for number in ("", "-2"):
        path.write_text(text)
        assert read_json(path) is None
        assert not path.exists()
        assert (tmp_path / f"cell.json.set-aside{number}").read_text() == text
        assert f"moved aside to cell.json.set-aside{number}" in capsys.readouterr().err


def test_packages_of_extras_are_recorded_where_they_are_installed(monkeypatch):
    assert versions.versions()["jax"] == version("jax")
    monkeypatch.setattr(versions, "OPTIONAL", ("no-such-package",))
    assert set(versions.versions()) == {"python", *versions.PACKAGES}
