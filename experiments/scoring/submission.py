"""A policy to score: one that comes with the package, by name, or an external one; and the task it flies.

Submission(policy="my_module:policy", scenario="hoop").load(store=None)
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from agents import policies
from agents.controllers.cascaded_pd import CascadedPD
from agents.controllers.tracking import Expert
from agents.controllers.trivial import Hover, RandomActions
from agents.evaluation.optima import flight_in_k_star
from agents.evaluation.protocol import protocol_episodes
from agents.policies import archive
from agents.policies.adapters import ZIP, check_policy_name, load_policy
from agents.policies.policy import Policy
from experiments.files import Row
from experiments.recipes.margins import robust_flight
from flatgym.scenarios import catalogue
from flatgym.scenarios.disturbances import Disturbances
from flatgym.scenarios.reference import EVALUATION_SEED
from flatgym.validation import choice

CONTROLLERS = {
    "expert": "agents.controllers.tracking:Expert",
    "expert-no-margin": "agents.controllers.tracking:Expert",
    "pd": "agents.controllers.cascaded_pd:CascadedPD",
    "hover": "agents.controllers.trivial:Hover",
    "random": "agents.controllers.trivial:RandomActions",
}
"""Agents that can be scored on any task, named as in the benchmark, and their classes."""


@dataclass(frozen=True)
class Submission:
    """A policy to score, and the problem to score it on.

    Attributes:
        policy: a zip, a TorchScript or ONNX file, or module:object; or
        pretrained: name of a policy that comes with the package; or
        agent: one of CONTROLLERS.
        scenario: name of a scenario or distribution; by default the one that a zip was trained on.
        trust: whether to load a zip from any folder.
        normalize: file of VecNormalize statistics, "" for those beside a zip.
        algorithm: the algorithm of a zip, "" for the one that it shows.
        episodes: number of episodes; None for that of the protocol.
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
    normalize: str = ""
    algorithm: str = ""
    episodes: int | None = None
    seed: int = EVALUATION_SEED
    disturbances: Disturbances = field(default_factory=Disturbances)

    def __post_init__(self) -> None:
        if sum(map(bool, (self.policy, self.pretrained, self.agent))) != 1:
            raise ValueError(
                "name one policy to score: a zip, a TorchScript or ONNX file, module:object, --pretrained NAME, or "
                f"--agent {' or '.join(CONTROLLERS)}"
            )
        if self.agent:
            choice("agent", self.agent, CONTROLLERS)
        if self.policy:
            check_policy_name(self.policy)
        elif self.normalize or self.algorithm:
            raise ValueError("--normalize and --algorithm are for a policy of your own, and none is named")
        if self.normalize and not Path(self.normalize).is_file():
            raise ValueError(f"there are no statistics of VecNormalize at {self.normalize}")
        catalogue.problem(self.problem)

    @property
    def name(self) -> str:
        """Name of the policy: that of the file, or of the object."""
        own = self.policy.rpartition(":")[2] if ":" in Path(self.policy).name else Path(self.policy).stem
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
        if not (self.pretrained or self.policy.endswith(ZIP)):
            raise ValueError(f"{self.policy} does not name its scenario: give --scenario")
        path = archive.PRETRAINED / f"{self.pretrained}.zip" if self.pretrained else Path(self.policy)
        if self.pretrained and self.pretrained not in policies.names():
            policies.pretrained(self.pretrained)  # raises an error that lists the known names
        scenario = policies.describe(path, self.algorithm).get("scenario", "")
        if not scenario:
            raise ValueError(f"{path} does not name the scenario it was trained on: give --scenario")
        return str(scenario)

    @property
    def count(self) -> int:
        """Number of episodes."""
        return self.episodes or protocol_episodes(self.problem, self.disturbances)

    @property
    def arguments(self) -> Row:
        """Arguments of `load_policy` for an external policy."""
        return {"name": self.policy, "trust": self.trust, "normalize": self.normalize, "algorithm": self.algorithm}

    def load(self, store: Path | None) -> Policy:
        """Return the policy; a flight that an expert needs is read from the store or planned."""
        if self.policy:
            return load_policy(**self.arguments)
        if self.pretrained:
            return policies.pretrained(self.pretrained)
        if self.agent == "random":
            return RandomActions()
        if self.agent in ("pd", "hover"):
            kind = CascadedPD if self.agent == "pd" else Hover
            return kind(catalogue.problem(self.problem).quadrotor)
        scenario = catalogue.scenario(self.problem)
        return Expert(robust_flight(scenario, store) if self.agent == "expert" else flight_in_k_star(scenario, store))
