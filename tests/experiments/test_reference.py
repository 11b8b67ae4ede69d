"""The table of what is known is computed anew as it stands, and refuses to disagree with the published K*."""

import json

import numpy as np
import pytest

from experiments import reference as writer
from flatgym.reference import FILE, SCHEMA, reference


def test_a_row_is_computed_as_it_stands(tmp_path):
    writer.write(tmp_path / FILE, ["horizontal-3"])
    written = json.loads((tmp_path / FILE).read_text())
    (row,) = written["references"]
    assert written["schema"] == SCHEMA
    assert np.array_equal(np.array(row["actions"], dtype=np.float32), reference("horizontal-3").actions)


def test_another_k_star_is_refused(monkeypatch):
    wrong = {"scenario": "horizontal-3", "k_star": 43}
    monkeypatch.setattr(writer, "_published", lambda *_: wrong)
    with pytest.raises(
        ValueError, match=r"horizontal-3: a flight in 44 steps was found, but solvers\.json has K\* = 43"
    ):
        writer.row("horizontal-3")


def test_float32_numbers_read_back_exactly(generator):
    values = np.concatenate([generator.uniform(-1, 1, (500, 2)), [[0.0, -0.0], [1e-30, 1.0]]]).astype(np.float32)
    again = np.array(json.loads(json.dumps(writer.shortest(values))), dtype=np.float32)
    assert np.array_equal(again.view(np.uint32), values.view(np.uint32))
