"""Control steps a second of the bodies: `python benchmarks/envs.py [--json] [--curve]`.

50 bodies under random actions on 2 threads, by our vector environment; by `mujoco.batch.Batch`
alone, which is all the physics there is; and by Gymnasium's Sync- and AsyncVectorEnv of the same
model, as a subclass of its MujocoEnv that `gymnasium.make_vec` makes. All variants take turns
within one process, and the ratios are medians over the turns, so that a busy machine slows down
both sides. EnvPool's cartpole counts where EnvPool is installed; it has no ant like ours. `--curve`
adds the cost of one control step of one body for 1 to 1,000 bodies.
"""

import json
import statistics
import time
from collections.abc import Callable
from typing import Any

import _benchmark as benchmark
import gymnasium
import mujoco
import mujoco.batch
import numpy as np
from gymnasium.envs.mujoco import MujocoEnv

from everystate import envs
from everystate.envs import MujocoVectorEnv

BODIES = ("cartpole", "ant")
NUM_ENVS = 50
THREADS = 2
Step = Callable[[np.ndarray], Any]


class Plain(MujocoEnv):
    """The body as Gymnasium would have it: its own MuJoCo class, positions and velocities seen."""

    metadata: dict[str, Any] = {"render_modes": ["human", "rgb_array", "depth_array"]}  # noqa: RUF012

    def __init__(self, body: str, **kwargs: Any) -> None:
        model, frame_skip = _model(body)
        space = gymnasium.spaces.Box(-np.inf, np.inf, (model.nq + model.nv,), np.float64)
        env = envs.make(body, 1, 0)
        assert isinstance(env, MujocoVectorEnv)
        pace = round(1 / (model.opt.timestep * frame_skip))
        self.metadata = Plain.metadata | {"render_fps": pace}
        super().__init__(str(env.body.xml.resolve()), frame_skip, space, **kwargs)

    def _seen(self) -> np.ndarray:
        return np.concatenate([self.data.qpos, self.data.qvel])

    def reset_model(self) -> np.ndarray:
        """As in the file."""
        self.set_state(self.init_qpos, self.init_qvel)
        return self._seen()

    def step(self, action: Any) -> tuple[np.ndarray, np.float64, bool, bool, dict]:
        """One control step."""
        self.do_simulation(action, self.frame_skip)
        return self._seen(), np.float64(0.0), False, False, {}


# One register for all modes of `make_vec`.
for _body in BODIES:
    gymnasium.register(f"Plain-{_body}-v0", Plain, kwargs={"body": _body})


def _model(body: str) -> tuple[mujoco.MjModel, int]:
    env = envs.make(body, 1, 0)
    assert isinstance(env, MujocoVectorEnv)
    return env.model, env.body.frame_skip


def ours(body: str, num: int) -> Step:
    """Our vector environment."""
    return envs.make(body, num, 0, num_threads=min(THREADS, num)).step


def raw(body: str, num: int) -> Step:
    """The batch alone: signals in, physics."""
    model, frame_skip = _model(body)
    batch = mujoco.batch.Batch(model, num, nthread=min(THREADS, num))
    ctrl = batch.bind("ctrl")

    def step(actions: np.ndarray) -> None:
        ctrl[:] = actions
        batch.step(nstep=frame_skip)

    return step


def gymnasium_vector(mode: str) -> Callable[[str, int], Step]:
    """What `gymnasium.make_vec` makes of the body, in this process or in one process each."""

    def make(body: str, num: int) -> Step:
        vector = gymnasium.make_vec(f"Plain-{body}-v0", num_envs=num, vectorization_mode=mode)
        vector.reset()
        return vector.step

    return make


def pool(body: str, num: int) -> Step | None:
    """EnvPool, if it is installed and has the body."""
    try:
        import envpool  # pyright: ignore[reportMissingImports]
    except (ImportError, OSError):  # the wheel of 1.2.5 lacks files that it looks for on import
        return None
    if body != "cartpole":
        return None
    vector = envpool.make_gymnasium(
        "CartpoleSwingup-v1",
        num_envs=num,
        num_threads=THREADS,
        frame_skip=4,
        max_episode_steps=10**9,
    )
    vector.reset()
    return vector.step


VARIANTS: dict[str, Callable[[str, int], Step | None]] = {
    "ours": ours,
    "raw": raw,
    "sync": gymnasium_vector("sync"),
    "async": gymnasium_vector("async"),
    "envpool": pool,
}


def rate(step: Step, actions: np.ndarray, seconds: float) -> float:
    """Control steps a second, of all bodies together."""
    count, started = 0, time.perf_counter()
    while (elapsed := time.perf_counter() - started) < seconds:
        for one in actions:
            step(one)
        count += actions.shape[0] * actions.shape[1]
    return count / elapsed


def compare(body: str, rounds: int, seconds: float) -> dict[str, Any]:
    """Rates of all variants, in turns, and what ours are of the others'."""
    steps = {name: step for name, make in VARIANTS.items() if (step := make(body, NUM_ENVS))}
    env = envs.make(body, NUM_ENVS, 0)
    rng = np.random.default_rng(0)
    actions = rng.uniform(-1, 1, (20, *env.action_space.shape)).astype(np.float32)
    rates: dict[str, list[float]] = {name: [] for name in steps}
    for _ in range(rounds):
        for name, step in steps.items():
            rates[name].append(rate(step, actions, seconds))
    result: dict[str, Any] = {f"{n}_per_s": round(statistics.median(r)) for n, r in rates.items()}
    for name in steps:
        if name != "ours":
            ratios = [a / b for a, b in zip(rates["ours"], rates[name], strict=True)]
            result[f"ratio_to_{name}"] = round(statistics.median(ratios), 3)
    return result


def curve(body: str, seconds: float) -> dict[str, float]:
    """Microseconds per control step of one body, by the number of bodies."""
    costs = {}
    for num in (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000):
        step = ours(body, num)
        size = envs.make(body, 1, 0).single_action_space.shape[0]
        actions = np.random.default_rng(0).uniform(-1, 1, (5, num, size)).astype(np.float32)
        costs[str(num)] = round(1e6 / rate(step, actions, seconds), 2)
    return costs


def main() -> None:
    """Measures and prints."""
    parser = benchmark.options(__doc__, rounds=9, seconds=0.5)
    parser.add_argument("--curve", action="store_true", help="also 1 to 1,000 bodies")
    options = parser.parse_args()
    result: dict[str, Any] = {
        "benchmark": "envs",
        "num_envs": NUM_ENVS,
        "threads": THREADS,
        "machine": benchmark.machine(),
        "bodies": {b: compare(b, options.rounds, options.seconds) for b in BODIES},
    }
    if options.curve:
        result["us_per_step"] = {body: curve(body, options.seconds) for body in BODIES}
    if options.json:
        print(json.dumps(result))
        return
    for body, readings in result["bodies"].items():
        print(body, *(f"  {name}: {value}" for name, value in readings.items()), sep="\n")
    for body, costs in result.get("us_per_step", {}).items():
        print(f"{body}, us per control step by bodies: {costs}")
    benchmark.say_what_moved(result)


if __name__ == "__main__":
    main()
