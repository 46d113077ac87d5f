"""Frames a second of films, at 320 x 240 with a ghost: `python benchmarks/rendering.py [--json]`.

Random play of every built-in body, drawn from its states; the best of three rounds, as what is
slower was disturbed.
"""

import time

import _benchmark as benchmark

from everystate.envs import BODIES, make, random_play


def frames_per_second(body: str, frames: int) -> float:
    """Of one call that draws so many."""
    env = make(body, 1, 0)
    states = random_play(env, frames, 0)[:, 0]
    best = 0.0
    for _ in range(3):
        started = time.perf_counter()
        env.render_states(states, states[-1])
        best = max(best, frames / (time.perf_counter() - started))
    return best


def main() -> None:
    """Measures and prints."""
    parser = benchmark.options(__doc__, frames=300)
    options = parser.parse_args()
    result = {
        "benchmark": "rendering",
        "frames_per_second": {name: frames_per_second(name, options.frames) for name in BODIES},
        "machine": benchmark.machine(),
    }
    benchmark.show(result, as_json=options.json, out=options.out)


if __name__ == "__main__":
    main()
