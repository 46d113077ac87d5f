"""How an update's cost grows: `python benchmarks/scaling.py [--json] [--rounds N]`.

Milliseconds of an update of the cartpole's size at preset `paper`, with one number changed at a
time: transitions stored, rollouts N, state size, minibatch; and of a control step by the number of
bodies. Rings are full, of made-up transitions; medians of rounds, in which all sizes take turns.
The once-an-epoch work (sums of all weights after collection) is timed on its own, and
`with_epoch_ms` spreads it over n_updates. Where it is stored transitions that change, a call is a
whole epoch of updates, as what is done once in each call grows with them.
`--from JSON --figure PNG` draws a raw result.
"""

import json
import math
import resource
import statistics
import time
from operator import itemgetter
from pathlib import Path
from typing import Any

import _benchmark as benchmark
import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt

from everystate import preset
from everystate.agent import keep_compiled_programs
from everystate.learning import weights as w
from everystate.learning.models import Scale, Space
from everystate.learning.replay import Transitions
from everystate.learning.state import AgentState
from everystate.training.learner import begin, compiled

PER_CALL = 5
STEPS = 10
STORED = (10_000, 100_000, 1_000_000, 10_000_000)
SERIES: dict[str, tuple[int, ...]] = {
    "stored": STORED,
    "N": (1, 20, 100),
    "state_size": (2, 5, 29, 64),
    "minibatch": (250, 1000, 4000),
    "bodies": (1, 50, 1000),
}


def full(config: Any, size: int) -> AgentState:
    """A run's state with every slot of the ring filled."""
    keys = iter(jax.random.split(jax.random.key(0), 8))

    def made_up(*shape: int) -> jax.Array:
        return jax.random.normal(next(keys), (*shape, size))

    steps = (config.warmup_steps, config.num_bodies)
    states, actions = made_up(*steps), jnp.zeros((*steps, 1))
    few = Transitions(states, actions, states + 0.1 * made_up(*steps), states)
    state = begin(config, Space(size, 1), few, Scale(jnp.zeros(size), jnp.ones(size)))
    before = made_up(config.capacity)
    rings = Transitions(before, jnp.zeros((config.capacity, 1)), before + 0.1, before[:, :0])
    log = jnp.where(jnp.arange(state.replay.states.log.size) < config.capacity, 0.0, -jnp.inf)
    replay = state.replay._replace(
        transitions=rings,
        states=w.weigh(log, w.AS_THEY_ARE),
        goals=w.weigh(log.copy(), w.tempering(config)),
        of_transitions=w.weigh(log.copy(), w.tempering(config)),
        size=jnp.array(config.capacity, jnp.int32),
    )
    return state._replace(replay=jax.tree.map(jnp.array, replay))


class Subject:
    """One size of the algorithm, and how long its parts took in every round so far."""

    def __init__(self, *, stored=0, N=20, state_size=5, minibatch=1000, bodies=50) -> None:
        self.updates = preset("paper").num_updates if stored else PER_CALL
        fields = {
            "capacity": stored or 100_000,
            "N": N,
            "batch_size": minibatch,
            "num_bodies": bodies,
        }
        fields |= {"num_updates": self.updates, "target_period": self.updates}
        fields |= {"steps_per_epoch": STEPS, "warmup_steps": 5}
        config = preset("paper", "cartpole", **fields)
        self.learner, self.state = compiled(config), full(config, state_size)
        self.observations = jnp.zeros((bodies, state_size))
        steps = jnp.zeros((1, bodies, state_size))
        self.one = Transitions(steps, jnp.zeros((1, bodies, 1)), steps, steps)
        self.taken: dict[str, list[float]] = {"update_ms": [], "act_ms": [], "epoch_ms": []}
        self.round()
        for times in self.taken.values():  # It compiled.
            times.clear()

    def round(self) -> None:
        """Some updates with an epoch's own work before them, and some control steps."""
        state, taken = self.state, self.taken
        started = time.perf_counter()
        state = jax.block_until_ready(self.learner.observe(state, self.one))
        observed = time.perf_counter()
        state, *_ = jax.block_until_ready(self.learner.update(state))
        updated = time.perf_counter()
        # An epoch of control steps, with what is drawn for all of them at once.
        draws, episodes = jax.device_get(self.learner.draw(state)), state.episodes
        for step in range(STEPS):
            now, actor = jax.tree.map(itemgetter(step), draws), state.actor
            episodes, actions = self.learner.act(actor, episodes, now, self.observations)
            actions.block_until_ready()
        taken["epoch_ms"].append(1000 * (observed - started))
        taken["update_ms"].append(1000 * (updated - observed) / self.updates)
        taken["act_ms"].append(1000 * (time.perf_counter() - updated) / STEPS)
        self.state = state

    def medians(self) -> dict[str, float]:
        """Milliseconds of an update, of a control step and of an epoch's own work."""
        medians = {name: round(statistics.median(times), 2) for name, times in self.taken.items()}
        spread = medians["update_ms"] + medians["epoch_ms"] / preset("paper").num_updates
        return medians | {"with_epoch_ms": round(spread, 2)}


def draw(result: dict[str, Any], path: Path) -> None:
    """One panel for each number that was changed."""
    series = result["series"]
    columns = min(len(series), 3)
    rows = math.ceil(len(series) / columns)
    figure, axes = plt.subplots(
        rows, columns, figsize=(3.4 * columns, 2.6 * rows), layout="constrained", squeeze=False
    )
    for axis in axes.flat[len(series) :]:
        axis.remove()
    for axis, (name, costs) in zip(axes.flat, series.items(), strict=False):
        y = "act_ms" if name == "bodies" else "with_epoch_ms"
        taken = [cost[y] for cost in costs.values()]
        axis.plot([int(x) for x in costs], taken, "o-")
        axis.set(xscale="log", xlabel=name.replace("_", " "), ylim=(0, 1.1 * max(taken)))
        axis.set_xticks(
            [int(x) for x in costs],
            [x if int(x) < 10_000 else f"{int(x):.0e}".replace("e+0", "e") for x in costs],
        )
        axis.set_xticks([], minor=True)
        axis.set_ylabel("ms per control step" if name == "bodies" else "ms per update")
        axis.grid(alpha=0.3, which="both")
    figure.suptitle(f"preset paper, cartpole's size; {result['machine']}", fontsize=9)
    figure.savefig(path, dpi=120)


def main() -> None:
    """Measures and prints, or draws."""
    parser = benchmark.options(__doc__, rounds=5)
    parser.add_argument("--series", nargs="+", default=list(SERIES), choices=SERIES)
    parser.add_argument("--from", dest="source", type=Path, help="raw result to draw")
    parser.add_argument("--figure", type=Path, help="PNG to write")
    options = parser.parse_args()
    if options.source:
        return draw(json.loads(options.source.read_text()), options.figure)
    keep_compiled_programs()
    series: dict[str, Any] = {}
    for name in options.series:
        subjects = {str(value): Subject(**{name: value}) for value in SERIES[name]}
        for _ in range(options.rounds):  # In turn: the machine is not the same for long.
            for subject in subjects.values():
                subject.round()
        series[name] = {value: subject.medians() for value, subject in subjects.items()}
        del subjects
        jax.clear_caches()
        compiled.cache_clear()
        if not options.json:
            print(name, *(f"  {value}: {cost}" for value, cost in series[name].items()), sep="\n")
    result: dict[str, Any] = {
        "benchmark": "scaling",
        "machine": benchmark.machine(),
        "series": series,
        "peak_memory_mb": round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024),
    }
    if stored := series.get("stored"):
        costs = [cost["with_epoch_ms"] for cost in stored.values()]
        result["flatness_over_stored"] = round(max(costs) / min(costs), 3)
    if options.json:
        print(json.dumps(result))
    else:
        benchmark.say_what_moved(result)


if __name__ == "__main__":
    main()
