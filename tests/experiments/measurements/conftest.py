"""The measurement of the solvers at small size, which runs once for all tests."""

import json

import joblib
import pytest
from rich.progress import Progress

from experiments.measurements import batches, sections
from experiments.measurements.sections import measure
from experiments.measurements.solvers import SECTIONS


@pytest.fixture(scope="session")
def results(tmp_path_factory):
    """The content of the results file, with all sections."""
    out = tmp_path_factory.mktemp("solvers") / "solvers.json"
    with joblib.parallel_config(backend="threading"), pytest.MonkeyPatch.context() as patch, Progress() as bar:
        patch.setattr(sections, "PROCESSES", 1)
        patch.setattr(batches, "JOBS", 1)
        measure(SECTIONS, out, smoke=True, command="flatquad measure solvers --quick", bar=bar)
    return json.loads(out.read_text())
