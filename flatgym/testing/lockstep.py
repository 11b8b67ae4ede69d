"""The laws that hold between flights: with scalar environments in lockstep, and of a flight with its repetition."""

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
from flatgym.testing.episodes import Flight

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
    """Fly a vector environment; an AssertionError tells the first thing that is not as it should be.

    Checked are: the spaces; observations in their space; rewards and flags; infos, an array `key` with a mask `_key`
    each, the same keys at all steps that neither end nor begin an episode; autoreset as `metadata["autoreset_mode"]`
    has it, or in mode DISABLED resets by `options={"reset_mask": mask}`; a reset of all right after an end; that the
    same seed gives the same flight; that what was returned never changes, and may be written into; that actions are
    not changed; that `close` may be called twice. And with `make_single`: that all which is returned equals what the
    scalar environments return, seeded by a number or by a list.

    Args:
        envs: any `gymnasium.vector.VectorEnv` that returns NumPy arrays, of n = num_envs envs. A few do: the flight is
            kept in memory. It is closed in the end. Infos that tell the time of day, as RecordEpisodeStatistics has
            them, differ between any two flights, and are found to.
        make_single: returns the scalar environment; called as make_single(i) if it must have an argument, i in
            0..n-1. None leaves the lockstep out.
        steps: how many steps to fly; `envs` flies them three or four times, the scalar environments once.
        seed: the vector environment's; that of env i is seed + i, as in Gymnasium.
        atol: how far numbers may be apart. Numbers coarser than float64 may besides be one rounding apart, unless atol
            is 0, which asks for equality to the bit. Flags, integers and words must be equal in any case.
        actions: batched actions to fly with, at most `steps`, e.g. an array (steps, n, ...); samples by default.

    Returns:
        How many episodes ended. If 0, no autoreset was seen: fly longer, or with actions that get somewhere.

    Raises:
        AssertionError: names the step, the env, what differs, and both values.
        ValueError: for steps or atol out of range, or no actions.
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
        calls = list(_in_lockstep(Flight(envs, chosen, seed), singles, atol))
        _check_repetition(envs, chosen, seed, calls)
        if singles:
            _check_seed_list(envs, chosen[:10], seed, singles, atol)
    envs.close()
    envs.close()
    return sum(int(call.ended.sum()) for call in calls)


def _check_spaces(envs: Envs, singles: list[Single]) -> None:
    """Check that the spaces are batches of the single ones, these those of the scalar envs, and the mode is told."""
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


def _in_lockstep(flight: Flight, singles: list[Single], atol: float) -> Iterator[Call]:
    """Yield the calls of a flight, each compared with what the scalar environments return."""
    for call in flight:
        if singles:
            _compare(flight.envs, call, singles, atol)
        yield call


def _compare(envs: Envs, call: Call, singles: list[Single], atol: float) -> None:
    """Call the scalar environments alike, and compare."""
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
    """Check that the flight repeats itself: as it was, under a caller who meddles, and with other ignored actions."""
    flights = [
        Flight(envs, actions, seed, "flown again with the same seed, "),
        Flight(envs, actions, seed, "flown again, returned arrays and actions overwritten after use, ", meddling=True),
    ]
    if envs.metadata["autoreset_mode"] == AutoresetMode.NEXT_STEP:
        strays = iter(_samples(envs, len(actions), seed + 1))
        flights.append(Flight(envs, actions, seed, "flown again with other actions after the ends, ", strays=strays))
    for flight in flights:
        for first, again in zip(calls, flight, strict=True):
            rows = (observation_rows(envs, again), observation_rows(envs, first))
            for i, (new, old) in enumerate(zip(*rows, strict=True)):
                again.compare("the observation", new, old, env=i, who="first")
            for name in ("rewards", "terminated", "truncated", "infos"):
                again.compare(name, getattr(again, name), getattr(first, name), who="first")


def _check_seed_list(envs: Envs, actions: list[Any], seed: int, singles: list[Single], atol: float) -> None:
    """Check that a list seeds each env with its own number, if the vector environment takes lists.

    From the last to the first, as else its first number would tell all.
    """
    seeds = [seed + i for i in range(envs.num_envs)][::-1]
    try:
        envs.reset(seed=list(seeds))  # type: ignore[arg-type]
    except gym.error.Error:  # the base class promises numbers only, and refuses a list so
        return
    for _ in _in_lockstep(Flight(envs, actions, seeds, f"seeded with {seeds}, "), singles, atol):
        pass


def _samples(envs: Envs, steps: int, seed: int) -> list[Any]:
    """Return random batched actions, leaving the space's own generator alone."""
    space = deepcopy(envs.action_space)
    space.seed(seed)
    return [space.sample() for _ in range(steps)]


def _make_singles(make_single: Callable[..., Single], n: int) -> list[Single]:
    """Return n scalar environments from make_single() or make_single(i)."""
    try:
        parameters = inspect.signature(make_single).parameters.values()
    except ValueError:  # of a callable that hides its signature
        parameters = {}.values()
    numbered = any(p.default is p.empty and p.kind in (p.POSITIONAL_ONLY, p.POSITIONAL_OR_KEYWORD) for p in parameters)
    return [make_single(i) if numbered else make_single() for i in range(n)]
