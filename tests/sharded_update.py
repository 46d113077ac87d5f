"""An update over four devices beside that over one: `python tests/sharded_update.py once|epoch`.

The last line is one JSON object: how far apart the two end, and for how many (s, g) they chose
other actions. A process of its own, as JAX asks how many devices a CPU is to be only once.
"""

import json
import sys
from functools import partial
from typing import Any

import equinox as eqx
import jax
import numpy as np

from everystate import algorithm, preset
from everystate.learning.sharding import whole
from everystate.training.hosts import local, shared
from test_algorithm import start

SMALL: dict[str, Any] = {"width": 8, "depth": 1, "frequencies": 0}
SMALL |= {f"{flow}_layers": 1 for flow in ("state", "dynamics", "policy", "curriculum")}


def result(what: str, devices: int) -> tuple[Any, Any]:
    """The state afterwards, and what the last update was computed from."""
    practice = 1 if what == "once" else 2
    config = preset("test", **SMALL, devices=devices, dynamics_updates=practice)
    arrays, static = eqx.partition(shared(config, start(config)), eqx.is_array)

    def changed(arrays: Any) -> tuple[Any, Any]:
        state = eqx.combine(arrays, static)
        if what == "once":
            step = partial(algorithm.update_once, key=jax.random.key(3))
        else:
            step = algorithm.update
        state, _, rest = step(config, state)
        return eqx.filter(state, eqx.is_array), rest

    everywhere: dict[str, Any] = {} if devices == 1 else {"out_shardings": whole(config)}
    return local(jax.jit(changed, **everywhere)(arrays))


def apart(one: Any, other: Any) -> float:
    """The largest difference between the numbers of two trees."""
    pairs = zip(jax.tree.leaves(one), jax.tree.leaves(other), strict=True)
    return max(float(np.max(np.abs(np.asarray(x) - np.asarray(y)), initial=0)) for x, y in pairs)


def main() -> None:
    """Compares and prints."""
    what = sys.argv[1]
    jax.config.update("jax_num_cpu_devices", 4)
    (one, batch), (four, other) = (result(what, devices) for devices in (1, 4))
    said: dict[str, Any] = {
        "models": apart(one.models, four.models),
        "optimisers": apart(one.optimisers, four.optimisers),
        "sums": apart(one.replay.goals.blocks, four.replay.goals.blocks),
    }
    if what == "once":
        moved = np.abs(np.asarray(batch.best_actions) - np.asarray(other.best_actions))
        said["other_actions"] = int((moved.max(axis=1) > 1e-3).sum())
        said["drawn"] = apart(batch.minibatch, other.minibatch)
    print(json.dumps(said))


if __name__ == "__main__":
    main()
