"""The recipes of the learners' study: how each agent comes about, on one scenario and on a distribution.

    RECIPES["dagger"](Lesson("hoop", seed=0, folder=Path("runs")))    # -> Made: the policy, and what it cost
    EXPERTS["tape"](Lesson("random-goal", seed=0, folder=Path("runs")))

On the scenario the expert is the regulator about one optimal flight, planned through hoops narrower than they are, so
that who errs a little still flies through (`experiments.pretraining`). On the distribution every flight has its own
plan. All recipes that imitate see the same flights, planned once.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3 import PPO

from agents import policies
from agents.advice import guided, regulated
from agents.cascade import Cascade
from agents.configs import Config, PPOConfig, SACConfig
from agents.evaluate import Policy
from agents.experts import Expert, Tape
from agents.imitation import Adviser, CloneConfig, DaggerConfig, Keeper, Shown, dagger, fit, student
from agents.replanner import Replanner
from agents.schedules import CHECK_SEED, Point
from agents.train import Training, load, train
from experiments.files import write_json
from experiments.pretraining import INNER, inner, narrower, teacher
from flatgym import catalogue
from flatgym.distributions import Distribution
from flatgym.reference import EVALUATION_SEED, reference
from flatgym.scenario import Scenario
from optimal.batch import fewest_steps_many
from optimal.steps import FewestSteps, fewest_steps

BATCH = 250
"""Flights planned at once; what a killed run has planned of a batch is kept, but its time is not."""


@dataclass(frozen=True)
class Sizes:
    """How much of everything.

    Attributes:
        seconds: wall time of PPO and of SAC [s].
        tuning_s: of PPO that starts from a cloned policy [s].
        ppo_steps, sac_steps, tuning_steps: environment steps over which their schedules run.
        shown: flights of the regulator that are cloned on a scenario.
        planned: optimal flights that are cloned on a distribution.
        updates: gradient steps of a cloning on a scenario, and on a distribution.
        rounds: of DAgger, likewise.
        round_updates: gradient steps of a round, likewise.
        followed: flights of a round of DAgger on a distribution with a regulator.
        corrected: those from which it is planned anew.
        dagger_s: wall time after which no round begins [s].
        check_episodes: flights of a check on a distribution.
        goals: undisturbed flights of a policy on a distribution.
        disturbed: flights under each disturbance, and those of experts with a plan each.
        replanned: flights of the expert that plans anew at every step, which takes seconds each.
    """

    seconds: float = 100.0
    tuning_s: float = 50.0
    ppo_steps: int = 2_500_000
    sac_steps: int = 50_000
    tuning_steps: int = 800_000
    shown: int = 64
    planned: int = 1_500
    updates: tuple[int, int] = (4_000, 6_000)
    rounds: tuple[int, int] = (12, 5)
    round_updates: tuple[int, int] = (1_000, 2_500)
    followed: int = 800
    corrected: int = 40
    dagger_s: float = 250.0
    check_episodes: int = 64
    goals: int = 1_000
    disturbed: int = 200
    replanned: int = 10


FULL = Sizes()
TINY = Sizes(
    seconds=4.0,
    tuning_s=4.0,
    ppo_steps=33_000,
    sac_steps=2_000,
    tuning_steps=33_000,
    shown=4,
    planned=6,
    updates=(50, 50),
    rounds=(2, 2),
    round_updates=(50, 50),
    followed=4,
    corrected=2,
    dagger_s=4.0,
    check_episodes=2,
    goals=4,
    disturbed=3,
    replanned=1,
)
"""Sizes with which everything runs, and nothing is learnt."""


@dataclass(frozen=True)
class Lesson:
    """What is to be flown, and by whom it is to be learnt.

    Attributes:
        problem: name of the scenario or distribution.
        seed: of network, exploration and batches.
        folder: where flights, policies and the runs of trainings are kept.
        sizes: how much of everything.
    """

    problem: str
    seed: int
    folder: Path
    sizes: Sizes = FULL

    @property
    def target(self) -> Scenario | Distribution:
        """The scenario or distribution itself."""
        return catalogue.problem(self.problem)

    @property
    def drawn(self) -> bool:
        """Whether it is a distribution; says which of two sizes is meant."""
        return isinstance(self.target, Distribution)

    def file(self, agent: str, ending: str) -> Path:
        """Return a file of an agent's, or for the ending "" a folder."""
        return self.folder / f"{self.problem}-{agent}-{self.seed}{ending}"


@dataclass(frozen=True)
class Made:
    """An agent and what it cost.

    Attributes:
        policy: it.
        algorithm: by what it was made.
        configs: everything it depends on besides the lesson.
        curve: points env_steps, expert_steps, wall_time_s, outcome, success_rate, steps.
        env_steps: steps that the learner flew in the environment.
        expert_steps: steps for which an expert showed what to do.
        wall_time_s: of the learning, on one core [s].
        planning_s: of the planning of the demonstrations before, on all cores [s].
    """

    policy: Policy
    algorithm: str
    configs: Sequence[Any] = ()
    curve: Sequence[Point] = ()
    env_steps: int = 0
    expert_steps: int = 0
    wall_time_s: float = 0.0
    planning_s: float = 0.0


class Each:
    """Many policies as one: vehicle i is flown by policy i."""

    def __init__(self, pilots: Sequence[Policy]) -> None:
        self.pilots = pilots

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: Any = None,  # noqa: ARG002
        deterministic: bool = True,  # noqa: ARG002
    ) -> tuple[NDArray[np.float32], Any]:
        """Return an action, shape (n, 2), for each vehicle's observation, shape (n, 19); n at most the pilots'."""
        pairs = zip(self.pilots, np.asarray(observation), strict=False)
        return np.stack([pilot.predict(seen)[0] for pilot, seen in pairs]), state


class Counted:
    """An adviser that counts: the steps learners flew, and those for which it gave advice."""

    def __init__(self, adviser: Adviser) -> None:
        self.adviser = adviser
        self.env_steps = self.expert_steps = 0

    def __call__(self, learner: PPO | None, number: int) -> Shown:
        """Return the advice of a round."""
        shown = self.adviser(learner, number)
        self.expert_steps += shown.asked
        self.env_steps += shown.flown
        return shown

    def note(self, point: Point) -> None:
        """Write into a point of a learning curve what it cost."""
        point.update(env_steps=self.env_steps, expert_steps=self.expert_steps)


def plans(lesson: Lesson, first: int, count: int, share: float = INNER) -> tuple[list[FewestSteps], float]:
    """Return optimal flights of `count` drawn scenarios from seed `first` on, and the time their planning took [s].

    They are planned once, on all cores, through that share of their hoops; a file beside them says how long it took.
    """
    flights, taken, target = [], 0.0, lesson.target
    assert isinstance(target, Distribution)
    store = lesson.folder / "flights"
    for begin in range(first, first + count, BATCH):
        seeds = range(begin, min(begin + BATCH, first + count))
        record = lesson.folder / f"planned-{lesson.problem}-{seeds.start}-{seeds.stop}.json"
        jobs, begun = 1 if record.exists() else -1, time.perf_counter()
        drawn = [inner(target.scenario(i), share) for i in seeds]
        flights += fewest_steps_many(drawn, jobs=jobs, store=store, progress=False)
        if not record.exists():
            write_json(record, {"planning_s": time.perf_counter() - begun})
        taken += json.loads(record.read_text(encoding="utf-8"))["planning_s"]
    lost = [flight.scenario.name for flight in flights if not len(flight.actions)]
    if lost:
        raise ValueError(f"no flight was found for {', '.join(lost)}; every scenario of the study needs one")
    return flights, taken


def prepare(lesson: Lesson, agents: Collection[str]) -> float:
    """Plan what some agents need to begin; return K* of a problem's checks: on a distribution the mean of its flights'.

    Args:
        lesson: whose problem and sizes count.
        agents: who is going to be made.
    """
    sizes = lesson.sizes
    if not lesson.drawn:
        return best_known(lesson)
    if not IMITATORS.isdisjoint(agents):
        plans(lesson, 0, sizes.planned)
    if not PILOTS.isdisjoint(agents):
        plans(lesson, EVALUATION_SEED, sizes.disturbed)
    checked, _ = plans(lesson, CHECK_SEED, sizes.check_episodes, share=1.0)
    return float(np.mean([flight.steps for flight in checked]))


def school(lesson: Lesson, flights: int) -> tuple[Counted, float]:
    """Return who advises, and the time the demonstrations' planning took [s].

    Args:
        lesson: what is to be flown.
        flights: of a round, on a scenario.
    """
    sizes, target = lesson.sizes, lesson.target
    if isinstance(target, Scenario):
        begun = time.perf_counter()
        adviser = regulated([teacher(target)], count=flights, seed=lesson.seed)
        return Counted(adviser), time.perf_counter() - begun
    known, taken = plans(lesson, 0, sizes.planned)
    adviser = guided(known, target, count=sizes.followed, planned=sizes.corrected, seed=lesson.seed, jobs=1)
    return Counted(adviser), taken


def fitting(lesson: Lesson, updates: int) -> dict[str, Any]:
    """Return what cloning and DAgger have in common: on a distribution the network is larger, and sees more."""
    larger = {"width": 160, "zoom": 6.0, "guidance": True, "batch": 1024} if lesson.drawn else {}
    shared = {"scenario": lesson.problem, "seed": lesson.seed, "updates": updates}
    return shared | {"check_seed": CHECK_SEED, "check_episodes": lesson.sizes.check_episodes} | larger


def clone(lesson: Lesson) -> Made:
    """Behaviour cloning of an expert's flights."""
    torch.set_num_threads(1)
    config = CloneConfig(**fitting(lesson, lesson.sizes.updates[lesson.drawn]))
    adviser, planning = school(lesson, lesson.sizes.shown)
    keeper = Keeper(config, watch=adviser.note)
    model = student(config)
    fit(model, adviser(None, 0), config)
    keeper.check(model)
    return Made(model, "BC", [config], keeper.curve, 0, adviser.expert_steps, keeper.elapsed, planning)


def advised(lesson: Lesson) -> Made:
    """DAgger under the regulator, or under the expert that plans anew."""
    torch.set_num_threads(1)
    sizes, drawn = lesson.sizes, lesson.drawn
    shared = fitting(lesson, sizes.round_updates[drawn])
    config = DaggerConfig(rounds=sizes.rounds[drawn], seconds=sizes.dagger_s, **shared)
    adviser, planning = school(lesson, sizes.shown // 2)
    keeper = Keeper(config, target=best_known(lesson), watch=adviser.note)
    model = dagger(student(config), adviser, config, keeper)
    spent = adviser.env_steps, adviser.expert_steps, keeper.elapsed
    return Made(model, "DAgger", [config], keeper.curve, *spent, planning)


def best_known(lesson: Lesson) -> int:
    """Return K* of a scenario, where training may stop; 0 of a distribution, where it may not."""
    known = reference(lesson.problem)
    return 0 if known is None else known.k_star


def ppo(lesson: Lesson) -> Made:
    """PPO by its default recipe."""
    return reinforced(lesson, PPOConfig, lesson.sizes.ppo_steps)


def sac(lesson: Lesson) -> Made:
    """SAC by its default recipe."""
    return reinforced(lesson, SACConfig, lesson.sizes.sac_steps)


def reinforced(lesson: Lesson, kind: type[Config], env_steps: int) -> Made:
    """Train by an algorithm's default recipe, over so many environment steps."""
    config = kind(
        scenario=lesson.problem,
        seed=lesson.seed,
        seconds=lesson.sizes.seconds,
        env_steps=env_steps,
        folder=str(lesson.file(kind.algorithm.lower(), "")),
        check_episodes=lesson.sizes.check_episodes,
    )
    return trained(lesson, config)


def tuned(lesson: Lesson) -> Made:
    """PPO on the problem as it is, from the policy cloned with the same seed; what that one cost is added."""
    sizes, first = lesson.sizes, lesson.file("bc", ".zip")
    config = PPOConfig(
        scenario=lesson.problem,
        seed=lesson.seed,
        policy=str(first),
        seconds=sizes.tuning_s,
        env_steps=sizes.tuning_steps,
        folder=str(lesson.file("bc-ppo", "")),
        check_episodes=sizes.check_episodes,
        tolerance=1.0,
        drawn=0.0,
        drawn_end=0.0,
        log_std=-2.5,
        learning_rate=1e-4,
        divergence=0.005,
    )
    made, before = trained(lesson, config), json.loads(lesson.file("bc", ".json").read_text(encoding="utf-8"))
    shown, spent = before["expert_steps"], before["wall_time_s"]
    later = [p | {"expert_steps": shown, "wall_time_s": p["wall_time_s"] + spent} for p in made.curve]
    return replace(
        made,
        algorithm="BC, PPO",
        curve=[*before["curve"], *later],
        expert_steps=shown,
        wall_time_s=made.wall_time_s + spent,
        planning_s=before["planning_s"],
    )


def trained(lesson: Lesson, config: Config) -> Made:
    """Train by reinforcement, on from a killed run's checkpoint where there is one."""
    done: Training = train(config, best_known(lesson) or None, resume=True)
    curve = [point | {"expert_steps": 0} for point in done.curve]
    return Made(load(done.model), config.algorithm, [config], curve, done.env_steps, 0, done.wall_time_s)


def pilots(lesson: Lesson, kind: Callable[[FewestSteps], Policy]) -> tuple[Policy, float]:
    """Return a policy of a kind for each flight of a score, and the time the planning took [s]."""
    if isinstance(lesson.target, Scenario):
        begun = time.perf_counter()
        return kind(teacher(lesson.target)), time.perf_counter() - begun
    flights, taken = plans(lesson, EVALUATION_SEED, lesson.sizes.disturbed)
    return Each([kind(flight) for flight in flights]), taken


def expert(lesson: Lesson) -> Made:
    """The regulator about an optimal flight."""
    policy, taken = pilots(lesson, Expert)
    return Made(policy, "LQR about a K* flight", planning_s=taken)


def tape(lesson: Lesson) -> Made:
    """The same flight replayed open loop."""
    policy, taken = pilots(lesson, Tape)
    return Made(policy, "open-loop replay", planning_s=taken)


def grazing(lesson: Lesson) -> Made:
    """The regulator about a flight that passes the rim with nothing to spare."""
    flight = fewest_steps(lesson.problem, time_budget=0.0)
    return Made(Expert(flight), "LQR about a K* flight at the rim")


def replanner(lesson: Lesson) -> Made:
    """The expert that plans anew at every step, through the narrower hoop."""
    assert isinstance(lesson.target, Scenario)
    flight = fewest_steps(narrower(lesson.target), time_budget=0.0)
    return Made(Each([Replanner(flight) for _ in range(lesson.sizes.replanned)]), "replanning at every step")


def cascade(lesson: Lesson) -> Made:
    """The cascaded PD controller."""
    return Made(Cascade(lesson.target.quadrotor), "cascaded PD")


def pretrained(lesson: Lesson) -> Made:
    """The policy that came with the package; its card says what it cost."""
    card = json.loads((policies.PRETRAINED / f"{lesson.problem}.json").read_text(encoding="utf-8"))
    score = card["score"]
    spent = score["env_steps"] or 0, 0, score["wall_time_s"]
    return Made(policies.pretrained(lesson.problem), score["algorithm"], (), (), *spent)


Recipe = Callable[[Lesson], Made]
LEARNERS: dict[str, Recipe] = {"ppo": ppo, "sac": sac, "bc": clone, "dagger": advised, "bc-ppo": tuned}
"""What is learnt, once for each seed."""
EXPERTS: dict[str, Recipe] = {
    "expert": expert,
    "tape": tape,
    "pd": cascade,
    "pretrained": pretrained,
    "expert-rim": grazing,
    "replanner": replanner,
}
"""What knows how to fly already, and knows no seed."""
ONLY_SCENARIOS = ("expert-rim", "replanner")
"""Those that are flown on scenarios only."""
IMITATORS, PILOTS = {"bc", "dagger", "bc-ppo"}, {"expert", "tape"}
"""Those that on a distribution learn from planned flights, and those that fly plans of their own."""
