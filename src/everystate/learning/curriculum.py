"""The generative curriculum c(s|g), proportional to l(s, g) exp(V(s, g)) (Appendix A)."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, PRNGKeyArray

from everystate.hyperparameters import Pairs


def replaced(
    config: Pairs,
    log_prob_curriculum: Float[Array, " batch"],
    log_prob_state: Float[Array, " batch"],
    *,
    key: PRNGKeyArray,
) -> Bool[Array, " batch"]:
    """Whether s_c takes the place of s (Algorithm 1).

    With probability p_curric p_f(s_c) / (p_curric p_f(s_c) + (1 - p_curric) p_f(s)), computed as
    a sigmoid of log-densities under f.
    """
    odds = jax.scipy.special.logit(config.p_curric) + log_prob_curriculum - log_prob_state
    return jax.random.uniform(key, odds.shape) < jax.nn.sigmoid(odds)


def curriculum_weights(
    config: Pairs, squared_errors: Float[Array, " batch"], targets: Float[Array, " batch"]
) -> Float[Array, " batch"]:
    """l exp(v_targ), by which c's log-likelihood is weighted.

    Literally they can be anything between 0 and overflow; normalised, they sum to at most one
    and no example has more than `curriculum_share` of the minibatch [D5].
    """
    if not config.normalise_curriculum:
        return squared_errors * jnp.exp(targets) / squared_errors.size
    share = jax.nn.softmax(jnp.log(squared_errors + 1e-8) + targets)
    return jnp.minimum(share, config.curriculum_share)
