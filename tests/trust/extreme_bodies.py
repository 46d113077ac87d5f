"""Bodies that numbers break on, and a run of each.

    python tests/trust/extreme_bodies.py [EPOCHS] [--out FILE]

All are points in a box, whose observation is something else: in units of 1e12 and 1e-12 at once,
with a component that never changes, that jumps, or that is there twice. Trains by `quick`; FILE
gets the last epoch of each: results/trust/extreme-bodies.json, of 20.
"""

import argparse
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

Point = np.ndarray
OBSERVED: dict[str, Callable[[Point], list[float]]] = {
    "Huge": lambda x: [1e12 * x[0], 1e-12 * x[1]],
    "Offset": lambda x: [1e6 + x[0], -1e6 + x[1]],
    "Constant": lambda x: [x[0], x[1], 3.0],
    "Jumping": lambda x: [x[0], x[1], 100.0 * np.sign(x[0])],
    "Twice": lambda x: [x[0], x[1], x[0]],
    "Still": lambda x: [0.0, 0.0],
}


class Extreme(gymnasium.Env):
    """A point that moves by a tenth of its action, and how it is seen."""

    def __init__(self, name: str, render_mode: str | None = None) -> None:
        self._seen = OBSERVED[name]
        size = len(self._seen(np.zeros(2)))
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (size,), np.float64)
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (2,), np.float32)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None):
        super().reset(seed=seed)
        self._x = self.np_random.uniform(-1, 1, 2)
        return np.array(self._seen(self._x)), {}

    def step(self, action):
        self._x = np.clip(self._x + 0.1 * action, -1, 1)
        return np.array(self._seen(self._x)), 0.0, False, False, {}


_entry: Any = Extreme
for _name in OBSERVED:
    gymnasium.register(f"{_name}-v0", _entry, kwargs={"name": _name})


def main() -> None:
    """One run of each."""
    import everystate
    from everystate.evaluation import raw
    from everystate.training.logging import read_metrics

    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("epochs", type=int, nargs="?", default=20)
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()

    sys.modules["extreme_bodies"] = sys.modules[__name__]  # by which name they are made
    result = {}
    for name in OBSERVED:
        with tempfile.TemporaryDirectory() as folder:
            run = everystate.train(
                f"extreme_bodies:{name}-v0",
                run_dir=Path(folder) / "run",
                progress=False,
                epochs=options.epochs,
            )
            last = read_metrics(run)[-1]
        kept = ("epoch", "update/taken", "loss/f", "loss/d", "loss/V", "loss/pi", "loss/c")
        result[name] = {key: last[key] for key in kept}
        print(name, result[name], flush=True)
    if options.out is not None:
        raw.write(options.out, {"preset": "quick", "seed": 0, "bodies": result}, replace=True)


if __name__ == "__main__":
    main()
