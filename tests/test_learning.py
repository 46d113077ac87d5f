"""Learning is learned: two bodies, each from a fixed seed, reach what they are asked here.

Bounds lie far above what nothing learned gets, and under what a run that learns gets, by enough for
another processor or another seed; both were measured, and stand beside each bound.
"""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import everystate
from everystate import envs, evaluation
from everystate.evaluation import rollout
from known_bodies import LENGTH, STEP

pytestmark = pytest.mark.slow


@pytest.fixture
def run(tmp_path: Path) -> Path:
    return tmp_path / "run"


def learn(run: Path, body: str, environment: dict[str, str], **options: int) -> None:
    """In a process such as a user starts, whose programs are optimised."""
    words = [f"--{name.replace('_', '-')}={value}" for name, value in options.items()]
    command = [sys.executable, "-m", "everystate", "train", body, "--quiet", "--run-dir", str(run)]
    here = Path(__file__).parent  # where the body's module is found
    subprocess.run([*command, *words], cwd=here, env=environment, check=True)


def test_a_chain_is_learned_to_its_known_step_counts(run: Path, as_users: dict[str, str]) -> None:
    """From the left wall to each of 20 places: no policy can take fewer steps than are known."""
    learn(
        run,
        "known_bodies:Chain-v0",
        as_users,
        seed=0,
        epochs=30,
        width=32,
        depth=2,
        state_layers=3,
        curriculum_layers=3,
        capacity=80_000,
        num_updates=40,
    )
    agent = everystate.load(run)
    known = np.arange(1, LENGTH + 1)
    goals = -1 + STEP * known[:, None]
    env = envs.make("known_bodies:Chain-v0", LENGTH, 0)
    begun, _ = env.reset(seed=0)
    states = rollout(agent, env, begun, goals, LENGTH + 10, plan=False, seed=0)
    off = np.abs(states - goals)[..., 0]
    near = off < STEP / 2
    taken = np.where(near.any(axis=0), near.argmax(axis=0), 1_000)
    # Learned: 100 %. Random actions: 4 % in the mean of 2,000 tries, 15 % in the best; none: 0 %.
    assert (taken <= known + 1).mean() >= 0.9, taken
    # And stays there. Learned: 100 %; random actions: 4 %.
    assert near[-1].mean() >= 0.9, off[-1]
    # -V of all pairs of places, the last step being free. Learned: 1.6 off in the mean; all 0: 6.0.
    places = np.linspace(-1, 1, LENGTH + 1, dtype=np.float32)
    starts, ends = (x.reshape(-1, 1) for x in np.meshgrid(places, places))
    steps = np.abs(starts - ends)[:, 0] / STEP
    wrong = np.abs(agent.steps_to_goal(starts, ends) - np.maximum(steps - 1, 0))
    assert wrong.mean() < 3


def test_a_pendulum_stands_rests_where_it_is_told_and_passes_what_play_found(
    run: Path, as_users: dict[str, str]
) -> None:
    """Gymnasium's, by `quick` as it is, for a fifth of its epochs.

    Asked for are to stand upright, which its motor is too weak for without a swing; 20 angles up to
    0.3 rad from hanging, each held by a torque of its own (its motor holds up to 0.4); and the
    states of random play, in motion too, to be passed.
    """
    body = "gymnasium:Pendulum-v1"
    learn(run, body, as_users, seed=0, epochs=20)
    agent = everystate.load(run)
    angles = np.pi + np.linspace(-0.3, 0.3, 20)
    goals = np.stack([np.cos(angles), np.sin(angles), np.zeros(20)], axis=1)
    env = envs.make(body, 20, 0)
    begun, _ = env.reset(seed=0)
    cosine, sine, velocity = rollout(agent, env, begun, goals, 100, plan=False, seed=0)[-1].T
    off = np.abs(np.angle(np.exp(1j * (np.arctan2(sine, cosine) - angles))))
    rests = (off < 0.2) & (np.abs(velocity) < 0.5)
    # Learned: 100 %. Random actions: 0 %; no torque, which never damps the swing: 5 %.
    assert rests.mean() >= 0.75, off
    upright = np.tile([[1.0, 0.0, 0.0]], (20, 1))
    begun, _ = env.reset(seed=1)
    cosine, _, velocity = rollout(agent, env, begun, upright, 150, plan=False, seed=0)[-20:].T
    # Learned: 100 %. Random actions and no torque: 0 %.
    assert ((cosine > 0.98) & (np.abs(velocity) < 0.5)).all(axis=1).mean() >= 0.9
    # Learned: 100 %. No torque: 0 %, as the suite is made; random actions: seldom.
    motion = evaluation.evaluate(agent)["suites"]["motion"]["policy"]["success"]["max"]
    assert motion["all"]["0.5"]["hit"] >= 0.9
