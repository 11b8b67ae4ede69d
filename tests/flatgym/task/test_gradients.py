"""Gradients of JAX and PyTorch against central differences and against CasADi, events included."""

from dataclasses import replace

import casadi as ca
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import torch

from flatgym import SCENARIOS, Quadrotor, task
from flatgym.arc import Arc
from flatgym.task.scene import Scene
from optimal.direct.transcription import step_function

COUNT, WIDTH = 1000, 1e-4


@pytest.fixture(autouse=True)
def double():
    with jax.enable_x64(True):
        yield


def states_and_controls(generator, near=(0.0, 0.0), spread=0.3, count=COUNT):
    state = generator.normal(0, [spread, spread, 3, 3, 1.5], (count, 5))
    state[:, 0:2] += near
    control = generator.uniform(Quadrotor().control_low, Quadrotor().control_high, (count, 2))
    return np.concatenate([state, control], axis=1)


def differences(function, inputs, width=WIDTH):
    """Return the derivatives of rows (n, m) -> (n,) by differences of fourth order, shape (n, m)."""
    columns = []
    for i in range(inputs.shape[1]):
        step = np.zeros(inputs.shape[1])
        step[i] = width
        near, far = (function(inputs + k * step) - function(inputs - k * step) for k in (1, 2))
        columns.append((8 * near - far) / (12 * width))
    return np.stack(columns, axis=-1)


def gradients(function, inputs):
    """Return the derivatives by JAX and by PyTorch, each shape (n, m); rows do not depend on each other."""
    ours = jax.jit(jax.grad(lambda values: jnp.nansum(function(jnp, values))))(jnp.asarray(inputs))
    leaf = torch.tensor(inputs, requires_grad=True)
    torch.nansum(function(torch, leaf)).backward()
    return np.asarray(ours), leaf.grad.numpy()


def check(function, inputs, smooth=None):
    """Compare where the function is smooth; the error is relative to the largest derivative of the row."""
    expected = differences(lambda values: function(np, values), inputs)
    rows = np.isfinite(expected).all(axis=1) if smooth is None else smooth
    scale = np.abs(expected[rows]).max(axis=1, keepdims=True) + 1e-3
    for found in gradients(function, inputs):
        assert np.max(np.abs(found[rows] - expected[rows]) / scale) < 1e-6
    return rows


def test_the_final_state_by_state_and_controls(generator):
    weights = generator.normal(size=5)

    def final(xp, values):
        state, control = values[:, 0:5], values[:, 5:7]
        for _ in range(3):
            state = Quadrotor().step(state, control, 0.02)
        return (state * (weights if xp is np else xp.asarray(weights))).sum(-1)

    assert check(final, states_and_controls(generator)).all()


def test_the_step_equals_casadi(generator):
    inputs = states_and_controls(generator)[:20]
    state, control = ca.SX.sym("state", 5), ca.SX.sym("control", 2)
    after = step_function()(state, control, 0.02, Quadrotor().gravity)
    jacobian = ca.Function("jacobian", [state, control], [ca.jacobian(after, ca.vertcat(state, control))])
    expected = np.array([np.array(jacobian(row[:5], row[5:])) for row in inputs])
    step = jax.vmap(jax.jacobian(lambda row: Quadrotor().step(row[:5], row[5:], 0.02)))
    np.testing.assert_allclose(step(jnp.asarray(inputs)), expected, atol=1e-12)


def returns(xp, values):
    """Return the shaped return of one step through the task, hoop and outcome included."""
    scene = Scene.of([SCENARIOS["hoop"]] * len(values)).to(xp)
    before = replace(task.initial(scene), state=values[:, 0:5])
    return task.reward(scene, before, task.advance(scene, before, values[:, 5:7]), shaped=True)


def test_the_return_through_the_task_where_no_hoop_is_passed_or_missed(generator):
    # Where the number of hoops passed changes, the return jumps; where the direction that bounds the time to go
    # changes, it bends. There, differences of two widths disagree.
    inputs = states_and_controls(generator, (2.5, 2.5), count=1350)
    coarse, fine = (differences(lambda values: returns(np, values), inputs, WIDTH / k) for k in (1, 2))
    smooth = np.abs(coarse - fine).max(axis=1) < 1e-6 * np.abs(fine).max(axis=1)
    assert smooth.sum() >= COUNT
    scene = Scene.of([SCENARIOS["hoop"]] * len(inputs))
    before = replace(task.initial(scene), state=inputs[:, 0:5])
    assert task.advance(scene, before, inputs[:, 5:7]).hoops_passed[smooth].sum() > 10
    check(returns, inputs, smooth)


def crossing(which):
    """Return the time of crossing a slanted line within a long step, or the place of it."""

    def function(xp, values):
        arc = Arc(Quadrotor(), values[:, 0:5], values[:, 5:7], 0.1)
        line = np.array([0.1, -0.05]), np.array([np.cos(0.7), np.sin(0.7)])
        point, direction = (np.broadcast_to(one, (len(values), 2)) for one in line)
        if xp is not np:
            point, direction = xp.asarray(point.copy()), xp.asarray(direction.copy())
        time = arc.crossing(point, direction, arc.dt * 0)
        x, z = arc.components(time)[:2]
        return time if which == "time" else x * np.sin(0.7) - z * np.cos(0.7)

    return function


@pytest.mark.parametrize("which", ["time", "place"])
def test_crossing_times_and_places(which, generator):
    inputs, function = states_and_controls(generator, spread=0.15), crossing(which)
    times = crossing("time")(np, inputs)
    arc = Arc(Quadrotor(), inputs[:, 0:5], inputs[:, 5:7], 0.1)
    vx, vz = arc.components(times)[2:4]
    crosses = np.isfinite(differences(lambda values: function(np, values), inputs)).all(axis=1)
    steep = crosses & (vx * np.cos(0.7) + vz * np.sin(0.7) > 0.5)  # along the line the time has no derivative
    assert steep.sum() > 100
    check(function, inputs, steep)


def test_a_passage_has_a_gradient_and_nowhere_is_nan():
    scene = Scene.of([SCENARIOS["hoop"], SCENARIOS["hoop"]]).to(torch)
    state = torch.tensor([[2.45, 2.5, 6.0, 0.0, 0.1], [0, 0, 0, 0, 0]], dtype=torch.float64, requires_grad=True)
    time, aside = task.passage(scene, replace(task.initial(scene), state=state), torch.tensor([[9.0, 1.0]] * 2))
    assert 0 < time[0] < 0.02
    assert torch.isnan(time[1])
    assert torch.isnan(aside[1])
    time[0].backward()
    assert state.grad[0, 0] == pytest.approx(-1 / 6, rel=0.01)
    assert not state.grad[1].any()
