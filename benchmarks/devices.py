"""What devices cost one another: `python benchmarks/devices.py [--json] [--rounds N]`.

For 1, 2 and 4 devices: milliseconds of an update of the cartpole's size, and of an all-reduce of as
many numbers as the models have parameters, which is what an update adds up over devices.
`fraction_reducing` is the one over the other, medians of rounds in which all take turns. A CPU is
made to be several devices: these share its cores, so that only the fraction says anything there,
and of a real network nothing. `sent_bytes` is what one device sends for each update, if they stand
in a ring.
"""

import statistics
import time
from typing import Any

import _benchmark as benchmark
import equinox as eqx
import jax
import jax.numpy as jnp
from jax.sharding import NamedSharding, PartitionSpec
from scaling import full

from everystate import preset
from everystate.agent import keep_compiled_programs
from everystate.config import Config
from everystate.learning.models import Models, trainable
from everystate.learning.sharding import AXIS, mesh
from everystate.training.hosts import shared
from everystate.training.learner import compiled

DEVICES = (1, 2, 4)
PER_CALL = 5
STATE_SIZE = 5


def reducing(config: Config, models: Models) -> tuple[Any, Any]:
    """PER_CALL all-reduces of each device's own gradients, one after the other; and these."""
    share, copy = PartitionSpec(AXIS), PartitionSpec()
    rows = NamedSharding(mesh(config), share)
    gradients = jax.tree.map(
        lambda x: jax.device_put(jnp.ones((config.devices, *x.shape)), rows), trainable(models)
    )

    def of_each(gradient: Any) -> Any:
        def mean(_: Any, x: Any) -> Any:
            return jax.tree.map(lambda x: x / config.devices, jax.lax.psum(x, AXIS))

        return jax.lax.fori_loop(0, PER_CALL, mean, gradient)

    over_all = jax.shard_map(
        of_each, mesh=mesh(config), in_specs=share, out_specs=copy, check_vma=False
    )
    return jax.jit(over_all), gradients


class Subject:
    """So many devices, and how long both things took in every round so far."""

    def __init__(self, name: str, devices: int) -> None:
        fields = {"num_updates": PER_CALL, "target_period": PER_CALL, "devices": devices}
        config = preset(name, "cartpole", **fields)
        self.learner = compiled(config)
        state = full(config, STATE_SIZE)
        self.reduce, self.gradients = reducing(config, state.models)
        arrays = jax.tree.leaves(eqx.filter(state.models, eqx.is_inexact_array))
        self.bytes = sum(x.nbytes for x in arrays)
        self.devices, self.state = devices, shared(config, state)
        self.taken: dict[str, list[float]] = {"update_ms": [], "reduce_ms": []}
        self.round()
        for times in self.taken.values():  # It compiled.
            times.clear()

    def round(self) -> None:
        """Some updates, and as many all-reduces."""
        started = time.perf_counter()
        self.state, *_ = jax.block_until_ready(self.learner.update(self.state))
        updated = time.perf_counter()
        jax.block_until_ready(self.reduce(self.gradients))
        self.taken["update_ms"].append(1000 * (updated - started) / PER_CALL)
        self.taken["reduce_ms"].append(1000 * (time.perf_counter() - updated) / PER_CALL)

    def figures(self) -> dict[str, float]:
        """Medians, and the bytes of an update."""
        medians = {name: round(statistics.median(x), 3) for name, x in self.taken.items()}
        pairs = zip(self.taken["reduce_ms"], self.taken["update_ms"], strict=True)
        return medians | {
            "fraction_reducing": round(statistics.median(x / y for x, y in pairs), 4),
            "reduced_bytes": self.bytes if self.devices > 1 else 0,
            "sent_bytes": round(2 * (self.devices - 1) / self.devices * self.bytes),
        }


def main() -> None:
    """Measures and prints."""
    parser = benchmark.options(__doc__, rounds=7, preset="paper")
    options = parser.parse_args()
    jax.config.update("jax_num_cpu_devices", max(DEVICES))
    keep_compiled_programs()
    there = [devices for devices in DEVICES if devices <= jax.device_count()]
    subjects = [Subject(options.preset, devices) for devices in there]
    for _ in range(options.rounds):  # In turn: the machine is not the same for long.
        for subject in subjects:
            subject.round()
    result: dict[str, Any] = {
        "benchmark": "devices",
        "preset": options.preset,
        "machine": benchmark.machine(),
        "device": jax.devices()[0].device_kind,
        "devices": {str(subject.devices): subject.figures() for subject in subjects},
    }
    benchmark.show(result, as_json=options.json, out=options.out)


if __name__ == "__main__":
    main()
