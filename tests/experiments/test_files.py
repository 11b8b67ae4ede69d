"""Results are written whole or not at all, and are plain JSON."""

import json
import math

import numpy as np
import pytest

from experiments.files import plain, write_json
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
