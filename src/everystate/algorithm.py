"""Algorithm 1 (Zhang 2019, Appendix A): one function per paragraph of the paper's page.

`init`, then for ever: `draw` (`learning/draws.py`) an epoch's chance, `act` on every body
at each of its steps, `observe` what came of it, `update` for an epoch of learning. States are
scaled on the way in: below this file everything is in scaled units.
"""

import jax
import jax.numpy as jnp
import optax
from jaxtyping import Array, Float, PRNGKeyArray

from everystate.config import Config
from everystate.learning import episodes as ep
from everystate.learning import guard
from everystate.learning import replay as rb
from everystate.learning.components import asked, unit
from everystate.learning.draws import Draws
from everystate.learning.epoch import Metrics, repeated
from everystate.learning.keys import named
from everystate.learning.losses import gradients
from everystate.learning.models import Models, Scale, Space, new_models, step
from everystate.learning.objectives import objectives, worths
from everystate.learning.pairs import paired
from everystate.learning.policy import described, improve
from everystate.learning.practice import practise
from everystate.learning.replay import Transitions
from everystate.learning.rollouts import improve_by_rollouts
from everystate.learning.sharding import joined, split
from everystate.learning.state import Actor, AgentState
from everystate.learning.units import grown
from everystate.learning.value import lowest


def init(
    config: Config, space: Space, warmup: Transitions, scale: Scale, *, key: PRNGKeyArray
) -> AgentState:
    """Fresh models, and buffers filled by a warm-up under random actions.

    Args:
        config: hyper-parameters.
        space: of the body.
        warmup: transitions [steps, bodies, ...] in the body's own units.
        scale: those units.
        key: the run's random key, from which all others are named.
    """
    change = scale.scaled(warmup.next_observations) - scale.scaled(warmup.observations)
    # A component that never changed in the warm-up must not divide by zero.
    change_scale = jnp.maximum(jnp.std(change, axis=(0, 1)), 1e-3)
    models = new_models(config, space, change_scale, key=named(key, "init"))
    begun = AgentState.begun(config, models, space.action_size, scale, key)
    return observe(config, begun, warmup)


def act(
    config: Config,
    actor: Actor,
    episodes: ep.Episodes,
    draws: Draws,
    observations: Float[Array, "bodies s"],
) -> tuple[ep.Episodes, Float[Array, "bodies a"]]:
    """a ~ pi(s, g) for some bodies, after giving new goals to those whose episode is over.

    Where there are several objectives, an episode is by one of them [D31]. Some bodies may wander
    from where their last episode ended: they act at random [D22].
    """
    states = actor.scale.scaled(observations)

    def value(s: Array, g: Array, by: Array) -> Float[Array, ""]:
        return worths(config, actor.values, s, g)[by]

    values = jax.vmap(value)(states, episodes.goals, episodes.objectives)
    episodes, over = ep.advance(config, episodes, states, values)
    goals = asked(actor.weights, states, draws.goals)
    new_values = jax.vmap(value)(states, goals, draws.objectives)
    episodes = ep.restart(episodes, over, goals, draws.objectives, new_values)

    def sample(s: Array, g: Array, z: Array, by: Array) -> Float[Array, " a"]:
        every = [policy.at(s, g, z) for policy in actor.policies]
        return jnp.clip(jnp.stack(every)[by], -1, 1)

    actions = jax.vmap(sample)(states, episodes.goals, draws.latents, episodes.objectives)
    if draws.anywhere is not None:
        wanders = (episodes.objectives == ep.WANDER)[:, None]
        actions = jnp.where(wanders, draws.anywhere, actions)
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

    What is not finite changes no model, and the first of it is handed out: see `epoch.repeated`.
    """
    state, metrics, fault = repeated(
        config, state, lambda state, key: update_once(config, state, key=key)
    )
    metrics |= rb.replay_metrics(config, state.replay) | ep.episode_metrics(state.episodes)
    if config.units == "running":
        state, changes = grown(config, state, key=named(state.key, "units", state.epoch))
        metrics |= changes
    state = state._replace(
        replay=rb.decay_states(state.replay, config.half_life),
        episodes=ep.without_tally(state.episodes),
        epoch=state.epoch + 1,
    )
    return state, metrics, fault


def update_once(
    config: Config, state: AgentState, *, key: PRNGKeyArray
) -> tuple[AgentState, Metrics, guard.Batch]:
    """The body of Algorithm 1's `for update`, with all models stepping at once [D11]."""
    models, imagines = state.models, state.kept.dynamics

    # (s, g) and (s, a, s') from the buffers; s_c ~ c(s|g) in the place of some s.
    of_step = unit(models.dynamics)
    drawn = joined(config, rb.sample(config, state.replay, of_step, key=named(key, "replay")))
    minibatch = split(config, drawn)
    pairs = paired(config, models, minibatch, key=key)
    minibatch = minibatch._replace(goals=pairs.goals)

    # a_best and v_targ for each (s, g), or for the first of them.
    aims = objectives(config, lowest(config, state.copies))
    improved = improve_by_rollouts if config.imagined_steps else improve
    improvements = [
        improved(
            config,
            models._replace(dynamics=imagines),
            policy,
            target,
            aim,
            pairs.starts[: config.improved_pairs],
            pairs.goals[: config.improved_pairs],
            key=named(key, f"improve{aim.suffix}"),
        )
        for aim, policy, target in zip(aims, models.policies, state.target_values, strict=False)
    ]

    # A step of f, d, pi, c and V, and more of d.
    gradient, losses = gradients(
        config,
        models,
        imagines,
        minibatch,
        pairs.starts,
        improvements,
        state.target_values,
        aims,
        key=named(key, "losses"),
    )
    models, optimisers = step(config, models, gradient, state.optimisers)
    models, optimisers, practice = practise(
        config, models, optimisers, state.replay, key=named(key, "practice")
    )

    # The weights 1 / p_f(g) and 1 / (p_f(s) p_f(s')) of what was drawn.
    goal, before, after = joined(config, pairs.rarity)
    replay = rb.refresh(config, state.replay, drawn, goal, before + after)

    norms = {f"gradient/{n}": optax.tree.norm(getattr(gradient, n)) for n in Models._fields}
    metrics = {f"loss/{name}": loss for name, loss in losses.items()} | norms | practice
    metrics |= described(aims, improvements) | {"curriculum/used": pairs.proposed}
    state = state._replace(models=models, optimisers=optimisers, replay=replay)
    learned = drawn._replace(goals=pairs.goals)
    best = jax.tree.map(lambda *x: jnp.concatenate(x), *((i.action, i.value) for i in improvements))
    return state, metrics, guard.Batch(learned, pairs.starts, *best)
