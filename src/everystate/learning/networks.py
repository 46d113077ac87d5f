"""Multilayer perceptrons with PReLU activations, and the value function built on one."""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray


class Network(eqx.Module):
    """An MLP with `depth` hidden layers of `width` PReLU units (Appendix B).

    With `frequencies` its inputs x are joined by sin and cos of pi x / 2, pi x, 2 pi x, ...: smooth
    networks of raw coordinates blur a wall between two places for thousands of updates [D13].
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
        return self.mlp(jnp.concatenate([x, *waves(x, self.frequencies)]))


def waves(x: Float[Array, " n"], octaves: int) -> list[Float[Array, " n"]]:
    """Sine and cosine of pi x / 2, and of so many doublings of it in all.

    By the double-angle formulas: sines and cosines take longer than the network's products.
    """
    sine, cosine = jnp.sin(math.pi / 2 * x), jnp.cos(math.pi / 2 * x)
    result: list[Float[Array, " n"]] = []
    for _ in range(octaves):
        result += [sine, cosine]
        sine, cosine = 2 * sine * cosine, 1 - 2 * sine**2
    return result


class Value(eqx.Module):
    """V(s, g): about minus the number of steps from s to g (4.2, 4.3)."""

    network: Network
    relative: bool = eqx.field(static=True)

    def __init__(
        self, state_size: int, *, relative: bool, key: PRNGKeyArray, **network: int
    ) -> None:
        """An untrained value of states and goals with `state_size` components.

        If it is `relative` it sees g - s in the place of g, whose waves then tell how near s is to
        any goal alike [D20].
        """
        self.network = Network(2 * state_size, 1, key=key, **network)
        self.relative = relative

    def __call__(self, state: Float[Array, " s"], goal: Float[Array, " s"]) -> Float[Array, ""]:
        """V of one state and one goal, both scaled, in steps."""
        seen = goal - state if self.relative else goal
        return self.network(jnp.concatenate([state, seen]))[0]
