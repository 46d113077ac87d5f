"""How many floating-point operations Algorithm 1 asks of one update, counted from shapes.

Only matrix products count, 2 for a multiplication and an addition; a gradient's way back costs as
much as the way there, and twice as much where weights have gradients too. What an implementation
saves, as by dropping candidates that cannot win, or adds, is not in it.
"""

from everystate.config import Config


def update_flops(config: Config, s: int, a: int) -> float:
    """Of states with s and actions with a components."""

    def mlp(inputs: int, outputs: int) -> int:
        inner = (config.depth - 1) * config.width**2
        return 2 * (inputs * config.width + inner + config.width * outputs)

    def conditional(inputs: int, size: int, layers: int) -> tuple[int, int]:
        """Its network, once per condition, and its layers, once per sample."""
        return mlp(inputs, (3 * layers - 2) * size), 2 * layers * size**2

    f = 2 * config.state_layers * s**2
    value = mlp(2 * s, 1)
    d_net, d = conditional(s + a, s, config.dynamics_layers)
    pi_net, pi = conditional(2 * s, a, config.policy_layers)
    c_net, c = conditional(s, s, config.curriculum_layers)

    candidates = 4 * config.j
    outcome = d + f + value
    per_pair = {
        "densities": 5 * f,
        "curriculum's states": c_net + c,
        "policy's actions": pi_net + config.j * pi,
        "gradients of candidates": 2 * (2 * config.j) * (d_net + outcome),
        "rollouts": f + candidates * (d_net + config.N * outcome),
        "losses": 3 * (f + (d_net + d) + 2 * (pi_net + pi) + (c_net + c) + 2 * value),
    }
    return float(config.batch_size * sum(per_pair.values()))
