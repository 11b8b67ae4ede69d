"""Results are written whole or not at all, and are plain JSON."""

import json
import math
import re

import numpy as np
import pytest

from experiments import files
from experiments.files import SCHEMA, check_output, plain, read_json, write_json
from flatgym.files import write_text


def test_a_failed_write_leaves_the_old_file(tmp_path):
    path = tmp_path / "deep" / "results.json"
    write_json(path, {"a": 1})
    with pytest.raises(TypeError):
        write_json(path, {"a": object()})
    with pytest.raises(UnicodeEncodeError):
        write_text(path, "\ud800")
    assert json.loads(path.read_text()) == {"a": 1}
    assert [p.name for p in path.parent.iterdir()] == ["results.json"]


def test_plain_data():
    data = {1: np.float32(0.5), "b": (math.inf, math.nan, 2.0), "c": np.arange(3), "d": [None, True, "x"]}
    assert plain(data) == {"1": 0.5, "b": [None, None, 2.0], "c": [0, 1, 2], "d": [None, True, "x"]}


def test_a_file_of_another_schema_is_refused_with_the_way_out(tmp_path, monkeypatch, capsys):
    old = {"schema": SCHEMA - 1, "command": "flatquad paper", "rows": []}
    reason = f"has schema {SCHEMA - 1}, this version reads {SCHEMA}: run the command again, `flatquad paper`"
    write_json(tmp_path / "paper.json", old)
    monkeypatch.setattr(files, "PUBLISHED", tmp_path)
    with pytest.raises(ValueError, match=re.escape(f"paper.json {reason}")):
        files.published("paper.json")
    assert read_json(tmp_path / "paper.json") is None
    assert f"{reason}; moved aside to paper.json.set-aside" in capsys.readouterr().err
    assert json.loads((tmp_path / "paper.json.set-aside").read_text()) == old


def test_an_output_path_is_checked_and_its_folder_made(tmp_path, monkeypatch):
    path = tmp_path / "new" / "deep" / "flight.csv"
    assert check_output(str(path), (".csv", ".json")) == path
    assert path.parent.is_dir()
    assert not path.exists()
    path.write_text("old")
    assert check_output(path) == path
    assert path.read_text() == "old"
    for ending, hint in ((".xlsx", ""), (".jsn", "; did you mean flight.json?"), ("", "")):
        nowhere = tmp_path / "never" / f"flight{ending}"
        reason = f"unknown ending {ending!r} of flight{ending}; known: .csv, .json{hint}"
        with pytest.raises(ValueError, match=re.escape(reason)):
            check_output(nowhere, (".csv", ".json"))
        assert not nowhere.parent.exists()
    with pytest.raises(IsADirectoryError, match="is a folder; name a file in it"):
        check_output(path.parent)
    with pytest.raises(OSError, match=r"flight\.csv/x\.csv cannot be made: "):
        check_output(path / "x.csv")
    monkeypatch.setattr(files.os, "access", lambda *_: False)
    with pytest.raises(PermissionError, match="cannot be written: no permission"):
        check_output(path)
