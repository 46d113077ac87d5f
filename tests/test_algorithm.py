"""Algorithm 1 as a whole, on a body so simple that nothing else can be at fault."""

import dataclasses
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest

from everystate import algorithm
from everystate.hyperparameters import FlowFamily
from everystate.learning.draws import draw
from everystate.learning.episodes import WANDER
from everystate.learning.goals import choose_goals
from everystate.learning.keys import named
from everystate.learning.models import Scale, Space
from everystate.learning.replay import Transitions
from everystate.presets import preset
from small import of_paper

# Of more than one test, for its update is one of the programs that take long to compile.
PURSUING = of_paper(epochs=100, pursued_share=1.0)


def drift(config, key, steps):
    """Transitions [steps, bodies, ...] of points that move by a tenth of their action."""
    shape = (steps, config.num_bodies, 2)
    actions = jax.random.uniform(key, shape, minval=-1, maxval=1)
    after = jnp.cumsum(0.1 * actions, axis=0)
    before = jnp.concatenate([jnp.zeros((1, *shape[1:])), after[:-1]])
    return Transitions(before, actions, after, after)


def start(config):
    key = jax.random.key(config.seed)
    scale = Scale(jnp.zeros(2), jnp.full(2, 0.5))
    warmup = drift(config, key, config.warmup_steps)
    return algorithm.init(config, Space(2, 2), warmup, scale, key=key)


def act_at(config, state, draws, step, episodes, observations):
    now = jax.tree.map(lambda x: x[step], draws)
    actor = state.actor
    return eqx.filter_jit(algorithm.act)(config, actor, episodes, now, observations)


def leaves(state):
    arrays = jax.tree.leaves(eqx.filter(state._replace(key=None), eqx.is_array))
    return [np.asarray(x) for x in arrays]


@pytest.mark.parametrize(
    "flow",
    [
        "pldu",
        "coupling-affine",
        pytest.param("coupling-spline", marks=pytest.mark.slow),
        pytest.param("autoregressive-spline", marks=pytest.mark.slow),
    ],
)
def test_an_epoch_runs_with_every_flow_and_keeps_types(flow: FlowFamily):
    config = of_paper(flow=flow)
    state = start(config)
    draws = eqx.filter_jit(draw)(config, state)
    episodes, actions = act_at(config, state, draws, 0, state.episodes, jnp.zeros((10, 2)))
    after = state._replace(episodes=episodes)
    after, metrics, _ = eqx.filter_jit(algorithm.update)(config, after)
    assert actions.shape == (10, 2)
    assert np.all(np.abs(actions) <= 1)
    assert all(np.isfinite(value) for value in metrics.values()), metrics
    assert int(after.epoch) == 1
    assert int(after.copies) == 2
    # A dtype that changes would compile the next epoch anew.
    for old, new in zip(leaves(state), leaves(after), strict=True):
        assert (old.shape, old.dtype) == (new.shape, new.dtype)


def test_the_goals_of_an_epoch_are_those_chosen_step_by_step():
    config = of_paper(steps_per_epoch=4)
    state = start(config)._replace(epoch=jnp.int32(3))
    draws = eqx.filter_jit(draw)(config, state)
    assert draws.goals.shape == (4, 10, 2)
    choose = eqx.filter_jit(choose_goals)
    for i, goals in enumerate(draws.goals):
        key = named(named(state.key, "act", 3 * 4 + i), "goals")
        expected = choose(config, state.models, state.replay, key=key)
        np.testing.assert_allclose(goals, expected, rtol=1e-5, atol=1e-6)


def test_an_oracles_goals_fill_the_box_of_all_states():
    config = of_paper(goals="uniform", m=1, steps_per_epoch=20)
    goals = eqx.filter_jit(draw)(config, start(config)).goals.reshape(-1, 2)
    assert np.abs(goals).max() <= np.sqrt(3)
    np.testing.assert_allclose(np.std(goals, axis=0), 1, atol=0.15)
    quarters = {tuple(np.sign(goal)) for goal in np.asarray(goals)}
    assert len(quarters) == 4


def test_same_seed_same_update_bit_for_bit():
    config = of_paper()
    update = eqx.filter_jit(algorithm.update)
    first, second = (update(config, start(config))[0] for _ in range(2))
    assert all(np.array_equal(a, b) for a, b in zip(leaves(first), leaves(second), strict=True))
    other = update(config, start(of_paper(seed=1)))[0]
    assert not all(np.array_equal(a, b) for a, b in zip(leaves(first), leaves(other), strict=True))


def test_every_model_learns_from_every_update():
    config = of_paper()
    state = start(config)
    after, *_ = eqx.filter_jit(algorithm.update)(config, state)
    every: tuple[dict[str, Any], ...] = tuple(s.models._asdict() for s in (state, after))
    for name, models in every[0].items():
        several = models if type(models) is tuple else (models,)
        others = every[1][name] if type(models) is tuple else (every[1][name],)
        for one, other in zip(several, others, strict=True):
            pairs = (jax.tree.leaves(eqx.filter(m, eqx.is_array)) for m in (one, other))
            assert not all(map(np.array_equal, *pairs)), name


def test_targets_stay_within_their_bounds():
    config = of_paper()
    state = start(config)
    update = eqx.filter_jit(algorithm.update)
    for _ in range(3):
        state, metrics, _ = update(config, state)
        assert -(float(state.copies) + 1) <= float(metrics["value/target_min"]) <= 0


@pytest.mark.parametrize("name", [pytest.param("literal", marks=pytest.mark.slow), "paper"])
def test_presets_of_the_paper_run(name):
    small: dict[str, Any] = {
        "capacity": 4000,
        "batch_size": 20,
        "N": 3,
        "num_updates": 1,
        "target_period": 1,
        "depth": 1,
        "width": 16,
    }
    config = preset(name, **small, num_bodies=10, steps_per_epoch=5)
    _, metrics, _ = eqx.filter_jit(algorithm.update)(config, start(config))
    assert np.isfinite(float(metrics["loss/f"]))


def test_who_wanders_keeps_to_random_actions_for_a_while_and_others_do_as_ever():
    config = of_paper(wander_share=0.5, wander_steps=2, steps_per_epoch=8)
    state, seen = start(config), jnp.zeros((10, 2))
    draws = eqx.filter_jit(draw)(config, state)
    taken, policys, wanders, episodes = [], [], [], state.episodes
    for step in range(8):
        _, policy = act_at(config, state, draws._replace(anywhere=None), step, episodes, seen)
        episodes, action = act_at(config, state, draws, step, episodes, seen)
        taken.append(action)
        policys.append(policy)
        wanders.append(np.asarray(episodes.objectives) == WANDER)
    taken, policys, wanders = np.stack(taken), np.stack(policys), np.stack(wanders)
    assert (wanders == wanders[0]).all(), "for longer than these steps"
    assert 0 < wanders[0].mean() < 1
    np.testing.assert_array_equal(taken[~wanders], policys[~wanders])
    assert (taken[wanders] != policys[wanders]).any(axis=1).all()
    pairs = taken.reshape(4, 2, 10, 2)[:, :, wanders[0]]
    assert (pairs[:, 0] == pairs[:, 1]).all(), "for two steps"
    assert (pairs[1:, 0] != pairs[:-1, 0]).any(axis=2).all(), "then others"


def test_further_steps_of_d_and_imagined_steps_leave_f_alone():
    further = {"dynamics_updates": 6, "imagined_steps": 2}
    moved = ("dynamics", "policies", "values", "curriculum")  # c by what V is to become
    few, more = PURSUING, dataclasses.replace(PURSUING, **further)
    update = eqx.filter_jit(algorithm.update_once)
    (once, _, _), (often, metrics, _) = (
        update(config, start(config), key=jax.random.key(5)) for config in (few, more)
    )
    for name, one, other in zip(once.models._fields, once.models, often.models, strict=True):
        pairs = zip(
            *(jax.tree.leaves(eqx.filter(m, eqx.is_array)) for m in (one, other)), strict=True
        )
        assert all(np.array_equal(a, b) for a, b in pairs) == (name not in moved)
    optimisers: Any = often.optimisers
    counts = [int(optax.tree.get(state[1][0], "count")) for state in optimisers]
    assert counts == [1, 6, 1, 1, 1]
    assert np.isfinite(float(metrics["loss/d_practice"]))
    assert float(metrics["loss/imagined"]) > 0


@pytest.mark.slow
def test_dynamics_that_practise_are_learned_sooner():
    losses, last = [], 0.0
    for steps in (1, 6):
        config = of_paper(dynamics_updates=steps)
        state, update = start(config), eqx.filter_jit(algorithm.update)
        for _ in range(3):
            state, metrics, _ = update(config, state)
            last = float(metrics["loss/d"])
        losses.append(last)
    assert losses[1] < losses[0] - 0.1


def test_goals_pursued_are_learned_of_where_they_were_pursued():
    """With share 1 every pair (s, g) is one that a body had; with share 0 the ring keeps none."""
    config = PURSUING
    state = start(config)
    held = state.replay.transitions
    assert held.goals.shape == held.observations.shape
    # At warm-up a body is on its way to where it came.
    filled = int(state.replay.size)
    np.testing.assert_array_equal(held.goals[:filled], held.next_observations[:filled])
    _, _, batch = eqx.filter_jit(algorithm.update_once)(config, state, key=jax.random.key(1))
    pairs = {tuple(p) for p in np.hstack([held.observations, held.goals])[:filled].tolist()}
    drawn = np.hstack([batch.starts, batch.minibatch.goals])
    assert all(tuple(pair) in pairs for pair in drawn.tolist())
    assert start(of_paper(pursued_share=0.0)).replay.transitions.goals.shape[-1] == 0


def test_some_bodies_act_by_the_centre_of_the_policy():
    config = of_paper(central_share=0.5, num_bodies=100, steps_per_epoch=3)
    config = dataclasses.replace(config, capacity=4_000)
    latents = np.asarray(eqx.filter_jit(draw)(config, start(config)).latents)
    central = (latents == 0).all(axis=-1)
    assert (central == central[0]).all()  # for the whole epoch
    assert 0.3 < central[0].mean() < 0.7
    assert (latents[:, ~central[0]] != 0).all()
