"""TODO experiments/benchmark/suite.py."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from agents import policies
from experiments.files import Row, read_json
from experiments.recipes.lesson import FULL, Budget
from experiments.recipes.registry import EXPERTS, LEARNERS, ONLY_SCENARIOS
from flatgym import DISTRIBUTIONS, SCENARIOS

FIRST = ("bc", "bc-ppo")
"""The second begins with what the first gives."""
ALL = (*LEARNERS, *EXPERTS)
SEEDS = 3
TRIAL = "trial"
"""Name of a suite of small sizes, whose numbers mean nothing."""
TIMEOUT = 300.0
"""How long the flights of a policy that is not ours may take [s]."""


@dataclass(frozen=True)
class Suite:
    """What a benchmark consists of.

    Attributes:
        name: what to call it.
        agents: who flies each problem, by the problem's name.
        seeds: trainings of each learner.
        sizes: how much of everything.
        prologue: whether scenarios are solved, and demonstrations of them recorded, before anything is learnt.
        policies: further agents, each a name and what `agents.load_policy` is to load; they fly every problem.
        timeout: how long the flights of one of these may take [s].
    """

    name: str
    agents: Mapping[str, Sequence[str]]
    seeds: int = SEEDS
    sizes: Budget = FULL
    preparation: bool = False
    policies: Mapping[str, str] = field(default_factory=dict)
    timeout: float = TIMEOUT

    def cells(self, only: Sequence[str] = ()) -> list[Cell]:
        """Return the cells in the order of the tables.

        Args:
            only: "problem" or "problem/agent", those asked for; nothing for all. What one begins with comes with it.

        Raises:
            ValueError: for what there is not, listing what there is.
        """
        found = [
            Cell(problem, agent, seed)
            for problem, agents in self.agents.items()
            for agent in (*agents, *self.policies)
            for seed in range(self.seeds if agent in LEARNERS else 1)
        ]
        names = {name for cell in found for name in (cell.problem, f"{cell.problem}/{cell.agent}")}
        if unknown := sorted(set(only) - names):
            raise ValueError(f"unknown cells {', '.join(unknown)}; known: {', '.join(sorted(names))}")
        first, then = FIRST
        wanted = set(only) | {name.replace(then, first) for name in only if name.endswith(then)}
        return [cell for cell in found if not only or {cell.problem, f"{cell.problem}/{cell.agent}"} & wanted]


@dataclass(frozen=True)
class Cell:
    """One file of a benchmark."""

    problem: str
    agent: str
    seed: int

    def path(self, folder: Path) -> Path:
        """Return its file."""
        return folder / f"{self.problem}-{self.agent}-{self.seed}.json"

    def read(self, folder: Path) -> Row | None:
        """Return what stands in its file; None where there is none that can be read."""
        return read_json(self.path(folder))


def everybody(problems: Iterable[str]) -> dict[str, tuple[str, ...]]:
    """Return all agents for each problem, without those that cannot fly it."""
    return {name: tuple(agent for agent in ALL if can_fly(agent, name)) for name in problems}


def can_fly(agent: str, problem: str) -> bool:
    """Return whether an agent knows how to fly a problem: a policy that came with the package flies its own only."""
    if agent == "pretrained":
        return problem in policies.names()
    return not (agent in ONLY_SCENARIOS and problem in DISTRIBUTIONS)


SUITES = {
    suite.name: suite
    for suite in (
        Suite(
            "quick",
            {
                "hoop": ("ppo", "dagger", "pretrained", "expert", "tape", "pd"),
                "horizontal-6": ("ppo", "pretrained", "pd"),
                "random-goal": ("pretrained", "pd"),
            },
            seeds=1,
            sizes=replace(FULL, max_seconds=250.0, ppo_steps=5_000_000),
            preparation=True,
        ),
        Suite("full", everybody([*SCENARIOS, *DISTRIBUTIONS]), preparation=True),
        Suite("study", {name: tuple(a for a in who if a != "pretrained")
                        for name, who in everybody(["hoop", "random-goal"]).items()}),
    )
}  # fmt: skip
"""What can be run: in minutes, in hours, and the comparison of the learners that the README prints."""
