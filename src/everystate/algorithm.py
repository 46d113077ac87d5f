"""Algorithm 1 (Zhang 2019, Appendix A): one function per paragraph of the paper's page.

`init`, then for ever: `draw` what chance decides about an epoch of collection, `act` on every body
at each of its steps, `observe` what came of it, `update` for an epoch of learning. States are
scaled on the way in: below this file everything is in scaled units.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import optax
from jaxtyping import Array, Bool, Float, Int, Key, PRNGKeyArray

from everystate.config import Config
from everystate.learning import episodes as ep
from everystate.learning import guard
from everystate.learning import replay as rb
from everystate.learning.averages import averaged
from everystate.learning.curriculum import replaced
from everystate.learning.flows import decode
from everystate.learning.goals import choose_goals
from everystate.learning.keys import named
from everystate.learning.losses import gradients
from everystate.learning.models import Models, Scale, new_models, new_optimisers, step
from everystate.learning.networks import Value
from everystate.learning.objectives import objective
from everystate.learning.policy import Policy, improve
from everystate.learning.practice import practise
from everystate.learning.replay import Transitions
from everystate.learning.sharding import joined, split
from everystate.learning.units import Units, grown
from everystate.learning.value import lowest

Metrics = dict[str, Float[Array, "*updates"]]


class AgentState(NamedTuple):
    """All that training changes."""

    models: Models
    target_value: Value
    optimisers: tuple[optax.OptState, ...]  # One per model.
    replay: rb.Replay
    episodes: ep.Episodes
    scale: Scale
    key: PRNGKeyArray
    epoch: Int[Array, ""]
    copies: Int[Array, ""]  # Of V to V_targ.
    average: Models | None  # Of the weights; None: there is none [D35].

    @property
    def kept(self) -> Models:
        """What makes the agent that is kept."""
        return self.average or self.models


class Actor(NamedTuple):
    """What acting needs of an agent, which is little: it goes to wherever the bodies are."""

    policy: Policy
    value: Value
    scale: Scale


class Draws(NamedTuple):
    """What chance decides about a step of some bodies, apart from their own noise."""

    goals: Float[Array, "*steps bodies s"]
    """Scaled; for those whose episode is over."""
    latents: Float[Array, "*steps bodies a"]
    """z of the actions a = pi_dec(z)."""
    wanders: Bool[Array, "*steps bodies 1"] | None = None
    """Which bodies act at random in this epoch [D22]; None: nobody ever does."""
    anywhere: Float[Array, "*steps bodies a"] | None = None
    """How they act."""


def init(config: Config, warmup: Transitions, scale: Scale, *, key: PRNGKeyArray) -> AgentState:
    """Fresh models, and buffers filled by a warm-up under random actions.

    Args:
        config: hyper-parameters.
        warmup: transitions [steps, bodies, ...] in the body's own units.
        scale: those units.
        key: the run's random key, from which all others are named.
    """
    change = scale.scaled(warmup.next_observations) - scale.scaled(warmup.observations)
    state_size, action_size = change.shape[-1], warmup.actions.shape[-1]
    # A component that never changed in the warm-up must not divide by zero.
    change_scale = jnp.maximum(jnp.std(change, axis=(0, 1)), 1e-3)
    models = new_models(config, action_size, change_scale, key=named(key, "init"))
    zero = jnp.zeros((), jnp.int32)
    empty = AgentState(
        models=models,
        target_value=models.value,
        optimisers=new_optimisers(config, models),
        replay=rb.empty(config, state_size, action_size),
        episodes=ep.no_episodes(config, state_size),
        scale=scale,
        key=key,
        epoch=zero,
        copies=zero,
        average=models if config.averaged else None,
    )
    return observe(config, empty, warmup)


def actor_of(state: AgentState) -> Actor:
    """The part that acts."""
    return Actor(state.models.policy, state.models.value, state.scale)


def draw(config: Config, state: AgentState) -> Draws:
    """All that chance decides about an epoch of collection: neither f nor replay changes in it.

    Leaves are [steps, bodies, ...]; what is drawn for a body is so however bodies are grouped.
    """
    action_size = state.replay.transitions.actions.shape[-1]

    def moment(step: Int[Array, ""]) -> Draws:
        key = named(state.key, "act", step)
        keys = jax.random.split(named(key, "actions"), config.num_bodies)
        draws = Draws(
            goals=choose_goals(config, state.models, state.replay, key=named(key, "goals")),
            latents=jax.vmap(lambda key: jax.random.normal(key, (action_size,)))(keys),
        )
        epoch, since = step // config.steps_per_epoch, step // config.wander_steps
        if config.central_share:
            key = named(state.key, "central", epoch)
            central = jax.random.bernoulli(key, config.central_share, (config.num_bodies, 1))
            draws = draws._replace(latents=jnp.where(central, 0.0, draws.latents))
        if not config.wander_share:
            return draws
        chosen = named(state.key, "wander", epoch), named(state.key, "wandering", since)
        return draws._replace(
            wanders=jax.random.bernoulli(chosen[0], config.wander_share, (config.num_bodies, 1)),
            anywhere=jax.random.uniform(chosen[1], draws.latents.shape, minval=-1, maxval=1),
        )

    steps = jnp.arange(config.steps_per_epoch, dtype=jnp.int32)
    # One step after the other: all at once would hold m candidates for every goal of the epoch.
    return jax.lax.map(moment, state.epoch * config.steps_per_epoch + steps)


def act(
    config: Config,
    actor: Actor,
    episodes: ep.Episodes,
    draws: Draws,
    observations: Float[Array, "bodies s"],
) -> tuple[ep.Episodes, Float[Array, "bodies a"]]:
    """a ~ pi(s, g) for some bodies, after giving new goals to those whose episode is over.

    Some may wander: they act at random for an epoch [D22].
    """
    states = actor.scale.scaled(observations)
    aim = objective(config)

    def value(s: Array, g: Array) -> Float[Array, ""]:
        return aim.worth(aim.read(actor.value(s, g)))

    values = jax.vmap(value)(states, episodes.goals)
    episodes, over = ep.advance(config, episodes, states, values)
    new_values = jax.vmap(value)(states, draws.goals)
    episodes = ep.restart(episodes, over, draws.goals, new_values)

    def sample(s: Array, g: Array, z: Array) -> Float[Array, " a"]:
        return jnp.clip(actor.policy.at(s, g, z), -1, 1)

    actions = jax.vmap(sample)(states, episodes.goals, draws.latents)
    if draws.wanders is not None and draws.anywhere is not None:
        actions = jnp.where(draws.wanders, draws.anywhere, actions)
    return episodes, actions


def observe(config: Config, state: AgentState, transitions: Transitions) -> AgentState:
    """Adds transitions [steps, bodies, ...], in the body's units, to the three buffers.

    Weights: 1 as state, 1 / p_f(s') as goal, 1 / (p_f(s) p_f(s')) as transition.
    """
    scaled = Transitions(
        state.scale.scaled(transitions.observations),
        transitions.actions,
        state.scale.scaled(transitions.next_observations),
        state.scale.scaled(transitions.goals)[..., : state.replay.transitions.goals.shape[-1]],
    )
    flat = jax.tree.map(lambda x: x.reshape(x.shape[0] * x.shape[1], x.shape[2]), scaled)
    before = state.models.state_flow.log_prob(flat.observations)
    after = state.models.state_flow.log_prob(flat.next_observations)
    return state._replace(replay=rb.add(config, state.replay, flat, -after, -before - after))


def update(config: Config, state: AgentState) -> tuple[AgentState, Metrics, guard.Fault]:
    """An epoch of learning: n_updates updates with their target copies, then the state decay.

    Updates that are not finite change no model, nor do those after them if `config.not_finite` is
    "stop"; the first is handed out. Metrics are means over the others.
    """
    copies, period = config.num_updates // config.target_period, config.target_period
    keys = jax.random.split(named(state.key, "update", state.epoch), (copies, period))
    numbers = jnp.arange(config.num_updates, dtype=jnp.int32).reshape(copies, period)
    arrays, static = eqx.partition(state, eqx.is_array)

    def one(
        carry: tuple[AgentState, guard.Fault], now: tuple[Int[Array, ""], PRNGKeyArray]
    ) -> tuple[tuple[AgentState, guard.Fault], tuple[Metrics, Bool[Array, ""]]]:
        (arrays, fault), (number, key) = carry, now
        state = eqx.combine(arrays, static)
        after, metrics, batch = update_once(config, state, key=key)
        fine = guard.finite(metrics)
        fault = guard.first(fault, number, batch, fine)
        taken = fine if config.not_finite == "roll-back" else fault.update < 0
        if state.average is not None:
            count = state.epoch * config.num_updates + number
            average = averaged(config, state.average, after.models, count)
            after = after._replace(average=guard.chosen(taken, average, state.average))
        after = after._replace(
            models=guard.chosen(taken, after.models, state.models),
            optimisers=guard.chosen(taken, after.optimisers, state.optimisers),
        )
        return (eqx.filter(after, eqx.is_array), fault), (metrics, taken)

    def until_next_copy(
        carry: tuple[AgentState, guard.Fault], now: tuple[Int[Array, " n"], Key[Array, " n"]]
    ) -> tuple[tuple[AgentState, guard.Fault], tuple[Metrics, Bool[Array, " n"]]]:
        arrays, fault = carry
        arrays = arrays._replace(target_value=arrays.models.value, copies=arrays.copies + 1)
        return jax.lax.scan(one, (arrays, fault), now)

    begun = arrays, guard.no_fault(config, state.replay.transitions)
    (arrays, fault), (every, taken) = jax.lax.scan(until_next_copy, begun, (numbers, keys))
    state = eqx.combine(arrays, static)
    metrics = {name: values.mean(where=taken) for name, values in every.items()}
    fault = fault._replace(metrics={n: x.reshape(-1)[fault.update] for n, x in every.items()})
    metrics["update/taken"] = taken.mean(dtype=jnp.float32)
    metrics |= rb.replay_metrics(config, state.replay)
    metrics |= ep.episode_metrics(state.episodes)
    if config.units == "running":
        state, changes = in_grown_units(config, state)
        metrics |= changes
    state = state._replace(
        replay=rb.decay_states(state.replay, config.half_life),
        episodes=state.episodes._replace(tally=jnp.zeros(3)),
        epoch=state.epoch + 1,
    )
    return state, metrics, fault


def in_grown_units(config: Config, state: AgentState) -> tuple[AgentState, Metrics]:
    """The same in larger units, if the body has outgrown the old ones [D33]."""
    now = Units(state.scale, state.replay, state.episodes.goals, state.models, state.average)
    units, metrics = grown(config, now, key=named(state.key, "units", state.epoch))
    return state._replace(
        scale=units.scale,
        replay=units.replay,
        episodes=state.episodes._replace(goals=units.goals),
        models=units.models,
        average=units.average,
    ), metrics


def update_once(
    config: Config, state: AgentState, *, key: PRNGKeyArray
) -> tuple[AgentState, Metrics, guard.Batch]:
    """The body of Algorithm 1's `for update`, with all models stepping at once [D11]."""
    models = state.models
    unit = models.dynamics.change_scale
    drawn = joined(config, rb.sample(config, state.replay, unit, key=named(key, "replay")))
    minibatch = split(config, drawn)
    states, goals, t = minibatch.states, minibatch.goals, minibatch.transitions

    # s_c ~ c(s|g) takes the place of s where f makes that likely enough.
    latents = jax.random.normal(named(key, "c"), states.shape)
    proposed = jax.vmap(lambda g, z: decode(models.curriculum(g), z))(goals, latents)
    scored = jnp.stack([states, proposed, goals, t.observations, t.next_observations])
    lp_state, lp_proposed, lp_goal, lp_before, lp_after = models.state_flow.log_prob(scored)
    use = replaced(config, lp_proposed, lp_state, key=named(key, "replace"))
    starts = jnp.where(use[:, None], proposed, states)
    if config.pursued_share:
        chance = config.pursued_share, (config.batch_size, 1)
        pursued = jax.random.bernoulli(named(key, "pursued"), *chance)
        starts = jnp.where(pursued, t.observations, starts)
        goals = jnp.where(pursued, t.goals, goals)
        minibatch = minibatch._replace(goals=goals)

    # a_best and v_targ for each (s, g), or for the first of them.
    aim = objective(config, lowest(config, state.copies))
    imagines = state.kept.dynamics
    some = slice(config.improved_pairs)
    improvement = improve(
        config,
        models._replace(dynamics=imagines),
        state.target_value,
        aim,
        starts[some],
        goals[some],
        key=named(key, "improve"),
    )

    gradient, losses = gradients(
        config,
        models,
        imagines,
        minibatch,
        starts,
        improvement,
        state.target_value,
        aim,
        key=named(key, "losses"),
    )
    norms = {f"gradient/{n}": optax.tree.norm(getattr(gradient, n)) for n in Models._fields}
    models, optimisers = step(config, models, gradient, state.optimisers)
    models, optimisers, practice = practise(
        config, models, optimisers, state.replay, key=named(key, "practice")
    )
    lp_goal, lp_before, lp_after = joined(config, (lp_goal, lp_before, lp_after))
    replay = rb.refresh(config, state.replay, drawn, -lp_goal, -lp_before - lp_after)
    targets = jax.vmap(aim.worth)(improvement.heads)
    metrics = {f"loss/{name}": loss for name, loss in losses.items()} | norms | practice
    metrics |= {
        "value/target": targets.mean(),
        "value/target_min": targets.min(),
        "policy/best_from_policy": improvement.from_policy.mean(),
        "policy/evaluated": improvement.evaluated.mean(),
        "policy/off_support": improvement.off_support.max(),
        "curriculum/used": use.mean(dtype=jnp.float32),
    }
    state = state._replace(models=models, optimisers=optimisers, replay=replay)
    return (
        state,
        metrics,
        guard.Batch(drawn._replace(goals=goals), starts, improvement.action, targets),
    )
