"""How long one action takes on one core: `python benchmarks/acting.py [--json] [--rounds N]`.

The shipped agents, one state and one goal at a time, by the policy and with planning; medians over
rounds that take turns, in milliseconds, beside the body's control step: what is below is real time.
"""

import argparse
import json
import os
import platform
import statistics
import time

import numpy as np

import everystate
from everystate.envs import make

AGENTS = ("ramp-pointmass", "cartpole")


def action_ms(agent: everystate.Agent, state: np.ndarray, *, plan: bool, seed: int) -> float:
    """Milliseconds of one call."""
    started = time.perf_counter()
    agent.act(state, state, plan=plan, seed=seed)
    return 1000 * (time.perf_counter() - started)


def main() -> None:
    """Measures and prints."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--json", action="store_true", help="one JSON object on the last line")
    parser.add_argument("--rounds", type=int, default=200)
    options = parser.parse_args()
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    result: dict = {"benchmark": "acting", "rounds": options.rounds, "cores": 1}
    result["machine"] = f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores"
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
    if options.json:
        print(json.dumps(result))
    else:
        print(*(f"{name}: {value}" for name, value in result.items()), sep="\n")


if __name__ == "__main__":
    main()
