"""Scores name the policy that flew them: the shipped one, or an earlier one."""

import json

import pytest

from agents.policies.archive import PRETRAINED
from agents.policies.fingerprint import fingerprint
from experiments.benchmark.leaderboard import Leaderboard
from experiments.benchmark.shipped import EARLIER, is_shipped, shown_name
from experiments.files import published
from experiments.publishing.learners import scores

CARD = json.loads((PRETRAINED / "hoop.json").read_text(encoding="utf-8"))["score"]
COST = {"env_steps": CARD["env_steps"], "training_s": CARD["wall_time_s"]}
CELL = {"problem": "hoop", "agent": "pretrained", "seed": 0, "episodes": {"nominal": {}}} | COST
OTHER = fingerprint(PRETRAINED / "climb.zip")
PUBLISHED = [
    cell
    for name in ("benchmark.json", "benchmark-full.json", "learners.json")
    for cell in published(name)["cells"]
    if cell["agent"] == "pretrained"
]


@pytest.mark.parametrize(
    ("change", "shipped"),
    [
        ({"fingerprint": fingerprint(PRETRAINED / "hoop.zip")}, True),
        ({"fingerprint": fingerprint(PRETRAINED / "hoop.zip"), "env_steps": 1}, True),
        ({"fingerprint": OTHER}, False),
        ({"fingerprint": OTHER, "problem": "climb"}, True),
        ({}, True),
        ({"fingerprint": None}, True),
        ({"env_steps": CARD["env_steps"] + 1}, False),
        ({"training_s": CARD["wall_time_s"] + 0.1}, False),
        ({"problem": "a track without a policy"}, False),
    ],
)
def test_a_fingerprint_decides_and_without_one_the_training_cost(change, shipped):
    assert is_shipped(CELL | change) == shipped
    assert shown_name("pretrained", [CELL | change]) == ("pretrained" if shipped else EARLIER)
    assert shown_name("pd", [CELL | change]) == "cascaded PD"


def test_failed_runs_of_a_pretrained_policy_keep_its_name():
    failed = {"problem": "hoop", "agent": "pretrained", "seed": 0, "episodes": {}, "error": "ValueError: broken"}
    assert shown_name("pretrained", [failed]) == "pretrained"


def test_published_rows_are_of_shipped_policies():
    assert PUBLISHED
    for cell in PUBLISHED:
        assert cell["fingerprint"]
        assert is_shipped(cell), f"{cell['problem']}: run `flatquad benchmark` again, or ship its policy"


def test_tables_mark_rows_of_earlier_policies():
    results, earlier = published("benchmark.json"), {"hoop"}
    for cell in results["cells"]:
        if (cell["problem"], cell["agent"]) == ("hoop", "pretrained"):
            cell["fingerprint"] = OTHER
    lines = [line.split(" | ") for line in scores(results).splitlines()]
    assert {line[0].strip("| `") for line in lines if EARLIER in line} == earlier
    board = Leaderboard.of(results)
    assert {row.problem for row in board.rows if row.name == EARLIER} == earlier
    assert {score.problem for score in board.scores if score.name == EARLIER} == earlier
