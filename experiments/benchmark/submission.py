"""One policy scored: one of ours by its name, or anybody's, which flies in a process of its own.

score(Contest(policy="my_module:policy", scenario="hoop"), store=None, timeout=60.0)
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import optimal
from agents import policies
from agents.controllers.cascaded_pd import CascadedPD
from agents.controllers.tracking import Expert
from agents.evaluation.scores import evaluate
from agents.policies import archive
from agents.policies.adapters import load_policy
from agents.policies.policy import Policy
from experiments.benchmark.sandbox import run_isolated
from experiments.benchmark.suite import ALL
from experiments.files import plain
from flatgym.scenarios import catalogue
from flatgym.scenarios.disturbances import Disturbances
from flatgym.scenarios.reference import EVALUATION_SEED

AGENTS = ("expert", "pd")


@dataclass(frozen=True)
class Submission:
    """Who is scored, and on what.

    Attributes:
        policy: a zip, or module:object; or
        pretrained: name of a policy that came with the package; or
        agent: one of AGENTS.
        scenario: name of a scenario or distribution; "" for what a zip was trained on.
        trust: whether to load a zip wherever it lies.
        episodes: number of flights.
        seed: of the first of them.
        disturbances: what stands against the vehicle.

    Raises:
        ValueError: where not exactly one is named, and where nobody says what is flown.
    """

    policy: str = ""
    pretrained: str = ""
    agent: str = ""
    scenario: str = ""
    trust: bool = False
    episodes: int = 100
    seed: int = EVALUATION_SEED
    disturbances: Disturbances = field(default_factory=Disturbances)

    def __post_init__(self) -> None:
        if sum(map(bool, (self.policy, self.pretrained, self.agent))) != 1:
            raise ValueError(
                "name one policy to score: a zip, module:object, --pretrained NAME, or --agent expert or pd"
            )
        if self.agent and self.agent not in AGENTS:
            raise ValueError(f"unknown agent {self.agent!r}; known: {', '.join(AGENTS)}")
        catalogue.problem(self.problem)

    @property
    def name(self) -> str:
        """What the policy is called: a zip by its file's name, an object by its own."""
        own = Path(self.policy).stem if self.policy.endswith(".zip") else self.policy.rpartition(":")[2]
        return self.pretrained or self.agent or own

    @property
    def problem(self) -> str:
        """What is flown."""
        if self.scenario:
            return self.scenario
        if self.agent:
            raise ValueError(f"the agent {self.agent} flies anything: give --scenario")
        if ".zip" not in self.policy + ".zip" * bool(self.pretrained):
            raise ValueError(f"{self.policy} does not say what it flies: give --scenario")
        path = archive.PRETRAINED / f"{self.pretrained}.zip" if self.pretrained else Path(self.policy)
        if self.pretrained and self.pretrained not in policies.names():
            policies.pretrained(self.pretrained)  # says which there are
        found = policies.describe(path).get("scenario", "")
        if not found:
            raise ValueError(f"{path} does not say what it was trained on: give --scenario")
        return str(found)

    def pilot(self, store: Path | None) -> Policy:
        """Return who flies; flights that have to be planned for it are kept in the store."""
        if self.policy:
            return load_policy(self.policy, self.trust)
        if self.pretrained:
            return policies.pretrained(self.pretrained)
        if self.agent == "pd":
            return CascadedPD(catalogue.problem(self.problem).quadrotor)
        return Expert(optimal.fewest_steps_many([self.problem], jobs=1, store=store)[0])


def score(contest: Submission, store: Path | None, timeout: float) -> dict[str, Any]:
    """Return the row of a score, as `agents.evaluate.evaluate` has it.

    Args:
        contest: who flies what.
        store: a folder in which K* that had to be computed are kept.
        timeout: how long a policy that is not ours may take [s].

    Raises:
        Failed: where such a policy fails, hangs or ends its process.
        ValueError: for a policy that may not be loaded or does not fit.
    """
    if not contest.policy:
        return scored(asdict(contest), str(store) if store else None)
    if contest.policy.endswith(".zip"):
        archive.admit(contest.policy, contest.trust)
    arguments = asdict(contest), str(store) if store else None
    row: dict[str, Any] = run_isolated("experiments.benchmark.submission:scored", *arguments, seconds=timeout)
    return row


def scored(fields: dict[str, Any], folder: str | None) -> dict[str, Any]:
    """Return the row of a score of a contest, given by its fields as JSON holds them."""
    contest = Submission(**fields | {"disturbances": Disturbances(**fields["disturbances"])})
    store = None if folder is None else Path(folder)
    pilot = contest.pilot(store)
    rows = evaluate(
        pilot,
        contest.problem,
        contest.episodes,
        contest.seed,
        disturbances=contest.disturbances,
        store=store,
        agent=contest.name,
        env_steps=getattr(pilot, "num_timesteps", None),
    )
    row: dict[str, Any] = plain(dict(rows.iloc[0]))
    return row


def named(given: Iterable[str], trust: bool) -> dict[str, str]:
    """Return policies by name, from NAME=ZIP or NAME=MODULE:OBJECT.

    Raises:
        ValueError: for another form, for a name that one of ours has, and for a zip without trust.
    """
    found = {}
    for one in given:
        name, equals, place = one.partition("=")
        if not (name and equals and place):
            raise ValueError(f"a policy is given as NAME=ZIP or NAME=MODULE:OBJECT, got {one!r}")
        if name in ALL or not name.replace("-", "").replace("_", "").isalnum():
            taken = ", ".join(ALL)
            raise ValueError(f"{name!r} cannot be a policy's name: use letters, digits, - and _, and none of {taken}")
        if place.endswith(".zip"):
            archive.admit(place, trust)
        found[name] = place
    return found
