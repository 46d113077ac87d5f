"""How long one action takes on one core: `python benchmarks/acting.py [--out FILE] [--rounds N]`.

The shipped agents, one state and one goal at a time, by the policy and with planning; medians over
rounds that take turns, in milliseconds, beside the body's control step: what is below is real time.
"""

import os
import statistics
import time

import _benchmark as benchmark
import numpy as np

import everystate
from everystate.envs import make

AGENTS = ("ramp-pointmass", "cartpole", "ant")


def action_ms(agent: everystate.Agent, state: np.ndarray, *, plan: bool, seed: int) -> float:
    """Milliseconds of one call."""
    started = time.perf_counter()
    agent.act(state, state, plan=plan, seed=seed)
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
        times: dict[bool, list[float]] = {False: [], True: []}
        for i in range(options.rounds + 5):
            for plan, taken in times.items():
                taken.append(action_ms(agent, state, plan=plan, seed=i))
        policy, planning = (statistics.median(taken[5:]) for taken in times.values())
        step = 1000 * (env.control_step or float("nan"))
        result[name] = {"policy_ms": policy, "planning_ms": planning, "control_step_ms": step}
    benchmark.show(result, as_json=options.json, out=options.out)


if __name__ == "__main__":
    main()
