"""Several seeds in one program: `python benchmarks/seeds.py [--json] [--rounds N] [--epochs N]`.

What an update costs each of 1, 2, 4 and 8 seeds that `jax.vmap` has learn side by side on one
device, at preset `quick` after some epochs of training; medians of rounds in which all take turns.
`ratio_to_one_by_one` is how much quicker they are than one after the other.
"""

import statistics
from typing import Any

import _benchmark as benchmark
import equinox as eqx
import jax
import jax.numpy as jnp
from updates import seconds, trained

from everystate import algorithm, preset
from everystate.agent import keep_compiled_programs
from everystate.algorithm import AgentState
from everystate.training.learner import jit

SEEDS = (1, 2, 4, 8)
UPDATES = 5


def side_by_side(config: Any, states: list[AgentState]) -> Any:
    """A call of an epoch of updates of all these seeds."""
    _, static = eqx.partition(states[0], eqx.is_array)
    arrays = [eqx.filter(state, eqx.is_array) for state in states]
    stacked = jax.tree.map(lambda *leaves: jnp.stack(leaves), *arrays)

    def one(arrays: Any) -> Any:
        state, metrics, _ = algorithm.update(config, eqx.combine(arrays, static))
        return eqx.filter(state, eqx.is_array), metrics

    function = jit(jax.vmap(one))
    return lambda: function(stacked)


def main() -> None:
    """Measures and shows."""
    parser = benchmark.options(__doc__, rounds=7, epochs=5)
    options = parser.parse_args()
    keep_compiled_programs()
    fields = {"num_updates": UPDATES, "target_period": UPDATES}
    config = preset("quick", "cartpole", **fields)
    seeds = [preset("quick", "cartpole", seed=seed) for seed in range(max(SEEDS))]
    states = [trained(seed, options.epochs)[0] for seed in seeds]
    calls = {count: side_by_side(config, states[:count]) for count in SEEDS}
    taken: dict[int, list[float]] = {count: [] for count in SEEDS}
    for _ in range(options.rounds + 1):
        for count, call in calls.items():
            taken[count].append(seconds(call))
    each = {n: statistics.median(times[1:]) / (n * UPDATES) for n, times in taken.items()}
    result = {
        "benchmark": "seeds",
        "machine": benchmark.machine(),
        "device": jax.default_backend(),
        "preset": "quick, cartpole",
        "ms_per_update_and_seed": {str(n): round(1000 * x, 2) for n, x in each.items()},
        "ratio_to_one_by_one": {str(n): round(each[1] / x, 3) for n, x in each.items()},
    }
    benchmark.show(result, as_json=options.json)


if __name__ == "__main__":
    main()
