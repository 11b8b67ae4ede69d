"""The flights of the report that race each other: the best one known, those that come with the package, and yours.

All are flown anew from their actions, so that what is shown is what the environment does. A state is kept for each
step, rounded to DIGITS; between two of them the page's script flies the exact closed form of `flatgym.quadrotor`
under the control held in that step, so that nothing is interpolated.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from agents import policies
from agents.controllers.cascaded_pd import CascadedPD
from agents.evaluation.rollouts import fly
from experiments.benchmark.agents import NAMES, called
from experiments.files import Row
from flatgym import SCENARIOS
from flatgym.quadrotor import Array
from flatgym.scenarios.catalogue import DEFAULT_SCENARIO
from flatgym.scenarios.reference import Reference, reference
from flatgym.scenarios.scenario import Scenario
from flatgym.task.rollout import episode_outcomes, open_loop_states
from flatgym.task.scene import FLYING, OUTCOMES

DIGITS = 4
"""Decimals of states and controls; a tenth of a millimetre is far below what can be drawn."""
PRETRAINED, CLASSICAL = "pretrained", "pd"


@dataclass(frozen=True, eq=False)
class Flight:
    """A flight to race.

    Attributes:
        name: whose.
        states: from its start to its end, shape (K+1, 5).
        controls: thrust [m/s^2] and rate [rad/s] held in each step, shape (K, 2).
        outcome: a word of OUTCOMES.
        k_star: of the scenario.
    """

    name: str
    states: Array
    controls: Array
    outcome: str
    k_star: int

    @property
    def steps(self) -> int:
        """Environment steps until it ended."""
        return len(self.controls)

    @property
    def gap(self) -> float | None:
        """How far above K* it came to the goal, relatively; None where it did not."""
        return self.steps / self.k_star - 1 if self.outcome == "goal" else None

    def told(self) -> str:
        """Return how it ended, as one says it."""
        if self.gap is None:
            return f"{self.outcome} after {self.steps} steps, K* = {self.k_star}"
        gap = f"{100 * self.gap:+.1f} %" if self.gap else "0 %"
        return f"goal in {self.steps} steps, K* = {self.k_star}, gap {gap}"

    def plain(self) -> dict[str, Any]:
        """Return it as the page's script reads it."""
        return {
            "name": self.name,
            "steps": self.steps,
            "outcome": self.outcome,
            "gap": self.gap,
            "told": self.told(),
            "states": np.round(self.states, DIGITS).tolist(),
            "controls": np.round(self.controls, DIGITS).tolist(),
        }


def flown(scenario: Scenario, actions: Sequence[ArrayLike], names: Sequence[str], k_star: int) -> list[Flight]:
    """Return the flights of actions, each (K, 2), flown anew and side by side; fewer steps where one ends before.

    Raises:
        ValueError: for actions of another shape, none, or such as are not finite.
    """
    held = [checked(one, name, scenario) for one, name in zip(actions, names, strict=True)]
    flights = []
    for one, name in zip(held, names, strict=True):
        states = open_loop_states(scenario, one)
        outcomes = episode_outcomes(scenario, states, one).outcome
        ended = np.flatnonzero(outcomes != FLYING)
        steps = int(ended[0]) + 1 if len(ended) else len(one)
        word = OUTCOMES[outcomes[steps - 1]]
        flights.append(Flight(name, states[: steps + 1], scenario.quadrotor.control(one[:steps]), word, k_star))
    return flights


def checked(actions: ArrayLike, name: str, scenario: Scenario) -> NDArray[np.float32]:
    """Return actions as the environment takes them; a ValueError where it would not."""
    held: NDArray[np.float32] = np.asarray(actions, dtype=np.float32)
    if held.ndim != 2 or held.shape[1] != 2 or not len(held) or not np.isfinite(held).all():
        raise ValueError(
            f"actions of {name!r} in {scenario.name!r} must be finite, of shape (K, 2), got shape {held.shape}"
        )
    return np.clip(held, -1, 1)


@lru_cache(maxsize=64)
def shipped(agent: str, name: str) -> NDArray[np.float32] | None:
    """Return the actions of what comes with the package, the pretrained policy or the PD controller; None for none."""
    if agent == PRETRAINED and name not in policies.names():
        return None
    return fly(policies.pretrained(name) if agent == PRETRAINED else CascadedPD(), name).actions[0]


def candidates(results: Row, name: str) -> Iterator[tuple[str, ArrayLike]]:
    """Yield names and actions of the flights in a scenario, but the best one known; the results' own come first."""
    cells = [cell for cell in results["cells"] if cell["problem"] == name and cell.get("actions")]
    runs = Counter(cell["agent"] for cell in cells)
    for cell in cells:
        seed = f", seed {cell['seed']}" if runs[cell["agent"]] > 1 else ""
        yield called(cell["agent"]) + seed, cell["actions"]
    for agent, words in ((PRETRAINED, "pretrained policy"), (CLASSICAL, NAMES[CLASSICAL])):
        actions = None if agent in runs else shipped(agent, name)
        if actions is not None:
            yield words, actions


def races(results: Row) -> dict[str, Any]:
    """Return the named scenarios with their flights, as the page's script reads them, and which pair is shown first."""
    found = {}
    for name, scenario in SCENARIOS.items():
        best = reference(scenario)
        if best is not None:
            field = [(f"best known, K* = {best.k_star}", best.actions), *candidates(results, name)]
            flights = flown(scenario, [actions for _, actions in field], [words for words, _ in field], best.k_star)
            found[name] = world(scenario) | {
                "k_star": best.k_star,
                "known": known(best),
                "flights": [flight.plain() for flight in flights],
                "rival": next((i for i, flight in enumerate(flights) if i and flight.gap), len(flights) - 1),
            }
    asked = {cell["problem"] for cell in results["cells"]}
    first = next((name for name in (DEFAULT_SCENARIO, *found) if name in asked & set(found)), next(iter(found), None))
    return {"first": first, "scenarios": found}


def known(best: Reference) -> str:
    """Return how far the K* of a scenario is proven."""
    if best.proven:
        return f"{best.scenario}: no flight takes fewer than K* = {best.k_star} steps, which is proven."
    return (
        f"{best.scenario}: K* = {best.k_star} steps are the fewest known; fewer than {best.k_lower_bound} are proven "
        "to be impossible."
    )


def world(scenario: Scenario) -> dict[str, Any]:
    """Return what of a scenario is drawn and flown with: lengths [m], angles [rad], dt [s]."""
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
