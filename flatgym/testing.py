"""A vector environment checked in lockstep with scalar ones; Gymnasium's `check_env` is for scalar ones only.

    check_vector_env(gym.make_vec("CartPole-v1", 4, "sync"), lambda: gym.make("CartPole-v1"))

A flight is a sequence of calls, resets and steps, each noted with what it returned. Three kinds of law hold for it:

    protocol    each call by itself: spaces, shapes, the masks of infos, what the autoreset mode promises
    lockstep    env i returns what the scalar environment returns under the same seed and actions
    repetition  the same seed gives the same flight, also when the caller writes into the arrays he was given,
                and when those actions differ that must be ignored

Without `make_single` the lockstep is left out: for environments that draw all their starts from one generator, as
Gymnasium's own CartPole does, so that no scalar environment starts where theirs do.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, suppress
from copy import deepcopy
from dataclasses import dataclass
from itertools import islice
from typing import Any, NoReturn, TypeAlias

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space, iterate
from numpy.typing import NDArray

Envs: TypeAlias = gym.vector.VectorEnv[Any, Any, Any]
Single: TypeAlias = gym.Env[Any, Any]
Flags = NDArray[np.bool_]

WATCHED = 64
"""The first results of a flight, so many, and the latest are watched for changes after they were returned."""
FINALS = ("final_obs", "final_info")


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
        calls = list(_in_lockstep(_Flight(envs, chosen, seed), singles, atol))
        _check_repetition(envs, chosen, seed, calls)
        if singles:
            _check_seed_list(envs, chosen[:10], seed, singles, atol)
    envs.close()
    envs.close()
    return sum(int(call.ended.sum()) for call in calls)


@dataclass(frozen=True)
class _Call:
    """One reset or step, with a copy of what it returned."""

    label: str
    actions: Any  # None: a reset
    seeds: list[int | None]
    begins: Flags  # the envs that begin an episode with this call, other than by the end of one in the same step
    observations: Any
    rewards: Any
    terminated: Any
    truncated: Any
    infos: dict[str, Any]

    @property
    def ended(self) -> Flags:
        """The envs whose episode ended with this call, shape (n,)."""
        return np.asarray(self.terminated | self.truncated)

    def fail(self, text: str, env: int | None = None) -> NoReturn:
        """Raise an AssertionError that says when and in which env."""
        raise AssertionError(f"{self.label}{'' if env is None else f', env {env}'}: {text}")

    def compare(
        self, name: str, got: Any, wanted: Any, atol: float = 0.0, env: int | None = None, who: str = "expected"
    ) -> None:
        """Raise an AssertionError where two values differ by more than atol."""
        if difference := _difference(name, got, wanted, atol):
            place, one, other = difference
            self.fail(f"{place} is {one!r}, {who} {other!r}", env)

    def rows(self, infos: dict[str, Any]) -> list[dict[str, Any]]:
        """Return the info of each env, without finals, from arrays `key` and their masks `_key`."""
        n = len(self.begins)
        rows: list[dict[str, Any]] = [{} for _ in range(n)]
        for key, values in infos.items():
            if key.removeprefix("_") in FINALS or (key.startswith("_") and key[1:] in infos):
                continue
            mask = self.mask(infos, key)
            rows_of: Any = self.rows(values) if isinstance(values, dict) else values
            if np.shape(rows_of)[:1] != (n,):
                self.fail(f"infos[{key!r}] must have {n} rows, got {values!r}")
            for i in np.flatnonzero(mask).tolist():
                rows[i][key] = rows_of[i]
        return rows

    def mask(self, infos: dict[str, Any], key: str) -> Flags:
        """Return the mask that tells which envs have an info."""
        mask, n = infos.get(f"_{key}"), len(self.begins)
        if not (isinstance(mask, np.ndarray) and mask.shape == (n,) and mask.dtype == np.bool_):
            self.fail(f"infos[{key!r}] needs a mask of {n} booleans, infos['_{key}'], got {mask!r}")
        return np.asarray(mask)


class _Flight:
    """One flight of the vector environment, call by call, each checked for the protocol.

    With `meddling`, the caller writes into all he was given, and into his actions, after each call. With `strays`,
    he hands over these actions in place of those which are to be ignored. The title tells flights apart in messages.
    """

    def __init__(
        self,
        envs: Envs,
        actions: list[Any],
        seed: int | list[int],
        title: str = "",
        meddling: bool = False,
        strays: Iterator[Any] | None = None,
    ) -> None:
        self.envs, self.n, self.mode = envs, envs.num_envs, envs.metadata["autoreset_mode"]
        self.actions, self.seed, self.title, self.meddling, self.strays = actions, seed, title, meddling, strays
        self.broken_off = False
        self.watched: list[tuple[_Call, Any]] = []
        self.keys: dict[int, set[str]] = {}

    def __iter__(self) -> Iterator[_Call]:
        call = self._reset("reset", np.ones(self.n, dtype=bool), self.seed)
        yield call
        for number, actions in enumerate(self.actions, 1):
            call = self._step(f"step {number}", actions, call)
            yield call
            mask = self._to_be_reset(number, call)
            if mask.any():
                before, call = call, self._reset(f"reset after step {number}", mask)
                _check_left_alone(self.envs, before, call)
                yield call
        for call, returned in self.watched:
            _check_unchanged(call, returned, "the end of the flight")

    def _to_be_reset(self, number: int, call: _Call) -> Flags:
        """Return which envs the caller resets after a step."""
        if self.mode == AutoresetMode.DISABLED:
            # Besides those that ended, every other env three times in mid-flight: the mask must be read.
            share, rest = divmod(number, max(len(self.actions) // 3, 1))
            return call.ended | ((np.arange(self.n) % 2 == share % 2) & (rest == 0))
        # All of them, once, and right after an end: an autoreset that is due must be forgotten.
        now = not self.broken_off and 2 * number >= len(self.actions) and bool(call.ended.any())
        self.broken_off |= now
        return np.full(self.n, now)

    def _reset(self, label: str, mask: Flags, seed: int | list[int] | None = None) -> _Call:
        options = None if mask.all() else {"reset_mask": mask.copy()}
        observations, infos = self.envs.reset(seed=deepcopy(seed), options=options)  # type: ignore[arg-type]
        seeds = [None if seed is None else seed + i for i in range(self.n)] if not isinstance(seed, list) else seed
        rewards, flags = np.zeros(self.n), np.zeros((2, self.n), dtype=bool)
        call = self._note(label, None, list(seeds), mask, (observations, rewards, *flags, infos))
        call.rows(call.infos)
        return call

    def _step(self, label: str, actions: Any, before: _Call) -> _Call:
        begins = before.ended if self.mode == AutoresetMode.NEXT_STEP else np.zeros(self.n, dtype=bool)
        given = deepcopy(actions)
        if self.strays is not None and begins.any():
            given = _exchanged(self.envs.single_action_space, given, next(self.strays), begins)
        handed = deepcopy(given)
        call = self._note(label, actions, [None] * self.n, begins, self.envs.step(given))
        call.compare("the actions", given, handed, who="before the step")
        _check_step(call, self.keys)
        if self.mode == AutoresetMode.SAME_STEP:
            _check_finals(self.envs, call)
        if self.meddling:
            _overwrite(given)
        return call

    def _note(self, label: str, actions: Any, seeds: list[int | None], begins: Flags, returned: Any) -> _Call:
        call = _Call(self.title + label, actions, seeds, begins, *deepcopy(returned))
        if self.watched:
            _check_unchanged(*self.watched[-1], label)
        if self.meddling:
            _overwrite(returned)
        else:
            self.watched[WATCHED:] = [(call, returned)]
        _check_observations(self.envs, call)
        return call


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


def _check_observations(envs: Envs, call: _Call) -> None:
    """Check that the observations are in their space."""
    if envs.observation_space.contains(call.observations):
        return
    single = envs.single_observation_space
    with suppress(KeyError, TypeError, IndexError):  # of a layout that has no rows to name
        for i, row in enumerate(_observation_rows(envs, call)):
            kind = getattr(row, "dtype", type(row).__name__)
            if not single.contains(row):
                call.fail(f"the observation {row!r} ({kind}) is not in {single}", i)
    call.fail(f"the observations {call.observations!r} are not in {envs.observation_space}")


def _check_step(call: _Call, keys: dict[int, set[str]]) -> None:
    """Check rewards, flags and infos of a step; `keys` remembers the infos' keys of each env in mid-flight."""
    n = len(call.begins)
    for name, kinds, what in (("rewards", "fiu", "numbers"), ("terminated", "b", "bools"), ("truncated", "b", "bools")):
        value = getattr(call, name)
        if not (isinstance(value, np.ndarray) and value.shape == (n,) and value.dtype.kind in kinds):
            call.fail(f"{name} must be a NumPy array of {n} {what}, got {value!r}")
    for i, row in enumerate(call.rows(call.infos)):
        if np.isnan(call.rewards[i]):
            call.fail("the reward is nan", i)
        if call.begins[i]:
            call.compare("the reward in the step of the reset", call.rewards[i], 0.0, env=i)
            call.compare("terminated in the step of the reset", call.terminated[i], False, env=i)
            call.compare("truncated in the step of the reset", call.truncated[i], False, env=i)
        elif not call.ended[i]:
            known = keys.setdefault(i, set(row))
            if set(row) != known:
                call.fail(f"info has the keys {sorted(row)}, at earlier steps {sorted(known)}", i)


def _check_left_alone(envs: Envs, before: _Call, call: _Call) -> None:
    """Check that a reset by a mask leaves the other envs where they were."""
    rows = zip(_observation_rows(envs, call), _observation_rows(envs, before), strict=True)
    for i, (row, earlier) in enumerate(rows):
        if not call.begins[i]:
            call.compare("the observation", row, earlier, env=i, who="its reset_mask is False, and before it was")


def _check_finals(envs: Envs, call: _Call) -> None:
    """Check that the masks of final_obs and final_info tell which envs ended, and that final_obs are in their space."""
    other_keys = any(key.removeprefix("_") not in FINALS for key in call.infos)
    for key in FINALS:
        if key in call.infos:
            mask = call.mask(call.infos, key)
        else:
            # An environment without infos has no final ones either.
            mask = call.ended if key == "final_info" and not other_keys else np.zeros_like(call.ended)
        for i in np.flatnonzero(mask != call.ended).tolist():
            told = "given, but the episode goes on" if mask[i] else "missing, but the episode has ended"
            call.fail(f"{key} is {told}", i)
    for i, row in _final_observations(envs, call).items():
        single = envs.single_observation_space
        if not single.contains(row):
            call.fail(f"final_obs {row!r} is not in {single}", i)


def _final_observations(envs: Envs, call: _Call) -> dict[int, Any]:
    """Return the last observations of the envs that ended, from an array of objects or from a batch."""
    if not call.ended.any():
        return {}
    final = call.infos["final_obs"]
    of_objects = isinstance(final, np.ndarray) and final.dtype == object
    rows = list(final if of_objects else iterate(envs.observation_space, final))
    return {i: rows[i] for i in np.flatnonzero(call.ended).tolist()}


def _in_lockstep(flight: _Flight, singles: list[Single], atol: float) -> Iterator[_Call]:
    """Yield the calls of a flight, each compared with what the scalar environments return."""
    for call in flight:
        if singles:
            _compare(flight.envs, call, singles, atol)
        yield call


def _compare(envs: Envs, call: _Call, singles: list[Single], atol: float) -> None:
    """Call the scalar environments alike, and compare."""
    observations, infos = _observation_rows(envs, call), call.rows(call.infos)
    finals = _final_observations(envs, call) if envs.metadata["autoreset_mode"] == AutoresetMode.SAME_STEP else {}
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


def _check_repetition(envs: Envs, actions: list[Any], seed: int, calls: list[_Call]) -> None:
    """Check that the flight repeats itself: as it was, under a caller who meddles, and with other ignored actions."""
    flights = [
        _Flight(envs, actions, seed, "flown again with the same seed, "),
        _Flight(envs, actions, seed, "flown again, returned arrays and actions overwritten after use, ", meddling=True),
    ]
    if envs.metadata["autoreset_mode"] == AutoresetMode.NEXT_STEP:
        strays = iter(_samples(envs, len(actions), seed + 1))
        flights.append(_Flight(envs, actions, seed, "flown again with other actions after the ends, ", strays=strays))
    for flight in flights:
        for first, again in zip(calls, flight, strict=True):
            rows = (_observation_rows(envs, again), _observation_rows(envs, first))
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
    for _ in _in_lockstep(_Flight(envs, actions, seeds, f"seeded with {seeds}, "), singles, atol):
        pass


def _check_unchanged(call: _Call, returned: Any, later: str) -> None:
    """Check that what a call returned is still what it was."""
    for name, now in zip(("observations", "rewards", "terminated", "truncated", "infos"), returned, strict=True):
        call.compare(name, now, getattr(call, name), who=f"before {later} it was")


def _observation_rows(envs: Envs, call: _Call) -> list[Any]:
    return list(iterate(envs.observation_space, call.observations))


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


def _difference(name: str, got: Any, wanted: Any, atol: float) -> tuple[str, Any, Any] | None:
    """Return where two values differ and what stands there, or None; numbers within atol, all else by equality."""
    if isinstance(got, dict) and isinstance(wanted, dict):
        if got.keys() != wanted.keys():
            return f"the list of keys of {name}", sorted(got), sorted(wanted)
        parts = [(f"{name}[{key!r}]", got[key], wanted[key]) for key in wanted]
    elif isinstance(got, (tuple, list)) and isinstance(wanted, (tuple, list)):
        if len(got) != len(wanted):
            return f"the length of {name}", len(got), len(wanted)
        parts = [(f"{name}[{i}]", one, other) for i, (one, other) in enumerate(zip(got, wanted, strict=True))]
    else:
        return _array_difference(name, got, wanted, atol)
    return next(filter(None, (_difference(*part, atol) for part in parts)), None)


def _array_difference(name: str, got: Any, wanted: Any, atol: float) -> tuple[str, Any, Any] | None:
    one, other = np.asarray(got), np.asarray(wanted)
    if one.shape != other.shape:
        return f"the shape of {name}", one.shape, other.shape
    if one.dtype == object and one.ndim:
        return _difference(name, one.tolist(), other.tolist(), atol)
    equal = np.asarray(one == other)
    kinds = {one.dtype.kind, other.dtype.kind}
    if "f" in kinds and kinds <= set("fiub") and not equal.all():
        coarsest = max(float(np.finfo(a.dtype).eps) for a in (one, other) if a.dtype.kind == "f")
        rounding = coarsest if atol > 0 and coarsest > np.finfo(np.float64).eps else 0.0
        equal = np.isclose(one.astype(np.float64), other.astype(np.float64), rounding, atol, equal_nan=True)
    if equal.all():
        return None
    at = tuple(int(k) for k in np.argwhere(~equal)[0])
    return name + (str(list(at)) if at else ""), one[at].item(), other[at].item()


def _arrays(value: Any) -> Iterator[NDArray[Any]]:
    """Yield all arrays of numbers in nested dicts, tuples and lists."""
    if isinstance(value, (dict, tuple, list)):
        for part in value.values() if isinstance(value, dict) else value:
            yield from _arrays(part)
    elif isinstance(value, np.ndarray) and value.dtype.kind in "fiub":
        yield value


def _overwrite(value: Any) -> None:
    """Write other numbers into all arrays that may be written into, once into those that occur twice."""
    for array in {id(array): array for array in _arrays(value)}.values():
        if array.flags.writeable:
            array[...] = np.nan if array.dtype.kind == "f" else ~array


def _exchanged(single: gym.Space[Any], own: Any, other: Any, rows: Flags) -> Any:
    """Return the batched actions `own`, in some rows replaced by those of `other`."""
    if isinstance(single, gym.spaces.Dict):
        return {key: _exchanged(part, own[key], other[key], rows) for key, part in single.items()}
    if isinstance(single, gym.spaces.Tuple):
        return tuple(_exchanged(part, own[k], other[k], rows) for k, part in enumerate(single.spaces))
    if isinstance(own, np.ndarray):
        mask = rows.reshape(-1, *[1] * (own.ndim - 1))
        return np.where(mask, other, own).astype(own.dtype)
    return tuple(stray if row else action for row, stray, action in zip(rows, other, own, strict=True))
