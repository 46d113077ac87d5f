"""Random keys split by name, so that adding a use never changes another's stream."""

import zlib

import jax
from jaxtyping import Array, Int, PRNGKeyArray


def named(key: PRNGKeyArray, name: str, counter: int | Int[Array, ""] = 0) -> PRNGKeyArray:
    """The key for one use, at one moment, of one run's randomness."""
    return jax.random.fold_in(jax.random.fold_in(key, zlib.crc32(name.encode())), counter)
