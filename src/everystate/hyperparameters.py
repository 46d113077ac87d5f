"""Every hyper-parameter once, with the paper's symbol, in groups: what a part reads is its group.

Symbols and sections are those of Zhang (2019), "Generalized Skill Learning, Safety, and
Exploration with Flow-Based Models". Deviations from the paper carry their number in
`docs/algorithm.md`, in the form [D3].
"""

import math
from dataclasses import dataclass
from typing import Literal

RewardShape = Literal["exponential", "two-slopes"]
FlowFamily = Literal["pldu", "coupling-affine", "coupling-spline", "autoregressive-spline"]


@dataclass(frozen=True)
class Body:
    """The body and the seed."""

    body: str = "ramp-pointmass"
    """Body to learn: a built-in name, the path of an MJCF file (NAME.xml), or MODULE:ID."""
    body_options: tuple[str, ...] = ()
    """Options of the body, each as name=value: travel=true, action_noise=0.1."""
    seed: int = 0
    """Seed of everything random in the run."""


@dataclass(frozen=True)
class Goals:
    """Goals (4.1)."""

    m: int = 20
    """m: goals decoded from f per choice, of which the least likely is kept."""
    goals: Literal["imagined", "visited", "any-visited", "uniform"] = "imagined"
    """Where the m come from: decoded from f (paper); drawn from the goal buffer, evenly over the
    space visited [D17]; visited states, each as likely as any other; or the box of all states."""
    rare_share: float = 1.0
    """Share of the goals that are the least likely of m (4.1); the others are any visited [D32]."""
    calm_share: float = 0.0
    """Share of those others, and of goals learned from, that hardly changed in a step [D32]."""


@dataclass(frozen=True)
class Units:
    """Units."""

    units: Literal["fixed", "running"] = "fixed"
    """Of states: the body's own, or the spread of what was visited, which grows with it [D33]."""
    any_heading: bool = False
    """What is learned facing one way holds facing any, of a body on level ground [D44]."""


@dataclass(frozen=True)
class Returns:
    """Reward and value (4.2, 4.3)."""

    objective: Literal["paper-sum", "hold-and-pass"] = "paper-sum"
    """What V counts: the sum of rewards (paper); or that, for a policy that holds its goals, and
    how well and soon a goal is met, for another that passes them [D31]."""
    reward_space: Literal["latent", "state"] = "latent"
    """Where |dz| is taken: latent space of f (paper), or scaled states, which stay put [D9]."""
    reward_shape: RewardShape = "exponential"
    """exp(-k |dz|^2) (paper); or half a cusp exp(-sqrt(k) |dz|), which is felt until the goal is
    met exactly [D38], and half 1 / (1 + |dz|^2 / n), dz in steps, which is felt from afar by what
    is slow to change [D45]."""
    k: float = 100.0
    """k: shaping of the reward -1 + exp(-k |dz|^2)."""
    kernel_width: float = 0.0
    """If above 0, k is 1 / (n width^2): the width of the reward is a root mean square over the n
    components, so that it means the same in any number of dimensions [D34]."""
    discount: float = 1.0
    """Weight of V_targ beside r; at 1 (paper) V counts steps without a horizon [D18]."""
    absorb: float = 0.0
    """Chance that reaching the goal ends the count: 0 is r + V_targ, 1 V(g,g) = 0 [D10]."""
    bound_value: bool = True
    """V_targ is held below 0, and targets are within -(copies + 1) and 0 [D4]."""
    goal_value_weight: float = 1.0
    """Weight of V(g,g)^2 beside (V - v_targ)^2."""
    relative_errors: bool = False
    """V's squared errors count per unit of 1 + |v_targ|: near a goal V must be exact [D29]."""


@dataclass(frozen=True)
class PolicyImprovement:
    """Safe improvement (4.3, Algorithm 1)."""

    j: int = 1
    """j: policy samples, and as many random actions, per candidate set."""
    N: int = 20
    """N: dynamics rollouts per candidate, sharing their noise."""
    pessimism: Literal["percentile", "mean"] = "percentile"
    """How N returns become one score: a percentile (paper: the 0th, the min) or the mean."""
    percentile: float = 0.0
    """Which percentile of the N returns; 0 is the min, 100 the max."""
    max_gradient_step: float = math.inf
    """Longest step of candidates along the gradient of r + V_targ, per component, in units of
    action [D12]."""
    sensor_noise: float = 0.0
    """Sd of noise added to imagined next states, in scaled units (4.3)."""
    imagined_steps: int = 0
    """How many steps the policy imagines ahead: it climbs what V counts on the way, and that is
    V's target. 0 is neither: r + V_targ after one step (paper, eq. 2) [D25], [D26]."""
    imagined_weight: float = 50.0
    """Weight of that in the policy's loss [D25]."""
    steepest: float = math.inf
    """Most that a unit of an imagined action gains, in steps: a longer gradient is cut [D41]."""
    value_stride: int = 0
    """V learns at every so many-th state of an imagined way, the first of which is s; 0: only at s
    [D42]."""
    improved_share: float = 1.0
    """Share of a minibatch for which candidates are compared [D26]."""
    kept_steps: int = 1
    """Candidates judged by imagined ways are kept for 1 to this many steps [D40]."""
    hindsight: bool = True
    """Also fit pi(a|s,g) to transitions, with g the state that they reached (2.3)."""


@dataclass(frozen=True)
class Pairs:
    """Pairs of a state and a goal, and the curriculum (Appendix A)."""

    p_curric: float = 0.8
    """p_curric: prior probability that a state comes from c(s|g); `quick` lowers it [D14]."""
    normalise_curriculum: bool = True
    """Weights l exp(v) become shares of the minibatch, each limited [D5]."""
    curriculum_share: float = 0.05
    """Largest share one example may have of a normalised minibatch [D5]."""
    approach_share: float = 0.0
    """Share of the pairs (s, g) in which s led to g, rather than drawn on its own [D19]."""
    approach_steps: int = 64
    """How many steps before g such an s lies, at most."""
    pursued_share: float = 0.0
    """Share of the pairs (s, g) in which a body at s was on its way to g [D24]."""


@dataclass(frozen=True)
class Buffers:
    """Replay (Appendix A)."""

    capacity: int = 100_000
    """Items per replay ring."""
    batch_size: int = 1000
    """mb_size: items drawn per update from each buffer."""
    half_life: float = 20.0
    """h: epochs in which a state's weight halves."""
    weight_temper: float = 1.0
    """Exponent of the 1/p_f weights; below 1 flattens them [D1]."""
    weight_clip: float = math.inf
    """Log-weights are clipped to this many nats around the buffer's median [D1]."""


@dataclass(frozen=True)
class Collection:
    """Collection (Algorithm 1, Appendix B)."""

    num_bodies: int = 50
    """Bodies stepped in parallel."""
    collectors: int = 0
    """Processes of a Ray cluster that the bodies are divided among; 0: all are in this one."""
    steps_per_epoch: int = 50
    """Control steps of every body per epoch."""
    warmup_steps: int = 50
    """Control steps of uniformly random actions before the first epoch."""
    patience: int = 1
    """Steps with V(s,g) below its best that end an episode; 1 is the paper's rule [D2]."""
    max_episode_steps: int = 200
    """Cap on an episode's length."""
    wander_share: float = 0.0
    """Share of the episodes in which a body acts at random from where its last one ended [D22]."""
    wander_steps: int = 4
    """Steps for which such a body keeps to an action."""
    interval: int = 1
    """Control steps between states that are learned from, for which an action is kept meanwhile;
    0: measured, and from then on as many as the body's pace asks for [D47]."""
    central_share: float = 0.0
    """Share of the bodies that act by the centre of pi, z = 0, for an epoch [D24]."""


@dataclass(frozen=True)
class Fitting:
    """Learning (Appendix B)."""

    num_updates: int = 100
    """n_updates: updates per epoch."""
    dynamics_updates: int = 1
    """Steps of d in each update, on minibatches of its own beyond the first [D23]."""
    centre_weight: float = 0.0
    """Weight, in d's loss, of the squared error of its centre, z = 0 [D28]."""
    target_period: int = 100
    """Updates per copy of V to V_targ; n_updates is the paper's one copy per episode [D8]."""
    learning_rate: float = 1e-3
    """Adam's step size; twice the paper's in `quick` [D15]."""
    rate_halving: float = math.inf
    """Epochs t after which the step size has halved: it falls as 1 / (1 + epoch / t) [D35]."""
    averaged: float = 0.0
    """Share of the run so far over which weights are averaged, for the agent that is kept and for
    the d that imagines; 0: none [D35]."""
    gradient_clip: float = math.inf
    """Largest gradient norm, for each model on its own [D6]."""
    state_noise: float = 0.03
    """Sd added to states when f and c are fitted, in scaled units."""
    dynamics_noise: float = 0.03
    """Sd added to s' - s when d is fitted, in units of its own sd."""
    action_noise: float = 0.1
    """Sd added to actions when pi is fitted, in units of action."""


@dataclass(frozen=True)
class Networks:
    """Networks and flows (Appendix B, B.1)."""

    depth: int = 4
    """Hidden layers of every MLP."""
    width: int = 200
    """Units per hidden layer."""
    frequencies: int = 0
    """Octaves of sines and cosines that join every MLP's inputs; the paper has none [D13]."""
    both_goals: bool = False
    """V and pi see g and g - s [D20]."""
    centres: bool = False
    """d and pi are a centre, a network of its own, and a flow around it [D36]."""
    flow: FlowFamily = "pldu"
    """Family of the four flows: the paper's, or one of FlowJAX's."""
    state_layers: int = 20
    """n of f(s)."""
    dynamics_layers: int = 2
    """n of d(s'|s,a)."""
    policy_layers: int = 2
    """n of pi(a|s,g)."""
    curriculum_layers: int = 20
    """n of c(s|g)."""
    alternate: bool = True
    """Whether h and its inverse take turns from layer to layer (B.1); PLDU flows only."""
    flow_shift: bool = False
    """A learned shift per PLDU layer, which the paper's flow lacks [D7]."""
