"""Algorithm 1 (Zhang 2019, Appendix A): one function per paragraph of the paper's page.

`init`, then for ever: `act` and `observe` for an epoch of collection, `update` for an epoch of
learning. States are scaled on the way in: below this file everything is in scaled units.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import optax
from flowjax.distributions import AbstractTransformed
from jaxtyping import Array, Float, Int, PRNGKeyArray

from everystate.config import Config
from everystate.learning import replay as rb
from everystate.learning.curriculum import curriculum_weights, replaced
from everystate.learning.dynamics import Dynamics
from everystate.learning.flows import (
    ConditionalFlow,
    FlowJAXConditionalFlow,
    conditional_flow,
    decode,
    state_flow,
)
from everystate.learning.goals import least_likely_goal
from everystate.learning.keys import named
from everystate.learning.networks import Value
from everystate.learning.policy import improve
from everystate.learning.replay import Replay, Transitions
from everystate.learning.value import value_loss


class Scale(NamedTuple):
    """Fixed units: a scaled state is (s - centre) / spread."""

    centre: Float[Array, " s"]
    spread: Float[Array, " s"]


class Models(NamedTuple):
    """f(s), d(s'|s,a), pi(a|s,g), c(s|g) and V(s,g)."""

    state_flow: AbstractTransformed
    dynamics: Dynamics
    policy: ConditionalFlow | FlowJAXConditionalFlow
    curriculum: ConditionalFlow | FlowJAXConditionalFlow
    value: Value


class Episodes(NamedTuple):
    """What each body is up to, and a tally of the episodes that ended in this epoch."""

    goals: Float[Array, "bodies s"]
    best_values: Float[Array, " bodies"]
    steps_since_best: Int[Array, " bodies"]
    lengths: Int[Array, " bodies"]
    nearest: Float[Array, " bodies"]  # Least max |s_i - g_i|, in scaled units.
    tally: Float[Array, " 3"]  # Ended episodes: their number, reached goals, summed lengths.


class AgentState(NamedTuple):
    """All that training changes."""

    models: Models
    target_value: Value
    optimisers: tuple[optax.OptState, ...]  # One per model.
    replay: Replay
    episodes: Episodes
    scale: Scale
    key: PRNGKeyArray
    step: Int[Array, ""]
    epoch: Int[Array, ""]
    copies: Int[Array, ""]


REACHED = 0.25
"""A training goal counts as reached within this distance, the largest over scaled components."""


def init(config: Config, warmup: Transitions, scale: Scale, *, key: PRNGKeyArray) -> AgentState:
    """Fresh models and buffers, with the transitions of a warm-up under random actions.

    Args:
        config: hyper-parameters.
        warmup: transitions [steps, bodies, ...] in the body's own units.
        scale: the body's units.
        key: the run's random key, from which all others are named.
    """
    state_size, action_size = warmup.observations.shape[-1], warmup.actions.shape[-1]
    change = (warmup.next_observations - warmup.observations) / scale.spread
    net = {"width": config.width, "depth": config.depth}
    flow = {"family": config.flow, "shifted": config.flow_shift}

    def conditional(name: str, size: int, condition_size: int, layers: int):
        new_key = named(key, f"init {name}")
        return conditional_flow(size, condition_size, layers, **flow, **net, key=new_key)

    f = state_flow(state_size, config.state_layers, **flow, key=named(key, "init f"))
    d = conditional("d", state_size, state_size + action_size, config.dynamics_layers)
    pi = conditional("pi", action_size, 2 * state_size, config.policy_layers)
    c = conditional("c", state_size, state_size, config.curriculum_layers)
    v = Value(state_size, **net, bounded=config.bound_value, key=named(key, "init V"))
    models = Models(f, Dynamics(d, jnp.std(change, axis=(0, 1)) + 1e-6), pi, c, v)

    bodies, zero = config.num_bodies, jnp.zeros((), jnp.int32)
    episodes = Episodes(
        goals=jnp.zeros((bodies, state_size)),
        best_values=jnp.zeros(bodies),
        steps_since_best=jnp.full(bodies, config.patience, jnp.int32),
        lengths=jnp.zeros(bodies, jnp.int32),
        nearest=jnp.full(bodies, jnp.inf),
        tally=jnp.zeros(3),
    )
    state = AgentState(
        models=models,
        target_value=v,
        optimisers=tuple(_adam(config).init(_trainable(model)) for model in models),
        replay=rb.empty(config.capacity, state_size, action_size),
        episodes=episodes,
        scale=scale,
        key=key,
        step=zero,
        epoch=zero,
        copies=zero,
    )
    return observe(config, state, warmup)


def act(
    config: Config, state: AgentState, observations: Float[Array, "bodies s"]
) -> tuple[AgentState, Float[Array, "bodies a"]]:
    """One action per body, a ~ pi(s, g), after giving new goals to bodies whose episode ended.

    An episode goes on while V(s, g) does not fall: literally, while it has reached a new best
    within `patience` steps [D2].
    """
    states = (observations - state.scale.centre) / state.scale.spread
    models, episodes = state.models, state.episodes
    key_goals, key_actions = jax.random.split(named(state.key, "act", state.step))

    values = jax.vmap(models.value)(states, episodes.goals)
    improved = values >= episodes.best_values
    since_best = jnp.where(improved, 0, episodes.steps_since_best + 1)
    ended = (since_best >= config.patience) | (episodes.lengths >= config.max_episode_steps)
    distance = jnp.abs(states - episodes.goals).max(axis=1)
    nearest = jnp.minimum(episodes.nearest, distance)
    closed = ended & (episodes.lengths > 0)
    tally = episodes.tally + jnp.stack(
        [jnp.sum(closed * x) for x in (1.0, nearest <= REACHED, episodes.lengths)]
    )

    keys = jax.random.split(key_goals, config.num_bodies)
    new_goals = jax.vmap(lambda k: least_likely_goal(models.state_flow, config.m, key=k))(keys)
    goals = jnp.where(ended[:, None], new_goals, episodes.goals)
    new_values = jax.vmap(models.value)(states, goals)
    episodes = Episodes(
        goals=goals,
        best_values=jnp.where(ended, new_values, jnp.maximum(values, episodes.best_values)),
        steps_since_best=jnp.where(ended, 0, since_best),
        lengths=jnp.where(ended, 0, episodes.lengths) + 1,
        nearest=jnp.where(ended, jnp.inf, nearest),
        tally=tally,
    )

    def sample(s: Float[Array, " s"], g: Float[Array, " s"], key: PRNGKeyArray):
        policy = models.policy(jnp.concatenate([s, g]))
        return jnp.clip(decode(policy, jax.random.normal(key, policy.shape)), -1, 1)

    actions = jax.vmap(sample)(states, goals, jax.random.split(key_actions, config.num_bodies))
    return state._replace(episodes=episodes, step=state.step + 1), actions


def observe(config: Config, state: AgentState, transitions: Transitions) -> AgentState:
    """Adds transitions [steps, bodies, ...] to the three buffers, with their weights.

    Weights: 1 as state, 1 / p_f(s') as goal, 1 / (p_f(s) p_f(s')) as transition.
    """
    centre, spread = state.scale
    scaled = Transitions(
        (transitions.observations - centre) / spread,
        transitions.actions,
        (transitions.next_observations - centre) / spread,
    )
    flat = jax.tree.map(lambda x: x.reshape(-1, x.shape[-1]), scaled)
    log_prob = state.models.state_flow.log_prob
    before, after = log_prob(flat.observations), log_prob(flat.next_observations)
    return state._replace(replay=rb.add(state.replay, flat, -after, -before - after))


def update(config: Config, state: AgentState) -> tuple[AgentState, dict[str, Float[Array, ""]]]:
    """One epoch of learning: n_updates updates, target copies, and the decay of state weights."""
    arrays, static = eqx.partition(state, eqx.is_array)
    centres = (
        rb.median(state.replay.goal_log_weights),
        rb.median(state.replay.transition_log_weights),
    )
    keys = jax.random.split(
        named(state.key, "update", state.epoch),
        (config.num_updates // config.target_period, config.target_period),
    )

    def one(arrays, key):
        state, metrics = _update_once(config, eqx.combine(arrays, static), centres, key=key)
        return eqx.filter(state, eqx.is_array), metrics

    def until_copy(arrays, keys):
        state = eqx.combine(arrays, static)
        state = state._replace(target_value=state.models.value, copies=state.copies + 1)
        return jax.lax.scan(one, eqx.filter(state, eqx.is_array), keys)

    arrays, metrics = jax.lax.scan(until_copy, arrays, keys)
    state = eqx.combine(arrays, static)
    metrics = {name: values.mean() for name, values in metrics.items()}
    metrics |= _replay_metrics(config, state.replay, centres) | _episode_metrics(state.episodes)
    episodes = state.episodes._replace(tally=jnp.zeros(3))
    replay = rb.decay_states(state.replay, config.half_life)
    return state._replace(replay=replay, episodes=episodes, epoch=state.epoch + 1), metrics


def _update_once(
    config: Config,
    state: AgentState,
    centres: tuple[Float[Array, ""], Float[Array, ""]],
    *,
    key: PRNGKeyArray,
) -> tuple[AgentState, dict[str, Float[Array, ""]]]:
    """The body of Algorithm 1's `for update`, all models stepping at once."""
    models, replay, batch = state.models, state.replay, config.batch_size
    keys = {
        name: named(key, name)
        for name in ("s", "g", "t", "c", "replace", "improve", "noise", "later")
    }

    # Sample a minibatch from each buffer and refresh the weights of what was drawn.
    power, clip = config.weight_temper, config.weight_clip
    goal_weights = rb.temper(replay.goal_log_weights, centres[0], power=power, clip=clip)
    transition_weights = rb.temper(
        replay.transition_log_weights, centres[1], power=power, clip=clip
    )
    i_state = rb.draw(replay.state_log_weights, batch, key=keys["s"])
    i_goal = rb.draw(goal_weights, batch, key=keys["g"])
    i_transition = rb.draw(transition_weights, batch, key=keys["t"])
    states = replay.transitions.next_observations[i_state]
    goals = replay.transitions.next_observations[i_goal]
    t = jax.tree.map(lambda ring: ring[i_transition], replay.transitions)

    # Curriculum: s <- s_c where f makes that likely enough.
    latents = jax.random.normal(keys["c"], states.shape)
    from_curriculum = jax.vmap(lambda g, z: decode(models.curriculum(g), z))(goals, latents)
    scored = jnp.stack([goals, states, from_curriculum, t.observations, t.next_observations])
    lp_goal, lp_state, lp_curriculum, lp_before, lp_after = models.state_flow.log_prob(scored)
    use = replaced(config, lp_curriculum, lp_state, key=keys["replace"])
    starts = jnp.where(use[:, None], from_curriculum, states)

    # Safe policy improvement.
    floor = -(state.copies.astype(states.dtype) + 1)
    improvement = jax.lax.map(
        lambda x: improve(config, models, state.target_value, x[0], x[1], floor, key=x[2]),
        (starts, goals, jax.random.split(keys["improve"], batch)),
        batch_size=64,
    )

    # One gradient step for each model.
    noise = {
        n: jax.random.normal(named(keys["noise"], n), x.shape)
        for n, x in (
            ("f", states),
            ("d", states),
            ("pi", t.actions),
            ("hindsight", t.actions),
            ("c", states),
        )
    }
    later = _hindsight_goals(config, replay, i_transition, key=keys["later"])

    def losses(trainable: Models) -> tuple[Float[Array, ""], dict[str, Float[Array, ""]]]:
        new: Models = eqx.combine(trainable, models)

        def pi_log_prob(s, g, a):
            return new.policy(jnp.concatenate([s, g])).log_prob(a)

        loss_f = -new.state_flow.log_prob(states + config.state_noise * noise["f"]).mean()
        reached = (
            t.next_observations + config.dynamics_noise * models.dynamics.change_scale * noise["d"]
        )
        loss_d = -jax.vmap(lambda s, a, n: new.dynamics(s, a).log_prob(n))(
            t.observations, t.actions, reached
        ).mean()
        best = improvement.action + config.action_noise * noise["pi"]
        loss_pi = -jax.vmap(pi_log_prob)(starts, goals, best).mean()
        if config.hindsight:
            actions = t.actions + config.action_noise * noise["hindsight"]
            loss_hindsight = -jax.vmap(pi_log_prob)(t.observations, later, actions).mean()
            loss_pi = loss_pi + loss_hindsight
        errors = (jax.vmap(models.value)(starts, goals) - improvement.value) ** 2
        weights = curriculum_weights(config, errors, improvement.value)
        noisy = starts + config.state_noise * noise["c"]
        loss_c = -jnp.sum(
            weights * jax.vmap(lambda g, s: new.curriculum(g).log_prob(s))(goals, noisy)
        )
        loss_v = value_loss(config, new.value, starts, goals, improvement.value)
        parts = {"f": loss_f, "d": loss_d, "pi": loss_pi, "c": loss_c, "V": loss_v}
        return sum(parts.values()), parts

    (_, parts), gradients = jax.value_and_grad(losses, has_aux=True)(_trainable(models))
    stepped, optimisers, norms = [], [], {}
    for name, model, gradient, optimiser in zip(
        parts, models, gradients, state.optimisers, strict=True
    ):
        change, optimiser = _adam(config).update(gradient, optimiser)
        stepped.append(eqx.apply_updates(model, change))
        optimisers.append(optimiser)
        norms[f"gradient/{name}"] = optax.global_norm(gradient)

    replay = eqx.tree_at(
        lambda r: (r.goal_log_weights, r.transition_log_weights),
        replay,
        (
            replay.goal_log_weights.at[i_goal].set(-lp_goal),
            replay.transition_log_weights.at[i_transition].set(-lp_before - lp_after),
        ),
    )
    metrics = {f"loss/{name}": value for name, value in parts.items()} | norms
    metrics |= {
        "value/target": improvement.value.mean(),
        "value/target_min": improvement.value.min(),
        "policy/best_from_policy": improvement.from_policy.mean(),
        "policy/off_support": improvement.off_support.max(),
        "curriculum/used": use.mean(dtype=states.dtype),
    }
    new = state._replace(models=Models(*stepped), optimisers=tuple(optimisers), replay=replay)
    return new, metrics


def _hindsight_goals(
    config: Config, replay: Replay, slots: Int[Array, " batch"], *, key: PRNGKeyArray
) -> Float[Array, "batch s"]:
    """A state reached 1 to `hindsight_steps` steps later by the same body (2.3).

    Bodies are never reset, so num_bodies slots on is the same body one step later.
    """
    ahead = jax.random.randint(key, slots.shape, 0, config.hindsight_steps, jnp.int32)
    age = (replay.position - 1 - slots) % replay.capacity  # Slots between this one and the newest.
    ahead = jnp.minimum(ahead, age // config.num_bodies)
    later = (slots + ahead * config.num_bodies) % replay.capacity
    return replay.transitions.next_observations[later]


def _replay_metrics(config: Config, replay: Replay, centres) -> dict[str, Float[Array, ""]]:
    power, clip = config.weight_temper, config.weight_clip
    goals = rb.temper(replay.goal_log_weights, centres[0], power=power, clip=clip)
    transitions = rb.temper(replay.transition_log_weights, centres[1], power=power, clip=clip)
    return {
        "replay/size": replay.size.astype(goals.dtype),
        "replay/ess_states": rb.effective_sample_size(replay.state_log_weights),
        "replay/ess_goals": rb.effective_sample_size(goals),
        "replay/ess_transitions": rb.effective_sample_size(transitions),
    }


def _episode_metrics(episodes: Episodes) -> dict[str, Float[Array, ""]]:
    ended, reached, length = episodes.tally
    return {
        "episode/ended": ended,
        "episode/reached": reached / jnp.maximum(ended, 1),
        "episode/length": length / jnp.maximum(ended, 1),
    }


def _adam(config: Config) -> optax.GradientTransformation:
    return optax.chain(
        optax.clip_by_global_norm(config.gradient_clip), optax.adam(config.learning_rate)
    )


def _trainable(model):
    return eqx.filter(model, eqx.is_inexact_array)

