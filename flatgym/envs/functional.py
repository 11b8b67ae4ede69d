"""FlatQuad in Gymnasium's functional API: five pure verbs over JAX arrays, for one vehicle, to be vmapped and jitted.

    from gymnasium.envs.functional_jax_env import FunctionalJaxEnv, FunctionalJaxVectorEnv
    env = FunctionalJaxEnv(FlatQuadFuncEnv("hoop"))
    envs = FunctionalJaxVectorEnv(FlatQuadFuncEnv("random-hoops"), num_envs=64, max_episode_steps=250)

The state is one array, because Gymnasium's vector form resets by assigning rows of an array: x, z, vx, vz, theta,
steps, hoops passed, index of the outcome; with a distribution also the sampled scenario, in the layout of
`flatgym.scenarios.layouts`. The precision is JAX's own: single, or double with `jax_enable_x64`.

The words of a key are the seed: `initial(jax.random.PRNGKey(7))` draws what `gym.make` draws for seed 7.

Under `jax.vmap` the search for events runs for all vehicles as soon as one needs it. The functions of `flatgym.task`
take batches and run it for those few only, which is faster.
"""

from __future__ import annotations

from functools import cache, partial
from typing import Any

from flatgym.extras import require

require("jax", "jax", "array_api_compat")

import jax
import jax.numpy as jnp
from gymnasium.experimental.functional import FuncEnv

from flatgym import task
from flatgym.envs.config import EnvConfig
from flatgym.envs.spaces import action_space, controls_of, observation_space
from flatgym.scenarios import catalogue
from flatgym.scenarios.catalogue import DEFAULT_SCENARIO, Problem, ProblemLike
from flatgym.scenarios.distributions import Distribution
from flatgym.task.drawing import draw_rows, placed_scene
from flatgym.task.scene import GOAL, EpisodeState, Scene

STATE, STEPS, HOOPS_PASSED, OUTCOME, SCENE = slice(0, 5), 5, 6, 7, 8
"""Layout of the state: the first index or the slice of each part."""


class FlatQuadFuncEnv(FuncEnv[Any, Any, Any, Any, Any, Any, Any]):
    """Pure functions of one vehicle. `params` is a scenario or a distribution, by default that of the constructor.

    Args:
        scenario, reward, observation: as in FlatQuadEnv.

    `terminal` is true when the episode has ended other than by the time limit. Gymnasium's environments count the time
    limit themselves: `TimeLimit(env, 250)`, `FunctionalJaxVectorEnv(..., max_episode_steps=250)`. An action that is not
    finite ends the episode out of bounds, because nothing can be raised under `jax.jit`. All verbs are jitted.

    Raises:
        ValueError: naming the argument, its value and what is allowed.
    """

    def __init__(
        self, scenario: ProblemLike = DEFAULT_SCENARIO, reward: str = "shaped", observation: str = "features"
    ) -> None:
        self.config = EnvConfig(catalogue.problem(scenario), reward, observation)
        self.observation_space, self.action_space = observation_space(observation), action_space()
        super().__init__()
        self.transform(partial(jax.jit, static_argnames="params"))

    def get_default_params(self, **_: Any) -> Problem:
        """Return the scenario or the distribution."""
        return self.config.problem

    def initial(self, rng: Any, params: Problem | None = None) -> Any:
        """Return the state at the start of an episode, shape (8,), or more with a distribution.

        Args:
            rng: a key of JAX, whose two words are the seed; or four words, those of the seed and of the episode.
            params: scenario or distribution.
        """
        problem, real = self._problem(params), jnp.zeros(()).dtype
        start = jnp.zeros(SCENE, dtype=real)
        if not isinstance(problem, Distribution):
            return start.at[0:2].set(jnp.asarray(problem.start, dtype=real))
        key = rng if jnp.issubdtype(rng.dtype, jnp.integer) else jax.random.key_data(rng)
        address = [word[None] for word in jnp.concatenate([key, jnp.zeros(4 - key.shape[0], dtype=key.dtype)])]
        rows = draw_rows(problem, (address[0], address[1]), (address[2], address[3]), real)
        return jnp.concatenate([start, rows[0]])

    def transition(self, state: Any, action: Any, rng: Any, params: Problem | None = None) -> Any:
        """Return the state after one step of dt; `rng` has no effect."""
        scene, before = self._unpack(state, params)
        control = controls_of(scene.quadrotor, jnp.asarray(action, dtype=state.dtype))
        return _pack(task.advance(scene, before, control[None]), state)

    def observation(self, state: Any, rng: Any, params: Problem | None = None) -> Any:
        """Return the observation, shape (19,) or (5,), float32."""
        return task.observe(*self._unpack(state, params), self.config.observation)[0]

    def reward(self, state: Any, action: Any, next_state: Any, rng: Any, params: Problem | None = None) -> Any:
        """Return the reward of the step between two states [s]."""
        (scene, before), (_, after) = self._unpack(state, params), self._unpack(next_state, params)
        return task.reward(scene, before, after, self.config.shaped)[0]

    def terminal(self, state: Any, rng: Any, params: Problem | None = None) -> Any:
        """Return whether the episode has ended other than by the time limit."""
        return self._unpack(state, params)[1].terminated[0]

    def state_info(self, state: Any, params: Problem | None = None) -> dict[str, Any]:
        """Return the entries of FlatQuadEnv's info but for K*, the outcome as an index into `flatgym.OUTCOMES`."""
        outcome = state[..., OUTCOME].astype(int)
        return {
            "state": state[..., STATE],
            "time": state[..., STEPS] * self._problem(params).dt,
            "steps": state[..., STEPS].astype(int),
            "hoops_passed": state[..., HOOPS_PASSED].astype(int),
            "is_success": outcome == GOAL,
            "outcome": outcome,
        }

    def transition_info(
        self, state: Any, action: Any, next_state: Any, params: Problem | None = None
    ) -> dict[str, Any]:
        """Return the infos of the state after a step, of one vehicle or of a batch."""
        return self.state_info(next_state, params)

    def _problem(self, params: Problem | None) -> Problem:
        """Return the scenario or distribution; arrays of JAX cannot stand for one."""
        problem: Any = self.default_params if params is None else params
        if any(isinstance(leaf, jax.core.Tracer) for leaf in jax.tree.leaves(problem)):
            raise TypeError("params are plain values, not arrays: mark them static, as in jax.jit(f, static_argnums=3)")
        return catalogue.problem(problem)

    def _unpack(self, state: Any, params: Problem | None) -> tuple[Scene, EpisodeState]:
        """Return the scene of one vehicle and its episode."""
        problem = self._problem(params)
        if isinstance(problem, Distribution):
            scene = placed_scene(problem, state[None, SCENE:])
        else:
            scene = _host_scene(problem).to(jnp, state.dtype)
        steps, passed, outcome = (state[None, i].astype(int) for i in (STEPS, HOOPS_PASSED, OUTCOME))
        return scene, EpisodeState(state=state[None, STATE], steps=steps, hoops_passed=passed, outcome=outcome)


@cache
def _host_scene(problem: Any) -> Scene:
    return Scene.of([problem])


def _pack(episode: EpisodeState, before: Any) -> Any:
    """Return the state as one array; the sampled scenario stays as it is before the step."""
    counts = jnp.stack([episode.steps[0], episode.hoops_passed[0], episode.outcome[0]]).astype(before.dtype)
    return jnp.concatenate([episode.state[0], counts, before[SCENE:]])
