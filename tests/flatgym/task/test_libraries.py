"""NumPy, PyTorch and JAX fly the same: states, rewards, observations and outcomes, events included."""

from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import torch

from flatgym import DISTRIBUTIONS, OUTCOMES, SCENARIOS, Hoop, Quadrotor, Scenario, task
from flatgym.task.scene import EpisodeState, Scene

DRAWN = [distribution.scenario(seed) for distribution in DISTRIBUTIONS.values() for seed in range(10)]
SCENE = Scene.of([*SCENARIOS.values(), *DRAWN]).repeat(4)


def scattered(scene, generator, speed=6.0):
    """Return episodes and controls near everything a scene names, so that the next step meets events of all kinds."""
    n, most = scene.hoop_diameter.shape
    passed = generator.integers(0, scene.hoop_count + 1)
    which = np.minimum(passed, max(most - 1, 0))
    ahead = scene.hoop_centre[np.arange(n), which] if most else scene.goal
    place = np.where((passed < scene.hoop_count)[:, None], ahead, scene.goal)
    state = np.zeros((n, 5))
    state[:, 0:2] = place + generator.normal(0, 0.15, (n, 2))
    state[:, 1] = np.maximum(state[:, 1], np.maximum(scene.floor, -100.0))
    state[:, 2:5] = generator.normal(0, 1, (n, 3)) * [speed, speed, 1.5] * generator.random((n, 1))
    rest = generator.random(n) < 0.2
    state[rest, 0:2], state[rest, 2:5], passed[rest] = scene.goal[rest], 0.03, scene.hoop_count[rest]
    control = generator.uniform(scene.quadrotor.control_low, scene.quadrotor.control_high, (n, 2))
    return EpisodeState(state, generator.integers(0, scene.max_steps), passed, np.zeros(n, dtype=np.int64)), control


def step(scene, episode, control):
    after = task.advance(scene, episode, control)
    return after, task.observe(scene, after), task.reward(scene, episode, after, shaped=True)


def agree(ours, theirs, atol):
    (after, observation, reward), (other, their_observation, their_reward) = ours, theirs
    np.testing.assert_allclose(np.asarray(other.state), after.state, atol=atol)
    np.testing.assert_allclose(np.asarray(their_reward), reward, atol=atol)
    np.testing.assert_allclose(np.asarray(their_observation), observation, atol=max(atol, 2e-7))
    assert their_observation.dtype in (torch.float32, np.float32)
    for name in ("steps", "hoops_passed", "outcome"):
        np.testing.assert_array_equal(np.asarray(getattr(other, name)), getattr(after, name), err_msg=name)


@pytest.fixture
def double():
    with jax.enable_x64(True):
        yield


@pytest.fixture(scope="module")
def jitted():
    return jax.jit(step)


@pytest.mark.usefixtures("double")
def test_all_libraries_fly_all_scenarios_alike(jitted):
    generator, met, passed = np.random.default_rng(0), np.zeros(len(OUTCOMES), dtype=int), 0
    for _ in range(8):
        episode, control = scattered(SCENE, generator)
        ours = step(SCENE, episode, control)
        agree(ours, step(SCENE.to(torch), episode.to(torch), torch.asarray(control)), 1e-10)
        agree(ours, jitted(SCENE.to(jnp), episode.to(jnp), jnp.asarray(control)), 1e-10)
        met += np.bincount(ours[0].outcome, minlength=len(OUTCOMES))
        passed += int((ours[0].hoops_passed - episode.hoops_passed).sum())
    assert passed > 30
    assert all(met[OUTCOMES.index(word)] for word in ("goal", "floor", "time-limit")), met


@pytest.mark.usefixtures("double")
def test_bodies_collide_alike_on_long_steps_through_several_hoops():
    hoops = tuple(Hoop(0.3 * i, 0.1 * i, 1.0, 0.4 * i) for i in range(1, 3))
    bodies = Scenario(
        "bodies", (0, 0), (6, 0), hoops, ceiling=1.5, dt=0.3, quadrotor=Quadrotor(rate_max=20.0, radius=0.15)
    )
    scene = Scene.of([bodies]).repeat(40)
    episode, control = scattered(scene, np.random.default_rng(1))
    ours = step(scene, episode, control)
    assert {"collision", "flying"} <= {OUTCOMES[code] for code in ours[0].outcome}
    agree(ours, step(scene.to(torch), episode.to(torch), torch.asarray(control)), 1e-10)
    agree(ours, jax.jit(step)(scene.to(jnp), episode.to(jnp), jnp.asarray(control)), 1e-10)
    points = replace(scene, quadrotor=Quadrotor(rate_max=20.0))
    episode.state[:10], episode.hoops_passed[:10] = [0, 0, 4, 2, 0], 0
    ours = step(points, episode, control)
    assert (ours[0].hoops_passed - episode.hoops_passed).max() == 2
    agree(ours, step(points.to(torch), episode.to(torch), torch.asarray(control)), 1e-10)


def test_single_precision_meets_the_same_outcomes():
    generator, differ, total = np.random.default_rng(2), 0, 0
    for _ in range(8):
        episode, control = scattered(SCENE, generator)
        ours = step(SCENE, episode, control)[0]
        single = SCENE.to(torch, torch.float32), episode.to(torch, torch.float32), torch.asarray(control).float()
        after, observation, reward = step(*single)
        assert after.state.dtype == reward.dtype == observation.dtype == torch.float32
        np.testing.assert_allclose(after.state, ours.state, atol=1e-5)
        differ += int(np.sum(after.outcome.numpy() != ours.outcome))
        differ += int(np.sum(after.hoops_passed.numpy() != ours.hoops_passed))
        total += len(SCENE)
    assert differ <= 1e-3 * total


def test_a_step_is_one_graph_of_torch_compile():
    # Dynamo traces, and no backend compiles: that would take minutes.
    scene = Scene.of([SCENARIOS["hoop"]]).repeat(3).to(torch)
    state = torch.tensor([[2.45, 2.5, 6.0, 0.0, 0.1], [2.45, 2.9, 6, 0, 0], [0, 0, 0, 0, 0]], dtype=torch.float64)
    episode, control = replace(task.initial(scene), state=state), torch.tensor([[9.0, 1.0]] * 3)
    traced = torch.compile(task.advance, backend="eager", fullgraph=True)(scene, episode, control)
    plain = task.advance(scene, episode, control)
    assert traced.hoops_passed.tolist() == plain.hoops_passed.tolist() == [1, 0, 0]
    assert torch.equal(traced.state, plain.state)
    assert torch.equal(traced.outcome, plain.outcome)


LIBRARIES = {"numpy": np, "torch": torch, "jax": jnp}


@pytest.fixture(params=LIBRARIES)
def arrays(request):
    """A scene of three vehicles, its first episodes and hover, in each library."""
    xp = LIBRARIES[request.param]
    scene = Scene.of([SCENARIOS["diagonal"]] * 3).to(xp, dtype=xp.float32)
    return xp, scene, task.initial(scene), xp.asarray([[9.81, 0.0]] * 3, dtype=xp.float32)


def test_a_control_that_is_not_finite_ends_the_episode_where_it_is(arrays):
    xp, scene, episode, control = arrays
    wrong = xp.asarray([[np.nan, 0.0], [9.81, np.inf], [9.81, 0.0]], dtype=control.dtype)
    after = (jax.jit if xp is jnp else lambda function: function)(task.advance)(scene, episode, wrong)
    assert [OUTCOMES[code] for code in after.outcome.tolist()] == ["out-of-bounds", "out-of-bounds", "flying"]
    np.testing.assert_array_equal(np.asarray(after.state), np.asarray(episode.state))
    assert np.isfinite(np.asarray(task.reward(scene, episode, after, shaped=True))).all()


@pytest.mark.parametrize("kind", ["int32", "float16"])
def test_states_of_integers_and_half_precision_are_refused(arrays, kind):
    xp, scene, episode, control = arrays
    wrong = replace(episode, state=xp.asarray(np.zeros((3, 5), dtype=kind)))
    with pytest.raises(TypeError, match=f"state must be float64 or float32, got {kind}"):
        task.advance(scene, wrong, control)


def test_arrays_of_two_libraries_are_refused(arrays):
    xp, scene, episode, _ = arrays
    other = torch.zeros(3, 2) if xp is np else np.zeros((3, 2))
    with pytest.raises(TypeError, match=r"must belong to one library, got .*; move a scene with Scene\.to"):
        task.advance(scene, episode, other)


def test_arrays_on_two_devices_are_refused():
    scene = Scene.of([SCENARIOS["hoop"]]).to(torch)
    with pytest.raises(ValueError, match="must be on one device, got state on cpu, scene on cpu, control on meta"):
        task.advance(scene, task.initial(scene), torch.zeros(1, 2, dtype=torch.float64, device="meta"))


@pytest.mark.parametrize("make", [partial(jax.jit, static_argnums=0), lambda function: function])
def test_a_scenario_cannot_be_drawn_under_jit(make):
    drawn = DISTRIBUTIONS["random-hoops"]
    with pytest.raises(TypeError, match="seed must be a whole number, got an array of jax"):
        make(lambda problem, seed: problem.scenario(seed).goal)(drawn, jnp.asarray(3))
    with pytest.raises(TypeError, match="got an array of torch"):
        drawn.scenario(torch.asarray(3))


def test_gradients_do_not_flow_into_the_search_for_events():
    scene = Scene.of([SCENARIOS["hoop"]]).to(torch)
    state = torch.tensor([[2.45, 2.5, 6.0, 0.0, 0.1]], dtype=torch.float64, requires_grad=True)
    after = task.advance(scene, replace(task.initial(scene), state=state), torch.tensor([[9.0, 1.0]]))
    assert after.hoops_passed.tolist() == [1]
    after.state.sum().backward()
    assert torch.isfinite(state.grad).all()
