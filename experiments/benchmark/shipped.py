"""Whether the pretrained policy of a score is the one that comes with the package today.

A cell holds the fingerprint of its policy. Cells of earlier runs hold none; their training cost is compared with that
on the card beside the policy.
"""

from __future__ import annotations

import json
from collections.abc import Iterable

from agents.policies.archive import PRETRAINED
from agents.policies.fingerprint import fingerprint
from experiments.benchmark.agents import display_name
from experiments.files import Row

EARLIER = "pretrained, an earlier policy"
"""Display name of pretrained policies that are no longer shipped."""


def is_shipped(cell: Row) -> bool:
    """Return whether the pretrained policy that flew a cell is the one in the package."""
    policy, card = (PRETRAINED / f"{cell['problem']}{suffix}" for suffix in (".zip", ".json"))
    if not policy.exists():
        return False
    if cell.get("fingerprint"):
        return bool(cell["fingerprint"] == fingerprint(policy))
    score = json.loads(card.read_text(encoding="utf-8"))["score"]
    return (cell["env_steps"], cell["training_s"]) == (score["env_steps"] or 0, score["wall_time_s"])


def shown_name(agent: str, cells: Iterable[Row]) -> str:
    """Return the display name of an agent with these cells of one problem; of an earlier pretrained policy, EARLIER."""
    flown = [cell for cell in cells if cell["episodes"]]
    return EARLIER if agent == "pretrained" and not all(map(is_shipped, flown)) else display_name(agent)
