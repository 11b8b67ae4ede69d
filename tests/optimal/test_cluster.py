"""A batch on a Ray cluster: a lost machine loses no task, answers are those of one machine, addresses are checked."""

import json
import os
import socket
import subprocess
import sys
from pathlib import Path

import pytest

import optimal
from optimal import solve_many
from optimal.cluster import connect

SETTINGS = {
    "RAY_AUTH_MODE": "disabled",
    "RAY_USAGE_STATS_ENABLED": "0",
    "PYTHONPATH": str(Path(optimal.__file__).parents[1]),
}
NAMES = ("horizontal-3", "diagonal", "drop", "horizontal-6", "climb", "horizontal-9")

TWO_NODES = """
import json, os, sys, time
from functools import partial
from pathlib import Path
import ray
from ray.cluster_utils import Cluster
import optimal
from flatgym import SCENARIOS
from optimal.parallel import unordered

folder, names = Path(sys.argv[1]), sys.argv[2:]
small = {"num_cpus": 1, "object_store_memory": 80_000_000, "include_dashboard": False}
cluster = Cluster(initialize_head=True, head_node_args=small)
lost = cluster.add_node(**small)
os.environ["RAY_ADDRESS"] = cluster.address

def solved(place, scenario):  # on the machine that is lost no task ever ends
    here = ray.get_runtime_context().get_node_id()
    (folder / f"{scenario.name} {here}").touch()
    while here == place:
        time.sleep(0.1)
    return optimal.solve(scenario, windings=(0,), max_gap=None)

times = {}
try:
    for answer in unordered(partial(solved, lost.node_id), [SCENARIOS[name] for name in names], -1, "ray"):
        times[answer.scenario.name] = answer.time
        if len(times) == 1:
            while not list(folder.glob(f"* {lost.node_id}")):
                time.sleep(0.05)
            cluster.remove_node(lost, allow_graceful=False)
    (again,) = optimal.solve_many(names[:1], backend="ray", windings=(0,))
    errors = []
    for function in (lambda _: 1 / 0, lambda _: os._exit(3)):
        try:
            list(unordered(function, [SCENARIOS["hoop"]], 1, "ray"))
        except (ZeroDivisionError, RuntimeError) as error:
            errors.append(str(error))
    (folder / "answers.json").write_text(json.dumps({"times": times, "again": again.time, "errors": errors}))
finally:
    ray.shutdown()
    cluster.shutdown()
"""


def test_a_lost_machine_loses_nothing_and_answers_are_those_of_one_machine(tmp_path):
    run_script(TWO_NODES, str(tmp_path), *NAMES)
    run = json.loads((tmp_path / "answers.json").read_text())  # not from standard output, which Ray's threads share
    here = {answer.scenario.name: answer.time for answer in solve_many(NAMES, jobs=1, windings=(0,))}
    assert run["times"] == here
    assert run["again"] == here[NAMES[0]]
    assert "division by zero" in run["errors"][0]
    assert "the cluster could not compute Scenario(name='hoop'" in run["errors"][1]
    begun = [path.name.split() for path in tmp_path.glob("* *")]
    places = {place for _, place in begun}
    assert len(places) == 2, "both machines worked"
    assert len(begun) > len(NAMES), "what ran on the lost machine ran again"


def run_script(script, *arguments):
    """Run a script with Ray in a process of its own."""
    settings = {key: value for key, value in os.environ.items() if key != "RAY_ADDRESS"} | SETTINGS
    run = subprocess.run(
        [sys.executable, "-c", script, *arguments], env=settings, capture_output=True, text=True, timeout=120
    )
    assert run.returncode == 0, run.stderr


@pytest.mark.parametrize("form", ["127.0.0.1:{}", "ray://127.0.0.1:{}", "localhost:{}"])
def test_an_address_where_no_cluster_answers_is_named(monkeypatch, form):
    with socket.socket() as closed:
        closed.bind(("127.0.0.1", 0))
        address = form.format(closed.getsockname()[1])
    monkeypatch.setenv("RAY_ADDRESS", address)
    with pytest.raises(ConnectionError, match=f"no Ray cluster answers at RAY_ADDRESS={address} .*`ray start --head`"):
        connect()


def test_a_missing_ray_is_reported_with_its_installation(monkeypatch):
    monkeypatch.setattr("flatgym.extras.find_spec", lambda _: None)
    with pytest.raises(ImportError, match=r"ray not installed; run: pip install 'flatgym\[cluster\]'"):
        solve_many(["horizontal-3"], backend="ray")
