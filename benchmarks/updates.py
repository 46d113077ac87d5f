"""Updates a second at preset `paper`: `python benchmarks/updates.py [--json] [--rounds N]`.

For the bodies' state sizes, after some epochs of real training, in one process and in turns: our
update; the float32 matrix-product peak of this machine; and a straightforward PyTorch version
(benchmarks/_torch_update.py), where PyTorch is installed. `fraction_of_peak` is the arithmetic that
Algorithm 1 asks for (benchmarks/_arithmetic.py) times updates/s over that peak: it can exceed 1, as
candidates that cannot win are dropped early. Ratios are medians over the rounds. `parts_ms` times
the parts on their own, and collection's share for each update; `peak_memory_mb` is the process's.
"""

import json
import resource
import statistics
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import _benchmark as benchmark
import jax
import jax.numpy as jnp
import numpy as np
from _arithmetic import update_flops

from everystate import preset
from everystate.agent import keep_compiled_programs
from everystate.config import Config
from everystate.learning import replay as rb
from everystate.learning.flows import decode
from everystate.learning.losses import gradients
from everystate.learning.models import step
from everystate.learning.objectives import objectives
from everystate.learning.policy import Improvement, improve
from everystate.learning.state import AgentState
from everystate.learning.value import lowest
from everystate.training.bodies import make_bodies
from everystate.training.collection import collect, to_device, warm_up
from everystate.training.groups import Groups, InProcess
from everystate.training.learner import Learner, compiled, jit

BODIES = ("ramp-pointmass", "cartpole", "ant")
PER_CALL = 10
"""Updates of one call, with one target copy."""


def seconds(call: Callable[[], Any]) -> float:
    """Of one call, until its results are there."""
    started = time.perf_counter()
    jax.block_until_ready(call())
    return time.perf_counter() - started


def peak_flops(size: int = 2048) -> Callable[[], float]:
    """Measures the float32 matrix product of this machine, in operations a second."""
    matrix = jnp.ones((size, size))
    product = jax.jit(lambda x: x @ x)
    product(matrix).block_until_ready()
    return lambda: 2 * size**3 / min(seconds(lambda: product(matrix)) for _ in range(5))


def trained(config: Config, epochs: int) -> tuple[AgentState, Learner, float]:
    """The body's own data and the models that some epochs made of them; seconds to collect one."""
    env, learner, collecting = make_bodies(config, config.num_bodies), compiled(config), 0.0
    groups = Groups(config, InProcess(learner, env), lambda: False)
    snapshot = warm_up(config, env, groups)
    assert snapshot is not None
    for _ in range(epochs):
        started = time.perf_counter()
        done = collect(learner, groups, snapshot)
        assert done is not None
        agent, collected = done
        agent = jax.block_until_ready(learner.observe(agent, to_device(collected.steps)))
        collecting = time.perf_counter() - started
        agent, *_ = jax.block_until_ready(learner.update(agent))
        snapshot = snapshot._replace(
            agent=agent, env=collected.env, observations=collected.observations
        )
    return snapshot.agent, learner, collecting


def parts_ms(config: Config, state: AgentState, rounds: int) -> dict[str, float]:
    """Milliseconds of each part of an update on its own, medians."""
    key = jax.random.key(0)
    aims, some = objectives(config, lowest(config, state.copies)), slice(config.improved_pairs)

    def draw(state: AgentState) -> rb.Minibatch:
        unit = state.models.dynamics.change_scale
        return rb.sample(config, state.replay, unit, key=key)

    def densities(state: AgentState, minibatch: rb.Minibatch) -> Any:
        m = minibatch
        scored = [m.states, m.states, m.goals, m.transitions.observations]
        scored = jnp.stack([*scored, m.transitions.next_observations])
        return state.models.state_flow.log_prob(scored)

    def curriculum(state: AgentState, minibatch: rb.Minibatch) -> Any:
        flow = state.models.curriculum
        latents = jax.random.normal(key, minibatch.goals.shape)
        return jax.vmap(lambda g, z: decode(flow(g), z))(minibatch.goals, latents)

    def best(state: AgentState, minibatch: rb.Minibatch, N: int) -> Any:
        fewer = replace(config, N=N)
        pairs = minibatch.states[some], minibatch.goals[some]
        known = zip(state.models.policies, state.target_values, aims, strict=True)
        return [improve(fewer, state.models, *one, *pairs, key=key) for one in known]

    def losses(state: AgentState, minibatch: rb.Minibatch, found: list[Improvement]) -> Any:
        models = state.models, state.kept.dynamics
        known = state.target_values, aims
        m = minibatch
        return gradients(config, *models, m, m.states, found, *known, key=key)[0]

    minibatch = jit(draw)(state)
    improvement = jit(lambda s, m: best(s, m, config.N))(state, minibatch)
    gradient = jit(losses)(state, minibatch, improvement)
    zeros = jnp.zeros(config.batch_size)
    calls = {
        "replay: drawing": (draw, (state,)),
        "goal and weight densities": (densities, (state, minibatch)),
        "curriculum's states": (curriculum, (state, minibatch)),
        "candidates, gradients, rollouts": (
            lambda s, m: best(s, m, config.N), (state, minibatch)
        ),
        "the same with one rollout each": (lambda s, m: best(s, m, 1), (state, minibatch)),
        "losses and their gradients": (losses, (state, minibatch, improvement)),
        "optimiser": (
            lambda s, g: step(config, s.models, g, s.optimisers), (state, gradient)
        ),
        "replay: new weights": (
            lambda s, m: rb.refresh(config, s.replay, m, zeros, zeros), (state, minibatch)
        ),
    }  # fmt: skip
    times = {}
    for name, (function, arguments) in calls.items():
        call = jit(function)
        taken = [seconds(lambda c=call, a=arguments: c(*a)) for _ in range(rounds + 1)]
        times[name] = round(1000 * statistics.median(taken[1:]), 2)
    return times


def torch_update(config: Config, state: AgentState) -> Callable[[], float] | None:
    """The peer on the same data, if PyTorch is installed."""
    try:
        import torch  # pyright: ignore[reportMissingImports]
        from _torch_update import TorchLearner
    except ImportError:
        return None
    torch.set_default_device("cuda" if jax.default_backend() == "gpu" else "cpu")
    torch.manual_seed(0)
    filled = int(state.replay.size)
    rings = state.replay.transitions
    held = (rings.observations, rings.actions, rings.next_observations)
    peer = TorchLearner(config, *(torch.tensor(np.array(x[:filled])) for x in held))
    return peer.update


def measure(body: str, rounds: int, epochs: int, peak: Callable[[], float]) -> dict[str, Any]:
    """All figures of one body."""
    config = preset("paper", body, num_updates=PER_CALL, target_period=PER_CALL, capacity=100_000)
    state, learner, collecting = trained(config, epochs)
    s, a = state.replay.transitions.observations.shape[1], state.replay.transitions.actions.shape[1]
    flops, peer = update_flops(config, s, a), torch_update(config, state)
    parts = parts_ms(config, state, rounds)
    parts["collection, per update"] = round(
        1000 * collecting / preset("paper", body).num_updates, 2
    )
    if peer:
        peer()
    ours, peaks, theirs, evaluated = [], [], [], []
    for _ in range(rounds):
        started = time.perf_counter()
        state, metrics, _ = jax.block_until_ready(learner.update(state))
        ours.append((time.perf_counter() - started) / PER_CALL)
        evaluated.append(float(metrics["policy/evaluated"]))
        peaks.append(peak())
        if peer:
            theirs.append(statistics.mean(seconds(peer) for _ in range(2)))
    fractions = [flops / own / top for own, top in zip(ours, peaks, strict=True)]
    result = {
        "state_size": s,
        "updates_per_s": round(1 / statistics.median(ours), 3),
        "gflop_per_update": round(flops / 1e9, 2),
        "peak_gflops": round(statistics.median(peaks) / 1e9, 1),
        "fraction_of_peak": round(statistics.median(fractions), 3),
        "returns_evaluated": round(statistics.mean(evaluated), 3),
    }
    if theirs:
        ratios = [theirs_ / own for theirs_, own in zip(theirs, ours, strict=True)]
        result["ratio_to_torch"] = round(statistics.median(ratios), 3)
    return result | {"parts_ms": parts}


def main() -> None:
    """Measures and prints."""
    parser = benchmark.options(__doc__, rounds=7, epochs=8)
    parser.add_argument("--bodies", nargs="+", default=BODIES, choices=BODIES)
    options = parser.parse_args()
    keep_compiled_programs()
    peak = peak_flops()
    result: dict[str, Any] = {
        "benchmark": "updates",
        "preset": "paper",
        "machine": benchmark.machine(),
        "device": jax.devices()[0].device_kind,
        "bodies": {b: measure(b, options.rounds, options.epochs, peak) for b in options.bodies},
    }
    used = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    result["peak_memory_mb"] = round(used / 1024)
    if options.json:
        print(json.dumps(result))
        return
    for body, figures in result["bodies"].items():
        parts = figures.pop("parts_ms")
        print(body, *(f"  {name}: {value}" for name, value in figures.items()), sep="\n")
        print(*(f"    {name}: {value} ms" for name, value in parts.items()), sep="\n")
        if "ratio_to_torch" not in figures:
            print("  no PyTorch here: pip install 'everystate[peers]' for ratio_to_torch")
    print(f"on {result['machine']} ({result['device']}), {result['peak_memory_mb']} MB at the peak")
    benchmark.say_what_moved(result)


if __name__ == "__main__":
    main()
