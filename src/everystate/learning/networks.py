"""Multilayer perceptrons with PReLU activations, and the value function built on one."""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from everystate.learning.facing import Horizontal, inward


class Network(eqx.Module):
    """An MLP with `depth` hidden layers of `width` PReLU units (Appendix B).

    With `frequencies` its inputs x are joined by `waves`: smooth networks of raw coordinates blur a
    wall between two places for thousands of updates [D13].
    """

    mlp: eqx.nn.MLP
    frequencies: int = eqx.field(static=True)

    def __init__(
        self,
        inputs: int,
        outputs: int,
        *,
        width: int,
        depth: int,
        frequencies: int,
        key: PRNGKeyArray,
    ) -> None:
        """A network from R^inputs to R^outputs."""
        # A module as final activation, unlike a function, keeps every leaf of the tree an array.
        mlp = eqx.nn.MLP(
            inputs * (1 + 2 * frequencies),
            outputs,
            width,
            depth,
            eqx.nn.PReLU(),
            final_activation=eqx.nn.Identity(),
            key=key,
        )
        # PReLU's slopes come weakly typed, which would compile every user of them twice.
        self.mlp = jax.tree.map(lambda x: x.astype(jnp.float32), mlp)
        self.frequencies = frequencies

    def __call__(self, x: Float[Array, " inputs"]) -> Float[Array, " outputs"]:
        """One example."""
        return self.mlp(self.inputs(x))

    def inputs(self, x: Float[Array, " inputs"]) -> Float[Array, " n"]:
        """What the MLP sees of it."""
        return jnp.concatenate([x, *waves(x, self.frequencies)])


def waves(x: Float[Array, " n"], octaves: int) -> list[Float[Array, " n"]]:
    """Sine and cosine of pi x / 2, and of so many doublings of it in all, none of them steeper.

    The amplitude halves with each doubling. Of equal amplitude the quickest made networks of many
    inputs so rough that gradients through them were mostly noise.
    """
    sine, cosine = jnp.sin(math.pi / 2 * x), jnp.cos(math.pi / 2 * x)
    result: list[Float[Array, " n"]] = []
    for octave in range(octaves):
        result += [sine / 2**octave, cosine / 2**octave]
        # By the double-angle formulas: sines and cosines take longer than the network's products.
        sine, cosine = 2 * sine * cosine, 1 - 2 * sine**2
    return result


def with_goal(
    state: Float[Array, " s"],
    goal: Float[Array, " s"],
    both: bool,
    horizontal: Horizontal,
) -> Float[Array, " n"]:
    """What V and pi see of a state and a goal, both scaled: s, g and, of `both`, g - s [D20]."""
    goal, state = (inward(horizontal, state, x) for x in (goal, state))
    return jnp.concatenate([state, goal, *([goal - state] if both else [])])


def small_at_first(network: Network) -> Network:
    """The same with small last weights: at first it hardly depends on its inputs."""
    return eqx.tree_at(
        lambda n: (n.mlp.layers[-1].weight, n.mlp.layers[-1].bias),
        network,
        replace_fn=lambda x: 0.01 * x,
    )


class Value(eqx.Module):
    """V(s, g): about minus the number of steps from s to g (4.2, 4.3), or what an objective says.

    See `everystate.learning.objectives`.
    """

    network: Network
    both: bool = eqx.field(static=True)
    """Whether it sees g - s beside s and g [D20]."""
    horizontal: Horizontal = eqx.field(static=True)

    def __init__(
        self,
        state_size: int,
        *,
        both: bool,
        horizontal: Horizontal = (),
        key: PRNGKeyArray,
        **network: int,
    ) -> None:
        """An untrained value of states and goals with `state_size` components."""
        seen = (3 if both else 2) * state_size
        self.network = Network(seen, 1, key=key, **network)
        self.both, self.horizontal = both, horizontal

    def __call__(self, state: Float[Array, " s"], goal: Float[Array, " s"]) -> Float[Array, ""]:
        """The output for one state and one goal, both scaled."""
        return self.network(with_goal(state, goal, self.both, self.horizontal))[0]
