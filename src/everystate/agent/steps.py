"""What an agent does by its policy (z = 0), as steps on plain arrays.

The same formulas as `learning.policy.central` and what that calls, written once more on a tape. A
test holds the two together.
"""

import math
from collections.abc import Sequence
from functools import partial
from typing import Any

import equinox as eqx
import jax
import numpy as np
from flowjax.bijections import Chain, Invert, Scan
from jaxtyping import Float

from everystate.agent.tape import Tape, Traced
from everystate.config import Config
from everystate.errors import EverystateError
from everystate.learning.bijections import PLDU
from everystate.learning.components import factors
from everystate.learning.conditional import Centred, Conditional, ConditionalFlow
from everystate.learning.facing import LEAST
from everystate.learning.models import Models, Scale
from everystate.learning.networks import Network
from everystate.learning.objectives import AS_SOON, FIRST_LOGIT, HELD, HITS, HOLD, NEAR, PASS
from everystate.portable import Policy


def as_steps(
    models: Models,
    scale: Scale,
    config: Config,
    state_names: tuple[str, ...],
    action_names: tuple[str, ...],
) -> Policy:
    """The policy of an agent, from states in the body's units to actions in [-1, 1].

    Raises:
        EverystateError: it needs a flow that is none of ours.
    """
    tape = Tape()
    state, goal = ((x - scale.centre) / scale.spread for x in tape.inputs())
    counts = np.asarray(models.dynamics.weights) > 0
    if not counts.all():
        goal = tape.do("Where", counts, goal, state)
    state, goal = (_inward(models, state, x) for x in (state, goal))
    actions = [
        _central(config, policy.flow, _with_goal(state, goal, policy.both))
        for policy in models.policies
    ]
    action = actions[0]
    if len(actions) > 1:
        held = _held(config, models, state, goal)
        action = tape.do("Where", held, actions[HOLD], actions[PASS])
    action = tape.do("Min", tape.do("Max", action, -1.0), 1.0)
    return tape.ended(action, state_names, action_names)


# Traced arrays are all [batch, n]; constants [n], or [n, m] to be multiplied by.


def _with_goal(state: Traced, goal: Traced, both: bool) -> Traced:
    return state.tape.do("Concat", state, goal, *([goal - state] if both else []))


def _inward(models: Models, state: Traced, seen: Traced) -> Traced:
    """As seen from where the body in `state` faces: see `facing.inward`."""
    if not models.dynamics.horizontal:
        return seen
    do, size = state.tape.do, len(models.dynamics.weights)
    x, y = np.array(models.dynamics.horizontal).T
    ahead = [state @ np.eye(size)[:, [axis[0]]] for axis in (x, y)]
    square = ahead[0] * ahead[0] + ahead[1] * ahead[1]
    faces, length = square >= LEAST**2, do("Sqrt", do("Max", square, LEAST**2))
    cosine = do("Where", faces, ahead[0] / length, 1.0)
    sine = do("Where", faces, ahead[1] / length, 0.0)
    same, crossed = np.zeros((2, size, size))
    same[x, x], same[y, y], crossed[y, x], crossed[x, y] = 1, 1, 1, -1
    return seen @ (np.eye(size) - same) + cosine * (seen @ same) + sine * (seen @ crossed)


def _hidden(network: Network, x: Traced) -> Traced:
    """What the last layer of a network sees."""
    do, waves = x.tape.do, []
    sine, cosine = do("Sin", math.pi / 2 * x), do("Cos", math.pi / 2 * x)
    for octave in range(network.frequencies):
        waves += [sine / 2**octave, cosine / 2**octave]
        sine, cosine = 2 * sine * cosine, 1 - 2 * (sine * sine)
    if waves:
        x = do("Concat", x, *waves)
    slopes: Any = network.mlp.activation  # one PReLU for each unit of each layer
    for layer, slope in zip(network.mlp.layers[:-1], slopes.negative_slope, strict=True):
        x = do("PRelu", _linear(x, layer.weight, layer.bias), slope)
    return x


def _output(network: Network, x: Traced) -> Traced:
    last = network.mlp.layers[-1]
    return _linear(_hidden(network, x), last.weight, last.bias)


def _linear(x: Traced, weight: Any, bias: Any) -> Traced:
    return x @ np.asarray(weight).T + bias


def _central(config: Config, flow: Conditional, condition: Traced) -> Traced:
    """The most central value of a conditional flow."""
    if isinstance(flow, Centred):
        return _output(flow.centre, condition)
    if not isinstance(flow, ConditionalFlow):
        raise _unknown(config)
    tape, last = condition.tape, flow.network.mlp.layers[-1]
    hidden = _hidden(flow.network, condition)
    value: Any = np.zeros((1, *flow.encoder.shape), np.float32)
    pairs = zip(_layers(flow.encoder), _layers(flow.columns()), strict=True)
    for layer, columns in reversed(list(pairs)):
        turned = isinstance(layer, Invert)
        inner, rows = (layer.bijection, columns.bijection) if turned else (layer, columns)
        moved = partial(_moved, hidden, last, inner, rows)
        if isinstance(inner, PLDU):
            lower, upper = _triangles(inner)
            if inner.shifted:
                value = value - moved("shift")
            value = value @ np.linalg.inv(lower).T
            value = value / (inner.sign * tape.do("Exp", moved("log_d")))
            value = value @ np.linalg.inv(upper).T
        else:
            slopes = (tape.do("Exp", moved(name)) for name in ("log_alpha", "log_beta"))
            value = (_bent if turned else _straightened)(tape, value, *slopes)
    return value


def _moved(hidden: Traced, last: Any, layer: Any, rows: Any, name: str) -> Traced:
    """A parameter of a layer as the outputs of the last of a network move it."""
    own, at = getattr(layer, name), getattr(rows, name)
    return _linear(hidden, last.weight[at], last.bias[at] + own)


def _held(config: Config, models: Models, state: Traced, goal: Traced) -> Traced:
    """Whether a goal is pursued by holding it, [batch, 1]: see `objectives.pursued`."""
    tape, size = state.tape, len(models.dynamics.weights)
    apart = _placed(config, models, state) - _placed(config, models, goal)
    k = 1 / (size * config.kernel_width**2) if config.kernel_width else config.k
    near = tape.do("Exp", apart * apart @ np.full((size, 1), -k)) >= NEAR
    seen = _with_goal(state, goal, config.both_goals)
    logits = (_output(models.values[i].network, seen) + FIRST_LOGIT for i in (PASS, HITS))
    passed, hit = (1 / (1 + tape.do("Exp", -1 * logit)) for logit in logits)
    holds = tape.do("Or", near, tape.do("GreaterOrEqual", hit, AS_SOON * passed))
    goal = _inward(models, goal, goal)
    can = _output(models.values[HOLD].network, _with_goal(goal, goal, config.both_goals))
    return tape.do("And", holds, can >= -HELD / (1 - config.discount))


def _placed(config: Config, models: Models, state: Traced) -> Traced:
    """Where the reward sees a state: see `rewards.placing`."""
    if config.reward_space != "latent":
        return state * factors(models.dynamics.weights)
    decoder = models.state_flow.bijection
    if config.flow != "pldu" or not isinstance(decoder, Invert):
        raise _unknown(config)
    for layer in _layers(decoder.bijection):
        turned = isinstance(layer, Invert)
        inner: Any = layer.bijection if turned else layer
        if isinstance(inner, PLDU):
            linear = inner.linear()
            state = _linear(state, linear.matrix, linear.shift)
        else:
            slopes = (np.exp(x) for x in (inner.log_alpha, inner.log_beta))
            state = (_straightened if turned else _bent)(state.tape, state, *slopes)
    return state


def _layers(bijection: Any) -> Sequence[Any]:
    """Those of a PLDU encoder, from data to latent space: PLDU, SmoothPReLU and its inverse."""
    if isinstance(bijection, Chain):
        return [layer for part in bijection.bijections for layer in _layers(part)]
    if isinstance(bijection, Scan):
        arrays, rest = eqx.partition(bijection.bijection, eqx.is_array)
        parts = (
            eqx.combine(jax.tree.map(lambda x, i=i: x[i], arrays), rest)
            for i in range(len(jax.tree.leaves(arrays)[0]))
        )
        return [layer for part in parts for layer in _layers(part)]
    return [bijection]


def _triangles(layer: PLDU) -> tuple[Float[np.ndarray, "n n"], Float[np.ndarray, "n n"]]:
    """P L and U, in double precision, as they are inverted."""
    one = np.eye(layer.shape[0])
    lower = np.tril(np.asarray(layer.lower, np.float64), -1) + one
    return lower[np.asarray(layer.permutation)], np.triu(layer.upper, 1) + one


def _bent(tape: Tape, x: Traced, alpha: Any, beta: Any) -> Traced:
    """SmoothPReLU: see there."""
    middle = tape.do("Min", tape.do("Max", x, -1.0), 1.0)
    right, left = 1 + middle, 1 - middle
    above, below = tape.do("Max", x - 1, 0.0), tape.do("Max", -1 - x, 0.0)
    return beta * (right * right / 4 + above) - alpha * (left * left / 4 + below)


def _straightened(tape: Tape, y: Traced, alpha: Any, beta: Any) -> Traced:
    """Its inverse."""
    middle = tape.do("Min", tape.do("Max", y, -1 * alpha), beta)
    rising = tape.do("Where", tape.do("GreaterOrEqual", alpha, beta), beta - middle, middle + alpha)
    least, most = tape.do("Min", alpha, beta), tape.do("Max", alpha, beta)
    squared = least * least + (most - least) * rising
    x = (4 * middle - (beta - alpha)) / (beta + alpha + 2 * tape.do("Sqrt", squared))
    above, below = tape.do("Max", y - beta, 0.0), tape.do("Min", y + alpha, 0.0)
    return x + above / beta + below / alpha


def _unknown(config: Config) -> EverystateError:
    return EverystateError(
        f"a policy that needs the flow {config.flow} of FlowJAX has no form without JAX: export to"
        " a folder or NAME.zip, or train with flow pldu"
    )
