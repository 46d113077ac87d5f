"""Multilayer perceptrons with PReLU activations, and the value function built on one."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray


def mlp(inputs: int, outputs: int, *, width: int, depth: int, key: PRNGKeyArray) -> eqx.nn.MLP:
    """An MLP with `depth` hidden layers of `width` PReLU units (Appendix B)."""
    # A module as final activation, unlike a function, keeps every leaf of the tree an array.
    identity = eqx.nn.Identity()
    network = eqx.nn.MLP(
        inputs, outputs, width, depth, eqx.nn.PReLU(), final_activation=identity, key=key
    )
    # PReLU's slopes come weakly typed, which would compile every user of them twice.
    return jax.tree.map(lambda x: x.astype(jnp.float32), network)


class Value(eqx.Module):
    """V(s, g): about minus the number of steps from s to g (4.2, 4.3).

    `bounded` passes the output through -softplus, so that V has no way above 0 [D4].
    """

    network: eqx.nn.MLP
    bounded: bool = eqx.field(static=True)

    def __init__(
        self, state_size: int, *, width: int, depth: int, bounded: bool, key: PRNGKeyArray
    ) -> None:
        """An untrained value of states and goals with `state_size` components."""
        self.network = mlp(2 * state_size, 1, width=width, depth=depth, key=key)
        self.bounded = bounded

    def __call__(self, state: Float[Array, " s"], goal: Float[Array, " s"]) -> Float[Array, ""]:
        """V of one state and one goal, both scaled, in steps."""
        output = self.network(jnp.concatenate([state, goal]))[0]
        return -jax.nn.softplus(output) if self.bounded else output
