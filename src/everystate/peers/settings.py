"""Settings of other people's agents: one table, of which a row goes into the results.

Published are those of rl-baselines3-zoo at commit 22e3ff2, its files `hyperparams/sac.yml` and
`tqc.yml`; `her.yml` says itself that it is out of use. What they do not name is the default of
Stable-Baselines3 2.9 and stands here all the same. Used as they are, but for three things: an
episode lasts the longest horizon of the body's goal suite, not the 50 steps of Fetch and Panda;
learning starts after one whole episode of every body, where that is later, as hindsight needs one;
and it ends by the clock, not after the 20,000 or 1,000,000 steps that the files name.
"""

from dataclasses import dataclass, replace
from typing import Literal


@dataclass(frozen=True)
class PeerSettings:
    """How a peer learns, by the names of Stable-Baselines3 where it has one."""

    algorithm: Literal["sac", "tqc"]
    source: str
    """Where the settings come from."""
    num_envs: int
    """Bodies stepped together."""
    gradient_steps: int
    """After every `train_freq` steps of all bodies together."""
    batch_size: int
    net_arch: tuple[int, ...]
    """Layers of the actor, and of every critic."""
    gamma: float
    tau: float
    learning_rate: float = 1e-3
    n_critics: int = 2
    normalize: bool = False
    """Inputs and rewards by their running mean and spread (`VecNormalize`)."""
    learning_starts: int = 100
    train_freq: int = 1
    buffer_size: int = 1_000_000
    n_sampled_goal: int = 4
    goal_selection_strategy: str = "future"
    reward: Literal["sparse", "dense"] = "sparse"
    """`goal_env.GoalVecEnv` says what they are."""
    resets: bool = True
    """Whether an episode starts from a new initial state, or where the last one ended."""


# Many bodies at once and few updates for each of their steps: on one core most of the time then
# goes into updates, and a body has seen much by the end. Tau and learning rate are those of
# FetchPush-v1, minibatches those of FetchReach-v1; the discount is longer than either, as a body
# takes up to a hundred steps to its goal.
_MIXTURE = PeerSettings(
    "sac",
    "a mixture of the zoo's FetchReach-v1 and FetchPush-v1, for many bodies and a longer way",
    num_envs=50,
    gradient_steps=8,
    batch_size=256,
    net_arch=(256, 256, 256),
    gamma=0.98,
    tau=0.05,
)
# The only task with goals in sac.yml.
_SAC_REACH = PeerSettings(
    "sac",
    "rl-baselines3-zoo, hyperparams/sac.yml, FetchReach-v1",
    num_envs=1,
    gradient_steps=1,
    batch_size=256,
    net_arch=(64, 64),
    gamma=0.95,
    tau=0.005,
    normalize=True,
    learning_starts=1000,
)
_TQC_REACH = replace(
    _SAC_REACH,
    algorithm="tqc",
    source="rl-baselines3-zoo, hyperparams/tqc.yml, FetchReach-v1 (PandaReach-v1 is the same)",
    n_critics=1,
)
_TQC_PUSH = PeerSettings(
    "tqc",
    "rl-baselines3-zoo, hyperparams/tqc.yml, FetchPush-v1 (her-defaults: Fetch and Panda tasks)",
    num_envs=1,
    gradient_steps=1,
    batch_size=2048,
    net_arch=(512, 512, 512),
    gamma=0.95,
    tau=0.05,
)
_WITH_RESETS = {
    "sac-her": _MIXTURE,
    "tqc-her": replace(_MIXTURE, algorithm="tqc"),
    "sac-her-zoo": _SAC_REACH,
    "tqc-her-zoo": _TQC_REACH,
    "tqc-her-zoo-push": _TQC_PUSH,
}
SETTINGS: dict[str, PeerSettings] = {}
"""By the name of the contestant."""
for _name, _row in _WITH_RESETS.items():
    SETTINGS[_name] = _row
    SETTINGS[f"{_name}-dense"] = replace(_row, reward="dense")
    SETTINGS[f"{_name}-no-reset"] = replace(_row, resets=False)
