"""The races of the report: on each scenario the best-known flight, the agents' episodes, and shipped agents.

All entries are replayed from their actions, so the page shows what the environment does. Each entry has the states of
all steps, rounded to DIGITS. Between two steps the page's script evaluates the closed form of `flatgym.quadrotor` under
the control of that step; nothing is interpolated.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from agents import policies
from agents.controllers.cascaded_pd import CascadedPD
from agents.evaluation.rollouts import fly
from experiments.benchmark.agents import NAMES, display_name
from experiments.benchmark.tasks import scenarios_of
from experiments.files import Row
from flatgym.quadrotor import Array
from flatgym.scenarios.catalogue import DEFAULT_SCENARIO, text
from flatgym.scenarios.reference import Reference
from flatgym.scenarios.scenario import Scenario
from flatgym.task.rollout import episode_outcomes, open_loop_states
from flatgym.task.scene import FLYING, OUTCOMES

DIGITS = 4
"""Decimals of states and controls; 0.1 mm is far below what can be drawn."""
PRETRAINED, CASCADED_PD = "pretrained", "pd"


@dataclass(frozen=True, eq=False)
class RaceEntry:
    """An episode in a race.

    Attributes:
        name: name of the agent.
        states: from the start to the end, shape (K+1, 5).
        controls: thrust [m/s^2] and rate [rad/s] of each step, shape (K, 2).
        outcome: one of OUTCOMES.
        k_star: K* of the scenario.
    """

    name: str
    states: Array
    controls: Array
    outcome: str
    k_star: int

    @property
    def steps(self) -> int:
        """Environment steps of the episode."""
        return len(self.controls)

    @property
    def gap(self) -> float | None:
        """The gap K / K* - 1; None if the goal was not reached."""
        return self.steps / self.k_star - 1 if self.outcome == "goal" else None

    def result(self) -> str:
        """Return the result of the episode in words."""
        if self.gap is None:
            return f"{self.outcome} after {self.steps} steps, K* = {self.k_star}"
        gap = f"{100 * self.gap:+.1f} %" if self.gap else "0 %"
        return f"goal in {self.steps} steps, K* = {self.k_star}, gap {gap}"

    def to_dict(self) -> dict[str, Any]:
        """Return the entry for the page's script."""
        return {
            "name": self.name,
            "steps": self.steps,
            "outcome": self.outcome,
            "gap": self.gap,
            "result": self.result(),
            "states": np.round(self.states, DIGITS).tolist(),
            "controls": np.round(self.controls, DIGITS).tolist(),
        }


def races(results: Row) -> dict[str, Any]:
    """Return the races for the page's script: "first", the scenario shown at first, and "scenarios" by name.

    Args:
        results: a benchmark's results, whose cells may hold "actions".

    Raises:
        ValueError: as in `replay`.
    """
    scenarios = {}
    for name, (scenario, best) in scenarios_of(results).items():
        candidates = [(f"best known, K* = {best.k_star}", best.actions), *agent_actions(results, name, scenario)]
        entries = [replay(scenario, label, actions, best.k_star) for label, actions in candidates]
        scenarios[name] = scene(scenario) | {
            "k_star": best.k_star,
            "proof": proof_text(name, best),
            "entries": [entry.to_dict() for entry in entries],
            "second": next((i for i, entry in enumerate(entries) if i and entry.gap), len(entries) - 1),
        }
    flown = {cell["problem"] for cell in results["cells"]}
    names = (DEFAULT_SCENARIO, *scenarios)
    first = next((name for name in names if name in flown & set(scenarios)), next(iter(scenarios), None))
    return {"first": first, "scenarios": scenarios}


def agent_actions(results: Row, name: str, scenario: Scenario) -> Iterator[tuple[str, ArrayLike]]:
    """Yield names and actions of the episodes on a scenario: those of the results, then those of shipped agents.

    Args:
        results: as in `races`.
        name: the scenario's label.
        scenario: the scenario.
    """
    cells = [cell for cell in results["cells"] if cell["problem"] == name and cell.get("actions")]
    runs = Counter(cell["agent"] for cell in cells)
    for cell in cells:
        seed = f", seed {cell['seed']}" if runs[cell["agent"]] > 1 else ""
        yield display_name(cell["agent"]) + seed, cell["actions"]
    for agent, label in ((PRETRAINED, "pretrained policy"), (CASCADED_PD, NAMES[CASCADED_PD])):
        actions = None if agent in runs else shipped_actions(agent, scenario)
        if actions is not None:
            yield label, actions


@lru_cache(maxsize=64)
def shipped_actions(agent: str, scenario: Scenario) -> NDArray[np.float32] | None:
    """Return the actions of the pretrained policy or of the PD controller; None if there is no such policy."""
    if agent == CASCADED_PD:
        return fly(CascadedPD(scenario.quadrotor), scenario).actions[0]
    name = text(scenario)
    return fly(policies.pretrained(name), scenario).actions[0] if name in policies.names() else None


def replay(scenario: Scenario, name: str, actions: ArrayLike, k_star: int) -> RaceEntry:
    """Return the episode of actions, shape (K, 2), up to its end.

    Raises:
        ValueError: for no actions, another shape, and actions that are not finite.
    """
    clipped = checked(actions, name, scenario)
    states = open_loop_states(scenario, clipped)
    outcomes = episode_outcomes(scenario, states, clipped).outcome
    ended = np.flatnonzero(outcomes != FLYING)
    steps = int(ended[0]) + 1 if len(ended) else len(clipped)
    controls = scenario.quadrotor.control(clipped[:steps])
    return RaceEntry(name, states[: steps + 1], controls, OUTCOMES[outcomes[steps - 1]], k_star)


def checked(actions: ArrayLike, name: str, scenario: Scenario) -> NDArray[np.float32]:
    """Return actions as the environment applies them; a ValueError for invalid ones."""
    array: NDArray[np.float32] = np.asarray(actions, dtype=np.float32)
    if array.ndim != 2 or array.shape[1] != 2 or not len(array) or not np.isfinite(array).all():
        raise ValueError(
            f"actions of {name!r} in {scenario.name!r} must be finite, of shape (K, 2), got shape {array.shape}"
        )
    return np.clip(array, -1, 1)


def proof_text(name: str, best: Reference) -> str:
    """Return in words how far the K* of a scenario is proven."""
    if best.proven:
        return f"{name}: K* = {best.k_star} steps is proven; no flight takes fewer."
    return (
        f"{name}: K* = {best.k_star} steps is the best known; it is proven that no flight takes fewer than "
        f"{best.k_lower_bound}."
    )


def scene(scenario: Scenario) -> dict[str, Any]:
    """Return what the script needs to draw a scenario and to fly in it: lengths [m], angles [rad], dt [s]."""
    vehicle = scenario.quadrotor
    return {
        "dt": scenario.dt,
        "gravity": vehicle.gravity,
        "thrust": [vehicle.thrust_min, vehicle.thrust_max],
        "rate": [-vehicle.rate_max, vehicle.rate_max],
        "start": list(scenario.start),
        "goal": list(scenario.goal),
        "tolerance": scenario.tolerance.position,
        "hoops": [[hoop.x, hoop.z, hoop.diameter, hoop.angle] for hoop in scenario.hoops],
        "floor": scenario.floor,
        "ceiling": scenario.ceiling,
    }
