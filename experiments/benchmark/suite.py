"""Suites of the benchmark: which agents fly which problems, with how many seeds and which budget."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from agents import policies
from agents.policies import archive
from agents.policies.adapters import ZIP, check_policy_name
from experiments.files import Row, read_json
from experiments.recipes.registry import COMPARED_ON_FEW, EXPERTS, LEARNERS, SCENARIO_ONLY
from experiments.recipes.run_spec import FULL, Budget
from flatgym import DISTRIBUTIONS, SCENARIOS, Distribution
from flatgym.scenarios import catalogue
from flatgym.scenarios.catalogue import SAMPLE
from flatgym.scenarios.files import SUFFIXES
from flatgym.validation import choice

AGENTS = (*LEARNERS, *EXPERTS)
PREREQUISITES = {"bc-ppo": "bc"}
"""Agents that start from the policy of another agent."""
SEEDS = 3
SMOKE_SUITE = "smoke"
"""Name of a suite with the smoke test's budget, whose numbers mean nothing."""
TIMEOUT = 300.0
"""Time limit for all episodes of an external policy [s]."""


@dataclass(frozen=True)
class Suite:
    """A set of cells to run.

    Attributes:
        name: name of the suite.
        agents: by problem, the agents that fly it; a problem is a name, or the JSON text of a task of one's own.
        seeds: training runs of each learner.
        budget: training time, sample counts and episode counts.
        preparation: whether scenarios are solved and demonstrations recorded first.
        policies: external policies, name and arguments of `load_policy`; they fly every problem.
        timeout: time limit for all episodes of an external policy [s].
    """

    name: str
    agents: Mapping[str, Sequence[str]]
    seeds: int = SEEDS
    budget: Budget = FULL
    preparation: bool = False
    policies: Mapping[str, Row] = field(default_factory=dict)
    timeout: float = TIMEOUT

    def with_own(self, only: Sequence[str]) -> tuple[Suite, list[str]]:
        """Return the suite with the tasks of one's own in `only`, and `only` with their labels.

        Args:
            only: as in `cells`; a problem may also be a file, or a sample of a distribution.
        """
        agents, labels = dict(self.agents), []
        for word in only:
            problem, slash, agent = (
                word.rpartition("/") if word.endswith(tuple(f"/{a}" for a in AGENTS)) else (word, "", "")
            )
            if problem not in agents and (problem.endswith(SUFFIXES) or SAMPLE.fullmatch(problem)):
                key = catalogue.text(problem)
                agents |= all_agents([key]) if key not in agents else {}
                problem = catalogue.label(key)
            labels.append(problem + slash + agent)
        return replace(self, agents=agents), labels

    def cells(self, only: Sequence[str] = ()) -> list[Cell]:
        """Return the cells in the order of the tables.

        Args:
            only: "problem" or "problem/agent", the cells to select; all by default. Prerequisites are included.

        Raises:
            ValueError: for an unknown cell; it lists the known ones.
        """
        cells = [
            Cell(problem, agent, seed)
            for problem, agents in self.agents.items()
            for agent in (*agents, *self.policies)
            for seed in range(self.seeds if agent in LEARNERS else 1)
        ]
        known = {name for cell in cells for name in (cell.label, cell.name)}
        for name in only:
            choice("cell", name, sorted(known))
        selected = set(only)
        for cell in cells:
            if cell.name in selected and cell.agent in PREREQUISITES:
                selected.add(f"{cell.label}/{PREREQUISITES[cell.agent]}")
        return [cell for cell in cells if not only or {cell.label, cell.name} & selected]


@dataclass(frozen=True)
class Cell:
    """One agent on one problem with one seed; it has a results file of its own."""

    problem: str
    agent: str
    seed: int

    @property
    def label(self) -> str:
        """The short name of the problem, which stands for its content in results and file names."""
        return catalogue.label(self.problem)

    @property
    def name(self) -> str:
        """The name without the seed, "problem/agent"."""
        return f"{self.label}/{self.agent}"

    @property
    def row(self) -> Row:
        """The first entries of its file."""
        return {"problem": self.label, "agent": self.agent, "seed": self.seed}

    def path(self, folder: Path) -> Path:
        """Return the path of its file."""
        return cell_path(folder, self.label, self.agent, self.seed)

    def read(self, folder: Path) -> Row | None:
        """Return the content of its file; None where there is no readable file."""
        return read_json(self.path(folder))


def cell_path(folder: Path, label: str, agent: str, seed: int) -> Path:
    """Return the path of a cell's file, by the label of its problem."""
    return folder / f"{label}-{agent}-{seed}.json"


def all_agents(problems: Iterable[str]) -> dict[str, tuple[str, ...]]:
    """Return, for each problem, all agents that can fly it."""
    return {name: tuple(agent for agent in AGENTS if can_fly(agent, name)) for name in problems}


def can_fly(agent: str, problem: str) -> bool:
    """Return whether an agent can fly a problem; a pretrained policy flies only the problem it was trained on."""
    if agent == "pretrained":
        return problem in policies.names()
    return not (agent in SCENARIO_ONLY and isinstance(catalogue.problem(problem), Distribution))


def named_policies(arguments: Iterable[str], trust: bool) -> dict[str, Row]:
    """Return the arguments of `load_policy` for external policies by name, from NAME=FILE or NAME=MODULE:OBJECT.

    Raises:
        ValueError: for another form, for the name of a built-in agent, and for a zip without trust.
    """
    found: dict[str, Row] = {}
    for argument in arguments:
        name, equals, source = argument.partition("=")
        if not (name and equals and source):
            raise ValueError(f"a policy is given as NAME=ZIP or NAME=MODULE:OBJECT, got {argument!r}")
        if name in AGENTS or not name.replace("-", "").replace("_", "").isalnum():
            taken = ", ".join(AGENTS)
            raise ValueError(f"{name!r} cannot be a policy's name: use letters, digits, - and _, and none of {taken}")
        check_policy_name(source)
        if source.endswith(ZIP):
            archive.admit(source, trust)
        found[name] = {"name": source, "trust": trust}
    return found


COMPARED = ("hoop", "random-goal")
"""Problems on which all learners are compared."""
SUITES = {
    suite.name: suite
    for suite in (
        Suite(
            "quick",
            {
                "hoop": ("ppo", "dagger", "pretrained", "expert", "open-loop", "pd", "hover", "random"),
                "horizontal-6": ("ppo", "pretrained", "pd", "hover", "random"),
                "random-goal": ("pretrained", "pd", "hover", "random"),
            },
            seeds=1,
            preparation=True,
        ),
        Suite(
            "full",
            {
                name: tuple(agent for agent in agents if name in COMPARED or agent not in COMPARED_ON_FEW)
                for name, agents in all_agents([*SCENARIOS, *DISTRIBUTIONS]).items()
            },
            preparation=True,
        ),
        Suite(
            "study",
            {
                name: tuple(agent for agent in agents if agent != "pretrained")
                for name, agents in all_agents(COMPARED).items()
            },
        ),
    )
}
"""The suites: "quick" takes minutes, "full" about half a day on two cores, and "study", the comparison of the learners
in the README, about five."""
