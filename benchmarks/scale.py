"""Collection by collectors on Ray: `python benchmarks/scale.py [--json] [--rounds N]`.

Ramp Pointmass, networks of preset `quick`, 64 bodies. `ratio_one_collector`: seconds to collect an
epoch by one collector on this machine over those in this process; medians of five times as many
rounds, in turns. Then transitions a second by the number of collectors, all on this machine: of the
body as it is, which shows what its cores give, and of one that waits 20 ms at every step, as a slow
simulator or a robot does, which shows what collectors give. Bytes are of what is sent, serialised
as Ray does. Needs Ray: everystate's extra `scale`.
"""

import statistics
import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import _benchmark as benchmark
import jax
from ray import cloudpickle

from everystate import preset
from everystate.agent import keep_compiled_programs
from everystate.config import Config
from everystate.scaling import on_ray
from everystate.training.bodies import make_bodies
from everystate.training.collection import collect, warm_up
from everystate.training.groups import Crew, Groups, InProcess, size_of
from everystate.training.learner import compiled

FAST, SLOW = "ramp-pointmass", "_slow_ramp:SlowRamp"
BODIES = 64
SHORT = {"steps_per_epoch": 10, "warmup_steps": 10}
"""An epoch of bodies that wait."""


def config_of(body: str, collectors: int) -> Config:
    """One that many collectors divide."""
    steps = SHORT if body == SLOW else {}
    ramp = preset("quick", FAST, num_bodies=BODIES, capacity=1600 * BODIES, **steps)
    return replace(ramp, body=body, collectors=collectors)


class Collecting:
    """A run that only collects."""

    def __init__(self, config: Config, crew: Crew | None = None) -> None:
        self.config, self.learner = config, compiled(config)
        crew = crew or InProcess(self.learner, make_bodies(config, size_of(config)))
        self.groups = Groups(config, crew, lambda: False)
        snapshot = warm_up(config, make_bodies(config, 1), self.groups)
        assert snapshot is not None
        self.snapshot = snapshot
        self.epoch()  # It compiles.

    def epoch(self) -> float:
        """Seconds that the next epoch takes."""
        started = time.perf_counter()
        done = collect(self.learner, self.groups, self.snapshot)
        assert done is not None
        agent, collected = done
        jax.block_until_ready(agent.episodes.goals)
        taken = time.perf_counter() - started
        self.snapshot = self.snapshot._replace(
            agent=agent._replace(epoch=agent.epoch + 1),
            env=collected.env,
            observations=collected.observations,
        )
        self.collected = collected
        return taken

    def rate(self, rounds: int) -> float:
        """Transitions a second."""
        taken = statistics.median(self.epoch() for _ in range(rounds))
        return round(self.config.num_bodies * self.config.steps_per_epoch / taken, 1)


def overhead(rounds: int) -> dict[str, Any]:
    """Of one collector, and what is sent."""
    with on_ray(1) as crew:
        here, there = Collecting(config_of(FAST, 0)), Collecting(config_of(FAST, 1), crew)
        pairs = [(here.epoch(), there.epoch()) for _ in range(5 * rounds)]
    transitions = BODIES * here.config.steps_per_epoch
    agent, collected = jax.device_get((here.snapshot.agent.actor, here.collected))
    drawn = jax.device_get(here.learner.draw(here.snapshot.agent))
    return {
        "epoch_here_ms": round(1000 * statistics.median(one for one, _ in pairs), 1),
        "epoch_collector_ms": round(1000 * statistics.median(other for _, other in pairs), 1),
        "ratio_one_collector": round(statistics.median(b / a for a, b in pairs), 3),
        "bytes_per_broadcast": size(agent),
        "bytes_per_transition_to_collectors": round(size(drawn) / transitions, 1),
        "bytes_per_transition_back": round(size(collected) / transitions, 1),
    }


def size(tree: Any) -> int:
    """Bytes on the wire."""
    return len(cloudpickle.dumps(tree))  # pyright: ignore[reportPrivateImportUsage]


def rates(body: str, counts: Sequence[int], rounds: int) -> dict[str, float]:
    """Transitions a second by the number of collectors."""
    found = {}
    for count in counts:
        with on_ray(count) as crew:
            found[str(count)] = Collecting(config_of(body, count), crew).rate(rounds)
    return found


def main() -> None:
    """Measures and prints."""
    parser = benchmark.options(__doc__, rounds=7)
    parser.add_argument("--counts", type=int, nargs="+", default=[1, 2, 4, 8, 16, 32])
    options = parser.parse_args()
    keep_compiled_programs()
    result = {"benchmark": "scale", "machine": benchmark.machine(), **overhead(options.rounds)}
    result["rates"] = rates(FAST, options.counts, options.rounds)
    result["rates_waiting"] = slow = rates(SLOW, options.counts, options.rounds)
    most, least = max(options.counts), min(options.counts)
    result["ratio_waiting_to_linear"] = round(
        slow[str(most)] / slow[str(least)] / (most / least), 3
    )
    benchmark.show(result, as_json=options.json, out=options.out)


if __name__ == "__main__":
    main()
