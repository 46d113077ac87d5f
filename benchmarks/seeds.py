"""Several seeds in one program: `python benchmarks/seeds.py [--json] [--rounds N] [--epochs N]`.

What an update costs each of 1, 2, 4 and 8 seeds that `jax.vmap` has learn side by side on one
device, at preset `quick` after some epochs of training; medians of rounds in which all take turns.
`ratio_to_one_by_one` is how much quicker they are than one after the other, with `processes` for
seeds in processes of their own, at once and on a core each, as a sweep has them.
"""

import os
import statistics
import subprocess
import sys
import time
from typing import Any

import _benchmark as benchmark
import equinox as eqx
import jax
import jax.numpy as jnp
from updates import seconds, trained

from everystate import algorithm, preset
from everystate.agent import keep_compiled_programs
from everystate.config import Config
from everystate.learning.state import AgentState
from everystate.training.learner import jit

SEEDS = (1, 2, 4, 8)
UPDATES = 5
ALONE_S = 40.0
"""Long enough for processes that do not start together."""


def config_of(seed: int, **fields: Any) -> Config:
    """One seed's."""
    return preset("quick", "cartpole", seed=seed, **fields)


def on_a_core(core: int, epochs: int) -> None:
    """Prints the seconds of a call in this process, on this core alone."""
    os.sched_setaffinity(0, {core})
    state = trained(config_of(core), epochs)[0]
    call = side_by_side(config_of(core, num_updates=UPDATES, target_period=UPDATES), [state])
    call()
    until, taken = time.monotonic() + ALONE_S, []
    while time.monotonic() < until:
        taken.append(seconds(call))
    print(statistics.median(taken))


def on_all_cores(epochs: int) -> float:
    """Seconds of a call for each seed, of as many processes as cores."""
    command = [sys.executable, __file__, "--epochs", str(epochs), "--core"]
    cores = sorted(os.sched_getaffinity(0))
    running = [
        subprocess.Popen([*command, str(core)], stdout=subprocess.PIPE, text=True) for core in cores
    ]
    said = [process.communicate()[0] for process in running]
    return statistics.mean(map(float, said)) / len(cores)


def side_by_side(config: Config, states: list[AgentState]) -> Any:
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
    parser.add_argument("--core", type=int, help="only seconds of a call on this core")
    options = parser.parse_args()
    keep_compiled_programs()
    if options.core is not None:
        return on_a_core(options.core, options.epochs)
    alone = on_all_cores(options.epochs)
    config = config_of(0, num_updates=UPDATES, target_period=UPDATES)
    states = [trained(config_of(seed), options.epochs)[0] for seed in range(max(SEEDS))]
    calls = {count: side_by_side(config, states[:count]) for count in SEEDS}
    taken: dict[int, list[float]] = {count: [] for count in SEEDS}
    for _ in range(options.rounds + 1):
        for count, call in calls.items():
            taken[count].append(seconds(call))
    each = {str(n): statistics.median(times[1:]) / n for n, times in taken.items()}
    each["processes"] = alone
    result = {
        "benchmark": "seeds",
        "machine": benchmark.machine(),
        "device": jax.default_backend(),
        "preset": "quick, cartpole",
        "ms_per_update_and_seed": {n: round(1000 * x / UPDATES, 2) for n, x in each.items()},
        "ratio_to_one_by_one": {n: round(each["1"] / x, 3) for n, x in each.items()},
    }
    benchmark.show(result, as_json=options.json, out=options.out)


if __name__ == "__main__":
    main()
