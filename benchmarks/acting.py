"""How long one action takes on one core: `python benchmarks/acting.py [--out FILE] [--rounds N]`.

The shipped agents, one state and one goal at a time, by the policy, with planning, and towards a
goal that asks for one component; medians over rounds that take turns, in milliseconds, beside the
body's control step: what is below is real time.
"""

import os
import statistics
import time

import _benchmark as benchmark
import numpy as np

import everystate
from everystate.envs import make

AGENTS = ("ramp-pointmass", "cartpole", "ant")


def action_ms(agent: everystate.Agent, state: np.ndarray, *, how: str, seed: int) -> float:
    """Milliseconds of one call."""
    part = {agent.state_names[0]: float(state[0])}
    started = time.perf_counter()
    agent.act(state, part if how == "part" else state, plan=how == "planning", seed=seed)
    return 1000 * (time.perf_counter() - started)


def main() -> None:
    """Measures and prints."""
    parser = benchmark.options(__doc__, rounds=200)
    options = parser.parse_args()
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    result: dict = {"benchmark": "acting", "rounds": options.rounds, "cores": 1}
    result["machine"] = benchmark.machine()
    for name in AGENTS:
        agent, env = everystate.load(name), make(name, 1, 0)
        state = env.reset(seed=0)[0][0]
        times: dict[str, list[float]] = {how: [] for how in ("policy", "planning", "part")}
        for i in range(options.rounds + 5):
            for how, taken in times.items():
                taken.append(action_ms(agent, state, how=how, seed=i))
        result[name] = {f"{how}_ms": statistics.median(x[5:]) for how, x in times.items()}
        result[name]["control_step_ms"] = 1000 * (env.control_step or float("nan"))
    benchmark.show(result, as_json=options.json, out=options.out)


if __name__ == "__main__":
    main()
