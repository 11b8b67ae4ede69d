"""The checker: correct environments pass in every autoreset mode; every injected fault is found and named."""

from dataclasses import replace
from functools import partial

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.spaces import Box, Dict, Discrete, Tuple
from gymnasium.vector import AutoresetMode, SyncVectorEnv

import flatgym
from flatgym.envs.numpy_fleet import NumpyFleet
from flatgym.envs.vector import FlatQuadVectorEnv
from flatgym.testing import check_vector_env

N, LIMIT = 3, 9
NEXT, SAME, OFF = AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP, AutoresetMode.DISABLED


class Walk(gym.Env):
    """A random walk: the action moves, the generator pushes; it ends beyond 2 or after LIMIT steps."""

    observation_space = Box(-9, 9, (2,), np.float32)
    action_space = Box(-1, 1, (1,), np.float32)

    def __init__(self, limit=LIMIT):
        self.limit = limit

    def reset(self, *, seed=None, options=None):  # noqa: ARG002
        super().reset(seed=seed)
        self.place, self.steps = self.np_random.uniform(-1, 1), 0
        return self.observe(), self.info()

    def step(self, action):
        self.place += float(action[0]) + self.np_random.uniform(-0.5, 0.5)
        self.steps += 1
        return self.observe(), -abs(self.place), abs(self.place) > 2, self.steps >= self.limit, self.info()

    def observe(self):
        return np.array([self.place, self.steps], dtype=np.float32)

    def info(self):
        side = "left" if self.place < 0 else "right"
        return {"place": self.place, "steps": self.steps, "side": side, "both": np.array([self.place, 1.0])}


class Walks(SyncVectorEnv):
    """The walks side by side, sound as they are; the faults below change one thing each."""

    def __init__(self, mode=NEXT, **arguments):
        super().__init__([Walk] * N, autoreset_mode=mode, **arguments)


class Nested(gym.ObservationWrapper):
    """A walk whose observation is a dict of an array and a tuple, and whose action is a choice."""

    observation_space = Dict(where=Walk.observation_space, more=Tuple((Discrete(99), Box(0, 1, (), np.float64))))

    def __init__(self):
        super().__init__(Walk())
        self.action_space = Discrete(3)

    def observation(self, observation):
        return {"where": observation, "more": (np.int64(observation[1]), np.array(0.5))}

    def step(self, action):
        return super().step(np.array([action - 1.0]))


class Summary(gym.Wrapper):
    """A walk that tells something more at the end of an episode, and that in a dict."""

    def __init__(self):
        super().__init__(Walk())

    def step(self, action):
        *results, terminated, truncated, info = super().step(action)
        summary = {"episode": {"length": info["steps"], "why": "fell"}} if terminated or truncated else {}
        return *results, terminated, truncated, info | summary


# What passes


@pytest.mark.parametrize("mode", [NEXT, SAME, OFF])
@pytest.mark.parametrize("single", [Walk, Nested, Summary])
def test_a_correct_environment_passes_and_its_episodes_are_counted(mode, single):
    for make_single in (single, lambda _: single(), None):
        assert check_vector_env(SyncVectorEnv([single] * N, autoreset_mode=mode), make_single, steps=60) >= 60 / LIMIT


@pytest.mark.parametrize("mode", [NEXT, SAME, OFF])
@pytest.mark.parametrize("batched", [True, False])
def test_flatquad_passes(mode, batched):
    scenario = replace(flatgym.scenario("ground-6"), time_limit=0.4)
    single = partial(gym.make, "FlatQuad-v0", scenario=scenario)
    if batched:
        envs = FlatQuadVectorEnv(2, scenario=scenario, autoreset_mode=mode)
    else:
        envs = SyncVectorEnv([single] * 2, autoreset_mode=mode)
    assert check_vector_env(envs, single, steps=50) >= 4


class TellsTheLimit(gym.Wrapper):
    """Gymnasium's TimeLimit stands outside of the environment and leaves its info as it is; this adds the word."""

    def step(self, action):
        *results, truncated, info = super().step(action)
        return *results, truncated, info | {"outcome": "time-limit" if truncated else info["outcome"]}


@pytest.mark.parametrize("mode", [NEXT, SAME, OFF])
def test_max_episode_steps_truncates_like_the_wrapper(mode):
    single = partial(gym.make, "FlatQuad-v0", scenario="ground-6", max_episode_steps=20)
    envs = partial(FlatQuadVectorEnv, 2, "ground-6", max_episode_steps=20, autoreset_mode=mode)
    assert check_vector_env(envs(), lambda: TellsTheLimit(single()), steps=50) >= 4
    words = r"info\['outcome'\] is 'time-limit', in the scalar environment 'flying'"
    with pytest.raises(AssertionError, match=words):
        check_vector_env(envs(), single, steps=50)


@pytest.mark.parametrize("mode", [NEXT, SAME, OFF])
def test_the_numpy_fleet_passes(mode, monkeypatch):
    monkeypatch.setattr("flatgym.envs.vector.make_fleet", NumpyFleet)
    scenario = replace(flatgym.scenario("ground-6"), time_limit=0.2)
    envs = FlatQuadVectorEnv(2, scenario=scenario, autoreset_mode=mode)
    assert type(envs.fleet) is NumpyFleet
    assert check_vector_env(envs, partial(gym.make, "FlatQuad-v0", scenario=scenario), steps=25) >= 4


def test_cartpole_passes_the_protocol_and_alone_the_lockstep():
    def make(n):
        return gym.make_vec("CartPole-v1", num_envs=n, vectorization_mode="vector_entry_point")

    assert check_vector_env(make(4), steps=200) > 10
    assert check_vector_env(make(1), lambda: gym.make("CartPole-v1"), steps=200) > 3
    with pytest.raises(AssertionError, match=r"reset, env \d: the observation\[\d\] is .* in the scalar environment"):
        check_vector_env(make(4), lambda: gym.make("CartPole-v1"), steps=1)


def test_final_observations_may_be_a_batch_or_an_object_array():
    class Batched(Walks):
        def step(self, actions):
            *results, infos = super().step(actions)
            if "final_obs" in infos:
                rows = [np.zeros(2, np.float32) if row is None else row for row in infos["final_obs"]]
                infos["final_obs"] = np.stack(rows)
            return *results, infos

    check_vector_env(Batched(SAME), Walk, steps=40)


def test_read_only_arrays_may_be_returned_repeatedly():
    class Thrifty(LendsItsState):
        def reset(self, **arguments):
            results = super().reset(**arguments)
            self.state.flags.writeable = False
            return results

    check_vector_env(Thrifty(NEXT), steps=20)
    with pytest.raises(AssertionError, match=r"infos\['state'\]"):
        check_vector_env(LendsItsState(NEXT), steps=20)


def test_given_actions_are_used_and_not_changed():
    actions = np.full((30, N, 1), 0.9)
    copy = actions.copy()
    episodes = check_vector_env(Walks(SAME), Walk, actions=actions)
    assert episodes == check_vector_env(Walks(SAME), Walk, actions=iter(actions), steps=10**6)
    assert episodes > check_vector_env(Walks(SAME), Walk, actions=actions, steps=10)
    np.testing.assert_array_equal(actions, copy)


def test_the_generator_of_the_action_space_is_not_used():
    envs, twin = Walks(), Walks()
    envs.action_space.seed(4)
    twin.action_space.seed(4)
    check_vector_env(envs, steps=3)
    np.testing.assert_array_equal(envs.action_space.sample(), twin.action_space.sample())
    assert envs.closed


@pytest.mark.parametrize(("off", "passes"), [(0.0, True), (5e-10, True), (2e-9, False)])
def test_numbers_may_differ_by_the_tolerance(off, passes):
    class Off(Walks):
        def step(self, actions):
            observations, rewards, *rest = super().step(actions)
            return observations, rewards + off * (rewards != 0), *rest

    if passes:
        check_vector_env(Off(), Walk, steps=20)
    else:
        with pytest.raises(AssertionError, match="the reward is"):
            check_vector_env(Off(), Walk, steps=20)
    with pytest.raises(AssertionError, match="the reward is") if off else pytest.MonkeyPatch.context():
        check_vector_env(Off(), Walk, steps=20, atol=0)


def test_float32_may_differ_by_one_rounding_unless_equality_is_required():
    class Coarse(Walks):
        def step(self, actions):
            observations, rewards, *rest = super().step(actions)
            return np.nextafter(observations, np.float32(0)), rewards.astype(np.float32), *rest

    check_vector_env(Coarse(), Walk, steps=20)
    with pytest.raises(AssertionError, match="step 1, env 0"):
        check_vector_env(Coarse(), Walk, steps=20, atol=0)


@pytest.mark.parametrize("arguments", [{"steps": 0}, {"atol": -1.0}, {"atol": float("nan")}, {"actions": []}])
def test_a_check_without_steps_is_rejected(arguments):
    with pytest.raises(ValueError, match="must"):
        check_vector_env(Walks(), Walk, **arguments)


# What is found


class SharesItsBuffer(Walks):
    """Returns one observation buffer again and again."""

    def __init__(self, mode):
        super().__init__(mode, copy=False)


class TakesTurnsWithBuffers(Walks):
    """Returns three reward buffers in turn."""

    def step(self, actions):
        observations, rewards, *rest = super().step(actions)
        self.buffers = getattr(self, "buffers", [np.zeros(N) for _ in range(3)])
        self.buffers.append(self.buffers.pop(0))
        self.buffers[0][:] = rewards
        return observations, self.buffers[0], *rest


class LendsItsState(Walks):
    """Keeps its state in an array which it hands out as info."""

    def reset(self, **arguments):
        observations, infos = super().reset(**arguments)
        self.state = np.zeros(N)
        return observations, infos | {"state": self.state, "_state": np.ones(N, dtype=bool)}

    def step(self, actions):
        observations, rewards, *flags, infos = super().step(actions)
        return observations, rewards, *flags, infos | {"state": self.state, "_state": np.ones(N, dtype=bool)}


class KeepsTheActions(Walks):
    """Delays the actions by a step, in the caller's own array."""

    def reset(self, **arguments):
        self.held = np.zeros((N, 1), np.float32)
        return super().reset(**arguments)

    def step(self, actions):
        held, self.held = self.held, actions
        return super().step(held)


class FliesOnAfterTheEnd(Walks):
    """Resets in the next step, but flies its action, too."""

    def step(self, actions):
        idle = self._autoreset_envs.copy()
        observations, *rest = super().step(actions)
        for i in np.flatnonzero(idle):
            observations[i] = self.envs[i].step(actions[i])[0]
        return observations, *rest


class PaysForTheReset(Walks):
    """Gives a reward in the step that resets."""

    def step(self, actions):
        idle = self._autoreset_envs.copy()
        observations, rewards, *rest = super().step(actions)
        return observations, np.where(idle, -1.0, rewards), *rest


class DropsFinalObservations(Walks):
    """Forgets final_obs."""

    def step(self, actions):
        *results, infos = super().step(actions)
        infos.pop("final_obs", None)
        return *results, infos


class MixesUpFinalObservations(Walks):
    """Gives the first observation of the new episode as the last of the old one."""

    def step(self, actions):
        observations, *flags, infos = super().step(actions)
        if "final_obs" in infos:
            infos["final_obs"] = observations.copy()
        return observations, *flags, infos


class MixesUpFinalInfos(Walks):
    """Gives the info of the new episode as the final one."""

    def step(self, actions):
        *results, infos = super().step(actions)
        if "final_info" in infos:
            infos["final_info"] = {key: value for key, value in infos.items() if "final" not in key}
        return *results, infos


class ForgetsToReset(Walks):
    """Returns the last observation of the old episode in place of the first of the new one."""

    def step(self, actions):
        observations, *flags, infos = super().step(actions)
        for i in np.flatnonzero(infos.get("_final_obs", [])):
            observations[i] = infos["final_obs"][i]
        return observations, *flags, infos


class IsTooPrecise(Walks):
    """Returns float64 where its space has float32."""

    def step(self, actions):
        observations, *rest = super().step(actions)
        return observations.astype(np.float64), *rest


class LeavesItsSpace(Walks):
    """Returns a nan now and then."""

    def step(self, actions):
        observations, *rest = super().step(actions)
        observations[1, 0] = np.nan if observations[1, 1] == 4 else observations[1, 0]
        return observations, *rest


class ChangesKeys(Walks):
    """Tells something more in each seventh step."""

    def step(self, actions):
        *results, infos = super().step(actions)
        self.count = getattr(self, "count", 0) + 1
        if self.count % 7 == 0:
            infos |= {"more": np.arange(N), "_more": np.ones(N, dtype=bool)}
        return *results, infos


class HasNoMasks(Walks):
    """Gives infos without their masks."""

    def step(self, actions):
        *results, infos = super().step(actions)
        return *results, {key: value for key, value in infos.items() if key != "_side"}


class TellsAnotherInfo(Walks):
    """Counts one step too many in its infos."""

    def step(self, actions):
        *results, infos = super().step(actions)
        infos["steps"][2] += 1
        return *results, infos


class TruncatesLate(Walks):
    """Flies one step more."""

    def __init__(self, mode):
        SyncVectorEnv.__init__(self, [partial(Walk, LIMIT + 1)] * N, autoreset_mode=mode)


class ClipsInPlace(Walks):
    """Changes the caller's actions."""

    def step(self, actions):
        actions *= 0.5
        return super().step(actions)


class IgnoresTheSeed(Walks):
    """Starts anywhere."""

    def reset(self, *, seed=None, options=None):  # noqa: ARG002
        return super().reset(options=options)


class SeedsAllAlike(Walks):
    """Knows one seed for all."""

    def reset(self, *, seed=None, options=None):
        return super().reset(seed=[seed] * N if isinstance(seed, int) else seed, options=options)


class TakesTheFirstOfTheSeeds(Walks):
    """Makes seed + i of a list of seeds."""

    def reset(self, *, seed=None, options=None):
        return super().reset(seed=seed[0] if isinstance(seed, list) else seed, options=options)


class ResetsAll(Walks):
    """Does not read the mask."""

    def reset(self, *, seed=None, options=None):  # noqa: ARG002
        return super().reset(seed=seed)


class RemembersTheEnd(Walks):
    """Resets once more when a reset came between the end and the next step."""

    def reset(self, **arguments):
        due = self._autoreset_envs
        results = super().reset(**arguments)
        if arguments["seed"] is None:
            self._autoreset_envs = due
        return results


class HasNoFlags(Walks):
    """Returns numbers for flags."""

    def step(self, actions):
        observations, rewards, terminated, *rest = super().step(actions)
        return observations, rewards, terminated.astype(int), *rest


class HasAWiderSpace(Walks):
    """Claims a batched space that is none of its single one."""

    def __init__(self, mode):
        super().__init__(mode)
        self.observation_space = Box(-99, 99, (N, 2), np.float32)


class KeepsItsModeToItself(Walks):
    """Does not tell its autoreset mode."""

    def __init__(self, mode):
        super().__init__(mode)
        self.metadata.pop("autoreset_mode")


FAULTS = [
    (SharesItsBuffer, NEXT, r"reset: observations\[0, 0\] is .*, before step 1 it was "),
    (TakesTurnsWithBuffers, SAME, r"step \d+: rewards\[\d\] is .*, before the end of the rollout it was "),
    (FliesOnAfterTheEnd, NEXT, r"step \d+, env \d: the observation\[0\] is .* in the scalar environment "),
    (PaysForTheReset, NEXT, r"step \d+, env \d: the reward in the step of the reset is -1.0, expected 0.0"),
    (DropsFinalObservations, SAME, r"step \d+, env \d: final_obs is missing, but the episode has ended"),
    (MixesUpFinalObservations, SAME, r"step \d+, env \d: final_obs\[0\] is .* in the scalar environment "),
    (MixesUpFinalInfos, SAME, r"step \d+, env \d: final_info\['place'\] is .* in the scalar environment "),
    (ForgetsToReset, SAME, r"step \d+, env \d: the observation\[0\] is .* in the scalar environment "),
    (IsTooPrecise, NEXT, r"step 1, env 0: the observation .*\(float64\) is not in Box\(.*float32\)"),
    (LeavesItsSpace, OFF, r"step \d+, env 1: the observation array\(\[nan, .* is not in Box"),
    (ChangesKeys, NEXT, r"step 7, env 0: info has the keys .*'more'.*, at earlier steps "),
    (HasNoMasks, NEXT, r"step 1: infos\['side'\] needs a mask of 3 booleans, infos\['_side'\], got None"),
    (TellsAnotherInfo, NEXT, r"step 1, env 2: info\['steps'\] is 2, in the scalar environment 1"),
    (TruncatesLate, NEXT, r"step \d+, env \d: truncated is False, in the scalar environment True"),
    (ClipsInPlace, NEXT, r"step 1: the actions\[0, 0\] is .*, before the step "),
    (IgnoresTheSeed, NEXT, r"reset, env 0: the observation\[0\] is .* in the scalar environment "),
    (SeedsAllAlike, NEXT, r"reset, env 1: the observation\[0\] is .* in the scalar environment "),
    (TakesTheFirstOfTheSeeds, NEXT, r"seeded with \[2, 1, 0\], reset, env 1: the observation\[0\] is "),
    (ResetsAll, OFF, r"reset after step \d+, env \d: the observation\[\d\] is .*, its reset_mask is False"),
    (RemembersTheEnd, NEXT, r"step \d+, env \d: the reward is 0.0, in the scalar environment "),
    (HasNoFlags, NEXT, r"step 1: terminated must be a NumPy array of 3 bools, got array\(\[0, 0, 0\]\)"),
    (
        HasAWiderSpace,
        NEXT,
        r"observation_space is Box\(-99.0.*, expected the batch of single_observation_space, Box\(-9",
    ),
    (KeepsItsModeToItself, NEXT, r"metadata\['autoreset_mode'\] must be an AutoresetMode, got None"),
]


@pytest.mark.parametrize(("faulty", "mode", "words"), FAULTS, ids=[faulty.__name__ for faulty, *_ in FAULTS])
def test_an_injected_fault_is_found_and_named(faulty, mode, words):
    check_vector_env(Walks(mode), Walk, steps=60)
    with pytest.raises(AssertionError, match=words):
        check_vector_env(faulty(mode), Walk, steps=60)


@pytest.mark.parametrize(
    ("faulty", "words"),
    [
        (FliesOnAfterTheEnd, r"repeated with other actions after the ends, step \d+, env \d: the observation\[0\]"),
        (IgnoresTheSeed, r"repeated with the same seed, reset, env 0: the observation\[0\] is .*, first "),
        (
            LendsItsState,
            r"repeated, returned arrays and actions overwritten after use, step 1: infos\['state'\]\[0\]",
        ),
        (KeepsTheActions, r"repeated, returned arrays and actions overwritten after use, step 2"),
        (PaysForTheReset, "the reward in the step of the reset is -1.0"),
    ],
)
def test_some_faults_are_found_without_a_scalar_environment(faulty, words):
    with pytest.raises(AssertionError, match=words):
        check_vector_env(faulty(NEXT), steps=60)


def test_another_scalar_environment_is_reported():
    class Wide(Walk):
        action_space = Box(-2, 2, (1,), np.float32)

    with pytest.raises(AssertionError, match=r"single_action_space is .* that of scalar environment 0 is"):
        check_vector_env(Walks(), Wide, steps=1)
