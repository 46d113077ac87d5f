"""One update of presets `literal` and `paper` is the paper's own, to the last digits of float64.

The same models, minibatch and random numbers go through `algorithm.update_once` and through
`transliteration.py`; nothing else is shared but the keys by which those numbers are drawn.
"""

import functools
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from flowjax.bijections import Chain, Invert, Scan

import transliteration as paper
from everystate import algorithm
from everystate.config import Config
from everystate.learning import guard, policy
from everystate.learning import replay as rb
from everystate.learning.keys import named
from everystate.learning.models import Models, Scale, Space, trainable
from everystate.learning.replay import Transitions
from everystate.learning.state import AgentState
from everystate.presets import preset

STATE, ACTION = 3, 2
SIZES: dict[str, Any] = {
    "j": 2,
    "N": 5,
    "k": 0.3,  # At the paper's 10 nothing that is imagined here is near any goal.
    "batch_size": 16,
    "width": 8,
    "depth": 2,
    "state_layers": 4,
    "curriculum_layers": 5,
    "capacity": 400,
    "num_bodies": 10,
    "steps_per_epoch": 10,
    "warmup_steps": 20,
    "num_updates": 10,
    "target_period": 10,
}
OF_PRESET: dict[str, dict[str, Any]] = {
    "literal": {},
    "paper": {"max_gradient_step": 0.005},  # At its 1 no step here is too long.
}
TIGHT: dict[str, Any] = {"rtol": 1e-8, "atol": 1e-10}
NAMES = dict(zip(Models._fields, ("f", "d", "pi", "c", "V"), strict=True))
"""The paper's names of our models."""
FIXED = ("sign", "shift", "change_scale", "weights")
"""Numbers that are not learned: d_sgn, the shift that preset `paper` lacks [D7], a unit."""


class Both(NamedTuple):
    """One update, by us and by the page, from the same state."""

    config: Config
    before: Any
    after: Any
    """`AgentState`s of NumPy's arrays."""
    metrics: dict[str, Any]
    batch: Any
    next_states: Any
    outcomes: Any
    gradients: Models
    models: Models
    """Those before, of complex arrays, of which the page's are views."""
    page: paper.Update
    add: paper.Stabilisers


# --- Our side -------------------------------------------------------------------------------------


def moving(config: Config) -> Transitions:
    """Transitions [steps, bodies, ...] of bodies that drift around, a little at random."""
    random = np.random.default_rng(5)
    shape = config.warmup_steps, config.num_bodies
    actions = random.uniform(-1, 1, (*shape, ACTION)).astype(np.float32)
    path = [random.normal(0, 1, (config.num_bodies, STATE))]
    turn = np.array([[0.9, 0.3, 0], [-0.3, 0.9, 0], [0, 0.4, 0.8]])
    for a in actions:
        push = np.stack([a[:, 0], a[:, 1], a[:, 0] * a[:, 1]], axis=1)
        path.append(path[-1] @ turn.T + 0.4 * push + random.normal(0, 0.1, push.shape))
    states = jnp.asarray(np.array(path, np.float32))
    return Transitions(states[:-1], jnp.asarray(actions), states[1:], states[1:])


@functools.cache
def fresh() -> AgentState:
    """But for all that is learned, which is shaken: no symmetry hides anything."""
    config, scale = preset("paper", **SIZES), Scale(jnp.zeros(STATE), jnp.ones(STATE))
    space, key = Space(STATE, ACTION), jax.random.key(1)
    state = eqx.filter_jit(algorithm.init)(config, space, moving(config), scale, key=key)
    random = np.random.default_rng(6)

    def shaken(path: Any, x: Any) -> Any:
        if not eqx.is_inexact_array(x) or is_fixed(path):
            return x
        return x + jnp.asarray(random.normal(0, 0.2, x.shape), jnp.float32)

    models, target = jax.tree_util.tree_map_with_path(
        shaken, (state.models, state.target_values[0])
    )
    # V_targ spread out: where it is asked, within its bounds after one copy and beyond either.
    states = moving(config).observations.reshape(-1, STATE)
    values = jax.vmap(target)(states, states[::-1])
    spread = 1.2 / jnp.std(values)
    last = target.network.mlp.layers[-1]
    moved = last.weight * spread, (last.bias - jnp.mean(values)) * spread + 0.1
    target = eqx.tree_at(
        lambda V: (V.network.mlp.layers[-1].weight, V.network.mlp.layers[-1].bias), target, moved
    )
    return state._replace(models=models, target_values=(target,), copies=jnp.ones((), jnp.int32))


def begun(config: Config) -> AgentState:
    """The same models for both presets, and what moved, as each of them weighs it."""
    state = fresh()._replace(replay=rb.empty(config, STATE, ACTION))
    return eqx.filter_jit(algorithm.observe)(config, state, moving(config))


def is_fixed(path: tuple[Any, ...]) -> bool:
    return getattr(path[-1], "name", "") in FIXED


def doubled(tree: Any) -> Any:
    """The same in float64."""
    return jax.tree.map(
        lambda x: jnp.asarray(x, jnp.float64) if eqx.is_inexact_array(x) else x, tree
    )


def watched(config: Config, state: AgentState, key: Any) -> tuple[Any, ...]:
    """`update_once`, and what it knew in between: imagined next states, returns, gradients."""
    seen = []
    find, differentiate = policy.best_worst_case, algorithm.gradients

    def finding(evaluate: Any, next_states: Any, goals: Any) -> Any:
        pairs, candidates, N, size = next_states.shape
        outcomes = evaluate(next_states.reshape(pairs, -1, size), goals)
        seen.append((next_states, outcomes.reshape(pairs, candidates, N)))
        return find(evaluate, next_states, goals)

    def differentiating(*args: Any, **kwargs: Any) -> Any:
        result = differentiate(*args, **kwargs)
        seen.append(result[0])
        return result

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(policy, "best_worst_case", finding)
        patch.setattr(algorithm, "gradients", differentiating)
        return (*algorithm.update_once(config, state, key=key), *seen)


# --- The page's side ------------------------------------------------------------------------------


def chance(config: Config, key: Any) -> paper.Chance:
    """The random numbers that our update draws, by their keys."""
    size, j = config.batch_size, config.j

    def of_one(key: Any) -> tuple[Any, ...]:
        pi, rand, step, rollouts, _ = jax.random.split(key, 5)
        return (
            jax.random.normal(pi, (j, ACTION)),
            jax.random.uniform(rand, (j, ACTION), minval=-1, maxval=1),
            jax.random.normal(step, (2 * j, STATE)),
            jax.random.normal(rollouts, (config.N, STATE)),
        )

    of_losses = named(key, "losses")
    sizes = {"f": STATE, "d": STATE, "pi": ACTION, "c": STATE, "hindsight": ACTION}
    noise = {n: jax.random.normal(named(of_losses, n), (size, sizes[n])) for n in sizes}
    drawn = (
        jax.random.normal(named(key, "c"), (size, STATE)),
        jax.random.uniform(named(key, "replace"), (size,)),
        *jax.vmap(of_one)(jax.random.split(named(key, "improve"), size)),
    )
    return paper.Chance(*map(np.asarray, drawn), noise=jax.tree.map(np.asarray, noise))


def layers(bijection: Any) -> list[Any]:
    """Matrices and nonlinearities in the order in which data meet them, those of a scan apart."""
    if isinstance(bijection, Invert):
        return layers(bijection.bijection)
    if isinstance(bijection, Scan):
        stacked, rest = eqx.partition(bijection.bijection, lambda x: isinstance(x, np.ndarray))
        count = len(jax.tree.leaves(stacked)[0])
        one_of = [jax.tree.map(lambda x, i=i: x[i], stacked) for i in range(count)]
        each = [eqx.combine(one, rest) for one in one_of]
        return [layer for one in each for layer in layers(one)]
    if isinstance(bijection, Chain):
        return [layer for one in bijection.bijections for layer in layers(one)]
    return [bijection]


def as_mlp(network: Any) -> paper.MLP:
    mlp = network.mlp
    return paper.MLP(
        [layer.weight for layer in mlp.layers],
        [layer.bias for layer in mlp.layers],
        list(mlp.activation.negative_slope),
    )


def as_flow(encoder: Any, network: Any = None) -> paper.Flow:
    """The page's flow of the same arrays, W_1 first, and where its MLP's outputs go."""
    # The outputs follow the encoder, a scan's layers stacked: number them, as if they were arrays.
    names, count = ("log_d", "log_alpha", "log_beta"), 0

    def numbered(path: Any, x: Any) -> Any:
        nonlocal count
        if getattr(path[-1], "name", "") not in names:
            return x
        count += x.size
        return np.arange(count - x.size, count).reshape(x.shape)

    places = layers(jax.tree_util.tree_map_with_path(numbered, encoder))[::-1]
    own = layers(encoder)[::-1]
    matrices, bends = own[::2], own[1::2]
    return paper.Flow(
        P=[np.eye(len(m.permutation))[m.permutation] for m in matrices],
        d_sgn=[m.sign for m in matrices],
        L=[m.lower for m in matrices],
        U=[m.upper for m in matrices],
        d=[m.log_d for m in matrices],
        log_alpha=[x.log_alpha for x in bends],
        log_beta=[x.log_beta for x in bends],
        mlp=as_mlp(network) if network is not None else None,
        places=(
            [m.log_d for m in places[::2]],
            [x.log_alpha for x in places[1::2]],
            [x.log_beta for x in places[1::2]],
        ),
    )


def as_models(models: Models) -> paper.Models:
    """The page's models, as views of ours."""
    # Of a union of which only one kind is ever the paper's.
    flows: tuple[Any, ...] = models.dynamics.change, models.policies[0].flow, models.curriculum
    d, pi, c = flows
    return paper.Models(
        f=as_flow(models.state_flow.bijection),
        d=as_flow(d.encoder, d.network),
        pi=as_flow(pi.encoder, pi.network),
        c=as_flow(c.encoder, c.network),
        V=as_mlp(models.values[0].network),
        unit=models.dynamics.change_scale.real,
    )


def stabilisers(config: Config, state: AgentState) -> paper.Stabilisers:
    """What the config says of them."""
    return paper.Stabilisers(
        state_noise=config.state_noise,
        dynamics_noise=config.dynamics_noise,
        action_noise=config.action_noise,
        lowest=-float(state.copies) if config.bound_value else None,
        share=config.curriculum_share if config.normalise_curriculum else None,
        longest_step=config.max_gradient_step,
        largest_norm=config.gradient_clip,
    )


def hyperparameters(config: Config) -> paper.Hyperparameters:
    return paper.Hyperparameters(config.p_curric, config.k, config.half_life, config.learning_rate)


def minibatch(batch: Any) -> paper.Minibatch:
    drawn = batch.minibatch
    t = drawn.transitions
    given = (t.observations, t.actions, t.next_observations)
    s, g, g_t = map(np.asarray, (drawn.states, drawn.goals, t.next_observations))
    return paper.Minibatch(s, g, tuple(map(np.asarray, given)), g_t)


@functools.cache
def updated(name: str) -> tuple[Config, Any, Any, paper.Chance]:
    """The third update of a preset, as the first two give Adam its moments, and its chance."""
    config = preset(name, **SIZES, **OF_PRESET[name])
    before = begun(config)
    with jax.enable_x64(True), jax.numpy_dtype_promotion("standard"):
        before, update = doubled(before), eqx.filter_jit(watched)
        for i in range(2):
            before, *_ = update(config, before, jax.random.key(i))
        key = jax.random.key(2)
        after = update(config, before, key)
        return config, as_numpy(before), as_numpy(after), chance(config, key)


def on_the_page(models: Models, add: paper.Stabilisers, ours: tuple[Any, ...]) -> paper.Update:
    """The same update by the page, with the models that may be differentiated."""
    config, before, (_, _, batch, *_), random = ours
    V_targ = as_mlp(as_complex(before.target_values[0]).network)
    drawn, hyper = minibatch(batch), hyperparameters(config)
    return paper.update(as_models(models), V_targ, drawn, random, hyper, add)


def compare(name: str) -> Both:
    """That update by both."""
    ours = config, before, after, _ = updated(name)
    models, add = as_complex(before.models), stabilisers(config, before)
    page = on_the_page(models, add, ours)
    after, metrics, batch, (next_states, outcomes), gradients = after
    return Both(
        config, before, after, metrics, batch, next_states, outcomes, gradients, models, page, add
    )


def as_complex(tree: Any) -> Any:
    return jax.tree.map(lambda x: x.astype(complex) if x.dtype == np.float64 else x, tree)


def as_numpy(tree: Any) -> Any:
    """Its arrays, of NumPy, and nothing else."""
    arrays = eqx.filter(tree, lambda x: eqx.is_array(x) and x.dtype != jax.random.key(0).dtype)
    return jax.tree.map(np.array, arrays)


@pytest.fixture(scope="module", params=["literal", "paper"])
def both(request: pytest.FixtureRequest) -> Both:
    return compare(request.param)


def arrays(model: Any) -> list[tuple[str, Any, bool]]:
    """The floating-point arrays of a model with their paths, and whether they are learned."""
    found, _ = jax.tree_util.tree_flatten_with_path(trainable(model))
    return [(jax.tree_util.keystr(path), x, not is_fixed(path)) for path, x in found]


def test_s_is_replaced_where_the_paper_says(both: Both):
    np.testing.assert_allclose(both.batch.starts, both.page.s, **TIGHT)
    drawn = both.batch.minibatch.states
    share = (both.batch.starts != drawn).any(axis=1).mean()
    assert 0 < share < 1
    assert both.metrics["curriculum/used"] == pytest.approx(share)


def test_candidates_lead_where_the_paper_says(both: Both):
    """To each of N s' for each of 4 j candidates, worth r + V_targ, for each (s, g)."""
    ours, page = both.outcomes, np.array([x.outcomes for x in both.page.improvements])
    assert page.shape == (16, 8, 5)
    np.testing.assert_allclose(ours, page, **TIGHT)


def test_the_best_worst_case_is_chosen_and_its_mean_the_target(both: Both):
    improvements = both.page.improvements
    np.testing.assert_allclose(both.batch.best_actions, [x.a_best for x in improvements], **TIGHT)
    np.testing.assert_allclose(both.batch.targets, [x.v_targ for x in improvements], **TIGHT)
    kinds = {int(x.outcomes.min(axis=1).argmax()) // both.config.j for x in improvements}
    assert kinds == {0, 1, 2, 3}  # a^pi, a^rand, and a' of either


def test_losses_are_the_papers(both: Both):
    for name, loss in both.page.terms.items():
        np.testing.assert_allclose(both.metrics[f"loss/{name}"], loss, **TIGHT, err_msg=name)


@pytest.mark.parametrize("field", Models._fields)
def test_a_model_steps_down_its_loss_by_adam(both: Both, field: str):
    """Gradient, its clip, the moments and the step; what is not learned stays as it is."""
    at = Models._fields.index(field)
    found = arrays(getattr(both.models, field))
    theta = [x for _, x, learned in found if learned]
    exact = paper.gradient(both.page.losses[NAMES[field]], theta)
    ours = arrays(getattr(both.gradients, field))
    for dx, (path, x, _) in zip(exact, [one for one in ours if one[2]], strict=True):
        np.testing.assert_allclose(x, dx, **TIGHT, err_msg=path)
    assert all((x == 0).all() for _, x, learned in ours if not learned)

    state: Any = both.before.optimisers[at]  # optax has a type for any tree there may be
    moments = state[1][0]
    m, v = ([x for _, x, learned in arrays(of) if learned] for of in (moments.mu, moments.nu))
    adam = paper.Adam(m, v, int(moments.count))
    assert adam.t == 2
    expected = iter(adam.step(theta, both.add.clipped(exact), both.config.learning_rate))
    after = arrays(getattr(both.after.models, field))
    for (path, x, learned), (_, old, _) in zip(after, found, strict=True):
        new = next(expected) if learned else old.real
        np.testing.assert_allclose(x, new, **TIGHT, err_msg=path)


def test_what_was_drawn_has_its_new_weight(both: Both):
    drawn, before, after = both.batch.minibatch, both.before.replay, both.after.replay
    for ours, old, slots, w in (
        (after.goals.log, before.goals.log, drawn.goal_slots, both.page.w_g),
        (
            after.of_transitions.log,
            before.of_transitions.log,
            drawn.transition_slots,
            both.page.w_t,
        ),
    ):
        np.testing.assert_allclose(ours[slots], w, **TIGHT)
        others = np.setdiff1d(np.arange(len(ours)), slots)
        np.testing.assert_array_equal(ours[others], old[others])
    np.testing.assert_array_equal(after.states.log, before.states.log)


def test_the_minibatch_is_of_states_reached(both: Both):
    """Each s and g is some s'."""
    ring, drawn = both.before.replay.transitions, both.batch.minibatch
    reached = {tuple(x) for x in ring.next_observations[: both.before.replay.size].tolist()}
    assert all(tuple(x) in reached for x in drawn.states.tolist())
    np.testing.assert_array_equal(drawn.goals, ring.next_observations[drawn.goal_slots])
    for ours, kept in zip(drawn.transitions, ring, strict=True):
        np.testing.assert_array_equal(ours, kept[drawn.transition_slots])


def test_an_epoch_is_one_copy_of_v_its_updates_and_a_decay(monkeypatch: pytest.MonkeyPatch):
    """What stands around `for update`: with updates that only count, on V's last bias."""
    sizes = dict(SIZES, num_updates=3, target_period=3)
    config = preset("literal", **sizes)

    def bias(value: Any) -> Any:
        return value.network.mlp.layers[-1].bias

    def counting(config: Config, state: AgentState, *, key: Any) -> tuple[Any, ...]:
        counted = eqx.tree_at(bias, state.models.values[0], replace_fn=lambda x: x + 1)
        metrics = {"V": bias(state.models.values[0])[0], "V_targ": bias(state.target_values[0])[0]}
        batch = guard.no_fault(config, state.replay.transitions).batch
        return state._replace(models=state.models._replace(values=(counted,))), metrics, batch

    monkeypatch.setattr(algorithm, "update_once", counting)
    state = begun(config)
    start = float(bias(state.models.values[0])[0])
    assert start != pytest.approx(float(bias(state.target_values[0])[0]))
    after, metrics, _ = eqx.filter_jit(algorithm.update)(config, state)
    assert float(metrics["V_targ"]) == pytest.approx(start)  # in each of the updates
    assert float(metrics["V"]) == pytest.approx(start + 1)
    assert float(bias(after.models.values[0])[0]) == pytest.approx(start + 3)
    assert int(after.copies) == int(state.copies) + 1
    weights = paper.decayed(np.exp(state.replay.states.log), hyperparameters(config))
    np.testing.assert_allclose(np.exp(after.replay.states.log), weights, rtol=1e-6)


def test_nothing_that_paper_adds_is_idle():
    """Without any of its stabilisers the page comes to something else."""
    ours = config, before, (_, metrics, batch, (next_states, _), _), _ = updated("paper")
    models, add = as_complex(before.models), stabilisers(config, before)

    def result(add: paper.Stabilisers) -> Any:
        page = on_the_page(models, add, ours)
        return page.terms, np.array([x.outcomes for x in page.improvements]).tolist()

    with_all = result(add)
    for switch, default in paper.Stabilisers._field_defaults.items():
        if switch != "largest_norm":
            assert result(add._replace(**{switch: default})) != with_all, switch
    norms = [metrics[f"gradient/{field}"] for field in Models._fields]
    assert min(norms) < add.largest_norm < max(norms)
    goals = batch.minibatch.goals[:, None, None]
    values = paper.value(as_mlp(before.target_values[0].network), next_states, goals)
    assert values.min() < -int(before.copies) < 0 < values.max()
    assert stabilisers(preset("literal"), before) == paper.Stabilisers()
