"""One policy scored: one that comes with the package, by name, or an external one, in a process of its own.

score(Submission(policy="my_module:policy", scenario="hoop"), store=None, timeout=60.0)
"""

from __future__ import annotations

import sys
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field
from pathlib import Path

import optimal
from agents import policies
from agents.controllers.cascaded_pd import CascadedPD
from agents.controllers.tracking import Expert
from agents.evaluation.rollouts import fly
from agents.evaluation.scores import check_optima, flight_rows, score_row
from agents.policies import archive
from agents.policies.adapters import load_policy
from agents.policies.fingerprint import fingerprint
from agents.policies.policy import Policy
from experiments.benchmark import score_file
from experiments.benchmark.sandbox import run_isolated
from experiments.benchmark.suite import AGENTS
from experiments.files import Row, plain
from experiments.provenance import provenance
from flatgym.scenarios import catalogue
from flatgym.scenarios.disturbances import Disturbances
from flatgym.scenarios.reference import EVALUATION_SEED

CONTROLLERS = {
    "expert": "agents.controllers.tracking:Expert",
    "pd": "agents.controllers.cascaded_pd:CascadedPD",
}
"""Agents that can be scored on any problem, and their classes."""


@dataclass(frozen=True)
class Submission:
    """A policy to score, and the problem to score it on.

    Attributes:
        policy: a zip, or module:object; or
        pretrained: name of a policy that comes with the package; or
        agent: one of CONTROLLERS.
        scenario: name of a scenario or distribution; by default the one that a zip was trained on.
        trust: whether to load a zip from any folder.
        episodes: number of episodes.
        seed: seed of the first episode.
        disturbances: the disturbances.

    Raises:
        ValueError: unless exactly one policy is named, and where the problem is not known.
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
        if self.agent and self.agent not in CONTROLLERS:
            raise ValueError(f"unknown agent {self.agent!r}; known: {', '.join(CONTROLLERS)}")
        catalogue.problem(self.problem)

    @property
    def name(self) -> str:
        """Name of the policy: that of the zip, or of the object."""
        own = Path(self.policy).stem if self.policy.endswith(".zip") else self.policy.rpartition(":")[2]
        return self.pretrained or self.agent or own

    @property
    def source(self) -> str:
        """The policy as `agents.policies.fingerprint` takes it."""
        path = str(archive.PRETRAINED / f"{self.pretrained}.zip") if self.pretrained else ""
        return self.policy or path or CONTROLLERS[self.agent]

    @property
    def problem(self) -> str:
        """Name of the scenario or distribution."""
        if self.scenario:
            return self.scenario
        if self.agent:
            raise ValueError(f"the agent {self.agent} flies any scenario: give --scenario")
        if not (self.pretrained or ".zip" in self.policy):
            raise ValueError(f"{self.policy} does not name its scenario: give --scenario")
        path = archive.PRETRAINED / f"{self.pretrained}.zip" if self.pretrained else Path(self.policy)
        if self.pretrained and self.pretrained not in policies.names():
            policies.pretrained(self.pretrained)  # raises an error that lists the known names
        scenario = policies.describe(path).get("scenario", "")
        if not scenario:
            raise ValueError(f"{path} does not name the scenario it was trained on: give --scenario")
        return str(scenario)

    def load(self, store: Path | None) -> Policy:
        """Return the policy; a flight that the expert needs is read from the store or planned."""
        if self.policy:
            return load_policy(self.policy, self.trust)
        if self.pretrained:
            return policies.pretrained(self.pretrained)
        if self.agent == "pd":
            return CascadedPD(catalogue.problem(self.problem).quadrotor)
        return Expert(optimal.fewest_steps_many([self.problem], jobs=1, store=store)[0])


def score(submission: Submission, store: Path | None, timeout: float, record: bool = False) -> Row:
    """Return the score row of a submission, as `agents.evaluate` gives it.

    Args:
        submission: the policy and the problem.
        store: folder of K* that have been computed.
        timeout: time limit for an external policy [s].
        record: whether to return the score and flights of a score file instead. A flight in fewer steps than K* is then
            no error.

    Raises:
        Failed: where an external policy fails, hangs or ends its process.
        ValueError: for a policy that may not be loaded or does not fit.
    """
    if submission.policy.endswith(".zip"):
        archive.admit(submission.policy, submission.trust)
    arguments = asdict(submission), str(store) if store else None, record
    if not submission.policy:
        return score_fields(*arguments)
    row: Row = run_isolated("experiments.benchmark.submission:score_fields", *arguments, seconds=timeout)
    return row


def record(submission: Submission, store: Path | None, timeout: float, path: Path, command: str) -> Row:
    """Write a score file of a submission, and return its score; arguments and errors as in `score`.

    Args:
        path: the file.
        command: the command line, for the record.
    """
    found = score(submission, store, timeout, record=True)
    row: Row = found["score"] | {"command": command}
    policy = {"name": submission.name, "fingerprint": fingerprint(submission.source)}
    problem = catalogue.problem(submission.problem)
    origin = provenance(command)
    score_file.write(path, problem, submission.disturbances, policy, row, found["flights"], origin)
    if not submission.disturbances.active and any((flight["gap"] or 0) < 0 for flight in found["flights"]):
        faster = f"{submission.name} takes fewer steps than K*: K* is wrong; please report it with {path}"
        print(faster, file=sys.stderr)
    return row


def score_fields(fields: Row, store: str | None, record: bool = False) -> Row:
    """Return the score row of a submission, or its score and flights; all arguments as JSON holds them."""
    submission = Submission(**fields | {"disturbances": Disturbances(**fields["disturbances"])})
    folder = None if store is None else Path(store)
    policy = submission.load(folder)
    flown = fly(policy, submission.problem, submission.episodes, submission.seed, submission.disturbances)
    rows = flight_rows(flown, submission.problem, submission.seed, store=folder)
    columns = {
        "agent": submission.name,
        "algorithm": type(policy).__name__,
        "env_steps": getattr(policy, "num_timesteps", None),
    }
    if record:
        found = score_file.scored(rows, submission.seed, submission.disturbances, **columns)
        return {"score": found, "flights": score_file.flights(rows, flown.actions)}
    if not submission.disturbances.active:
        check_optima(flown, rows, submission.problem)
    row: Row = plain(dict(score_row(rows, submission.seed, submission.disturbances, **columns).iloc[0]))
    return row


def named_policies(arguments: Iterable[str], trust: bool) -> dict[str, str]:
    """Return external policies by name, from NAME=ZIP or NAME=MODULE:OBJECT.

    Raises:
        ValueError: for another form, for the name of a built-in agent, and for a zip without trust.
    """
    found = {}
    for argument in arguments:
        name, equals, source = argument.partition("=")
        if not (name and equals and source):
            raise ValueError(f"a policy is given as NAME=ZIP or NAME=MODULE:OBJECT, got {argument!r}")
        if name in AGENTS or not name.replace("-", "").replace("_", "").isalnum():
            taken = ", ".join(AGENTS)
            raise ValueError(f"{name!r} cannot be a policy's name: use letters, digits, - and _, and none of {taken}")
        if source.endswith(".zip"):
            archive.admit(source, trust)
        found[name] = source
    return found
