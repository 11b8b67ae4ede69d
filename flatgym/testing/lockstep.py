"""Checks between rollouts: lockstep with scalar environments, and repetition of a rollout."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack
from copy import deepcopy
from itertools import islice
from typing import Any, TypeAlias

import gymnasium as gym
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space, iterate

from flatgym.testing.calls import Call, Envs, final_observations, observation_rows
from flatgym.testing.rollout import Rollout

Single: TypeAlias = gym.Env[Any, Any]


def check_vector_env(
    envs: Envs,
    make_single: Callable[..., Single] | None = None,
    *,
    steps: int = 1000,
    seed: int = 0,
    atol: float = 1e-9,
    actions: Iterable[Any] | None = None,
) -> int:
    """Check a vector environment; raise an AssertionError for the first violation.

    Checked are:

    - the spaces, and observations in their space;
    - rewards and flags; infos, each an array `key` with a mask `_key`; the same keys at all steps within an episode;
    - autoreset as stated by `metadata["autoreset_mode"]`; in mode DISABLED, resets by `options={"reset_mask": mask}`;
    - a reset of all envs right after an end;
    - that the same seed gives the same rollout;
    - that results never change after they were returned and may be written into; that actions are not changed;
    - that `close` may be called twice;
    - with `make_single`, that all results equal those of the scalar environments, seeded by a number or by a list.

    Args:
        envs: any `gymnasium.vector.VectorEnv` that returns NumPy arrays, of n = num_envs envs. A small n suffices; the
            rollout is stored in memory. The environment is closed at the end. Infos with the time of day, as of
            RecordEpisodeStatistics, differ between rollouts and are reported.
        make_single: returns the scalar environment; called as make_single(i), i in 0..n-1, if it requires an argument.
            None omits the lockstep check.
        steps: number of steps; `envs` runs them three or four times, the scalar environments once.
        seed: seed of the vector environment; that of env i is seed + i, as in Gymnasium.
        atol: absolute tolerance of numbers. Numbers of lower precision than float64 may also differ by one rounding,
            unless atol is 0, which requires bitwise equality. Flags, integers and strings must be equal.
        actions: batched actions, at most `steps`, e.g. an array (steps, n, ...); random samples by default.

    Returns:
        The number of episodes that ended. If 0, no autoreset was tested: use more steps or other actions.

    Raises:
        AssertionError: naming the step, the env, the difference, and both values.
        ValueError: for steps or atol out of range, or without actions.
    """
    if steps < 1 or not atol >= 0:
        raise ValueError(f"steps must be at least 1 and atol at least 0, got steps={steps!r}, atol={atol!r}")
    chosen = _samples(envs, steps, seed) if actions is None else [deepcopy(a) for a in islice(actions, steps)]
    if not chosen:
        raise ValueError("actions must not be empty")
    with ExitStack() as opened:
        singles = [] if make_single is None else _make_singles(make_single, envs.num_envs)
        for single in singles:
            opened.enter_context(single)
        _check_spaces(envs, singles)
        calls = list(_compare_in_lockstep(Rollout(envs, chosen, seed), singles, atol))
        _check_repetition(envs, chosen, seed, calls)
        if singles:
            _check_seed_list(envs, chosen[:10], seed, singles, atol)
    envs.close()
    envs.close()
    return sum(int(call.ended.sum()) for call in calls)


def _check_spaces(envs: Envs, singles: list[Single]) -> None:
    """Check that spaces are batches of the single ones, these equal the scalar envs' spaces, and the mode is stated."""
    for name in ("observation_space", "action_space"):
        single, batched = getattr(envs, f"single_{name}"), getattr(envs, name)
        batch = batch_space(single, envs.num_envs)
        if batched != batch:
            raise AssertionError(f"{name} is {batched}, expected the batch of single_{name}, {batch}")
        for i, env in enumerate(singles):
            scalar = getattr(env, name)
            if single != scalar:
                raise AssertionError(f"single_{name} is {single}, that of scalar environment {i} is {scalar}")
    mode = envs.metadata.get("autoreset_mode")
    if not isinstance(mode, AutoresetMode):
        raise AssertionError(f"metadata['autoreset_mode'] must be an AutoresetMode, got {mode!r}")


def _compare_in_lockstep(rollout: Rollout, singles: list[Single], atol: float) -> Iterator[Call]:
    """Yield the calls of a rollout, each compared with the results of the scalar environments."""
    for call in rollout:
        if singles:
            _compare(rollout.envs, call, singles, atol)
        yield call


def _compare(envs: Envs, call: Call, singles: list[Single], atol: float) -> None:
    """Make the same call of the scalar environments, and compare."""
    observations, infos = observation_rows(envs, call), call.rows(call.infos)
    finals = final_observations(envs, call) if envs.metadata["autoreset_mode"] == AutoresetMode.SAME_STEP else {}
    final_infos = call.rows(call.infos.get("final_info", {}))
    actions = None if call.actions is None else list(iterate(envs.action_space, call.actions))
    for i, env in enumerate(singles):
        pairs: list[tuple[str, Any, Any]] = []
        if call.begins[i]:
            observation, info = env.reset(seed=call.seeds[i])
        elif actions is None:
            continue
        else:
            observation, reward, terminated, truncated, info = env.step(actions[i])
            pairs += [("terminated", call.terminated[i], terminated), ("truncated", call.truncated[i], truncated)]
            pairs += [("the reward", call.rewards[i], reward)]
            if i in finals:
                pairs += [("final_obs", finals[i], observation), ("final_info", final_infos[i], info)]
                observation, info = env.reset()
        pairs += [("the observation", observations[i], observation), ("info", infos[i], info)]
        for name, got, wanted in pairs:
            call.compare(name, got, wanted, atol, i, "in the scalar environment")


def _check_repetition(envs: Envs, actions: list[Any], seed: int, calls: list[Call]) -> None:
    """Check that a rollout repeats: unchanged, with overwritten results, and with other ignored actions."""
    rollouts = [
        Rollout(envs, actions, seed, "repeated with the same seed, "),
        Rollout(envs, actions, seed, "repeated, returned arrays and actions overwritten after use, ", overwriting=True),
    ]
    if envs.metadata["autoreset_mode"] == AutoresetMode.NEXT_STEP:
        ignored = iter(_samples(envs, len(actions), seed + 1))
        rollouts.append(Rollout(envs, actions, seed, "repeated with other actions after the ends, ", ignored=ignored))
    for rollout in rollouts:
        for first, again in zip(calls, rollout, strict=True):
            rows = (observation_rows(envs, again), observation_rows(envs, first))
            for i, (new, old) in enumerate(zip(*rows, strict=True)):
                again.compare("the observation", new, old, env=i, source="first")
            for name in ("rewards", "terminated", "truncated", "infos"):
                again.compare(name, getattr(again, name), getattr(first, name), source="first")


def _check_seed_list(envs: Envs, actions: list[Any], seed: int, singles: list[Single], atol: float) -> None:
    """Check that a list seeds each env separately, if the vector environment accepts lists.

    The list is descending, because an ascending one equals the seeds derived from its first number.
    """
    seeds = [seed + i for i in range(envs.num_envs)][::-1]
    try:
        envs.reset(seed=list(seeds))  # type: ignore[arg-type]
    except gym.error.Error:  # the base class requires numbers only, and rejects lists with this error
        return
    for _ in _compare_in_lockstep(Rollout(envs, actions, seeds, f"seeded with {seeds}, "), singles, atol):
        pass


def _samples(envs: Envs, steps: int, seed: int) -> list[Any]:
    """Return random batched actions without using the space's own generator."""
    space = deepcopy(envs.action_space)
    space.seed(seed)
    return [space.sample() for _ in range(steps)]


def _make_singles(make_single: Callable[..., Single], n: int) -> list[Single]:
    """Return n scalar environments from make_single() or make_single(i)."""
    try:
        parameters = inspect.signature(make_single).parameters.values()
    except ValueError:  # callables without a signature
        parameters = {}.values()
    numbered = any(p.default is p.empty and p.kind in (p.POSITIONAL_ONLY, p.POSITIONAL_OR_KEYWORD) for p in parameters)
    return [make_single(i) if numbered else make_single() for i in range(n)]
