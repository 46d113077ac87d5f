"""Algorithm 1 of Zhang (2019), its inner loop, as plainly as NumPy can say it.

To be read beside the paper's Appendix A and B.1, with its symbols, and with nothing of this
package. Misprints are read as in `docs/algorithm.md`, section 2; what it lists in section 3 and
as [D11] is marked. The stabilisers that preset `paper` adds stand in one place, each a function
of one or two lines that does nothing in the paper's own algorithm.

Arrays are float64, examples lie in their leading axes. Derivatives are complex steps,
f'(x) = Im f(x + ih) / h, which are exact but for rounding, and so learned arrays are complex:
whatever compares numbers does so by their real parts.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy import exp, log, sqrt

Array = Any
"""Of NumPy, real or complex: its own types allow no `.real` of either."""
H = 1e-30


# --- B: multilayer perceptrons with PReLU ---------------------------------------------------------


class MLP(NamedTuple):
    """Hidden layers and a last one."""

    weights: list[Array]
    biases: list[Array]
    slopes: list[Array]  # Of the hidden layers' PReLUs.

    def __call__(self, x: Array) -> Array:
        for weight, bias, slope in zip(self.weights, self.biases, self.slopes, strict=False):
            x = x @ weight.T + bias
            x = np.where(x.real > 0, x, slope * x)
        return x @ self.weights[-1].T + self.biases[-1]


# --- B.1: smooth PReLU, and its inverse -----------------------------------------------------------


def h(x: Array, alpha: Array, beta: Array) -> tuple[Array, Array]:
    """alpha x, a (x^2 + 1) + b x, beta x [misprint 1]; and its derivative."""
    a, b = (beta - alpha) / 4, (beta + alpha) / 2
    pieces = [x.real <= -1, x.real >= 1]
    y = np.select(pieces, [alpha * x, beta * x], a * (x**2 + 1) + b * x)
    return y, np.select(pieces, [alpha + 0 * x, beta + 0 * x], 2 * a * x + b)


def h_inverse(y: Array, alpha: Array, beta: Array) -> tuple[Array, Array]:
    """The root of a x^2 + b x + (a - y) = 0, in the form that allows a = 0; and its derivative."""
    a, b = (beta - alpha) / 4, (beta + alpha) / 2
    pieces = [(y + alpha).real <= 0, (y - beta).real >= 0]
    middle = np.where(pieces[0] | pieces[1], 0, y)  # Outside there may be no root.
    root = 2 * (middle - a) / (b + sqrt(b**2 - 4 * a * (a - middle)))
    x = np.select(pieces, [y / alpha, y / beta], root)
    return x, 1 / h(x, alpha, beta)[1]


# --- 2.4, B.1: flows ------------------------------------------------------------------------------


class Flow(NamedTuple):
    """f_enc(x) = W_1 h_1(W_2 h_2^-1(... W_n x)). Lists are in the order of i; P and d_sgn fixed."""

    P: list[Array]
    d_sgn: list[Array]
    L: list[Array]
    U: list[Array]
    d: list[Array]
    log_alpha: list[Array]
    log_beta: list[Array]
    mlp: MLP | None = None
    places: tuple[list[Array], list[Array], list[Array]] = ([], [], [])
    """Which of the MLP's outputs are those of d_i, log alpha_i and log beta_i."""

    def given(self, c: Array | None) -> tuple[list[Array], list[Array], list[Array]]:
        """(d_i, log alpha_i, log beta_i) = MLP(c), added to learned ones [section 3]."""
        own = self.d, self.log_alpha, self.log_beta
        if self.mlp is None or c is None:
            return own
        move = self.mlp(c)
        pairs = (zip(*both, strict=True) for both in zip(own, self.places, strict=True))
        d, log_alpha, log_beta = ([x + move[..., at] for x, at in pair] for pair in pairs)
        return d, log_alpha, log_beta

    def W(self, i: int, d: list[Array]) -> Array:  # noqa: N802
        """P L D U of layer i, D = diag(d_sgn exp(d))."""
        one = np.eye(self.L[i].shape[0])
        D = one * (self.d_sgn[i] * exp(d[i]))[..., None, :]
        return self.P[i] @ (np.tril(self.L[i], -1) + one) @ D @ (np.triu(self.U[i], 1) + one)

    def enc(self, x: Array, c: Array | None = None) -> tuple[Array, Array]:
        """z = f_enc(x; c), and log |det dz/dx|."""
        d, log_alpha, log_beta = self.given(c)
        n = len(d)
        z, log_det = times(self.W(n - 1, d), x), d[n - 1].sum(-1)
        for i in reversed(range(n - 1)):
            bend = h if i % 2 == 0 else h_inverse  # i + 1 in the paper's count: h_1 = h
            z, slope = bend(z, exp(log_alpha[i]), exp(log_beta[i]))
            z, log_det = times(self.W(i, d), z), log_det + log(slope).sum(-1) + d[i].sum(-1)
        return z, log_det

    def dec(self, z: Array, c: Array | None = None) -> Array:
        """x = f_dec(z; c)."""
        d, log_alpha, log_beta = self.given(c)
        n = len(d)
        for i in range(n - 1):
            bend = h_inverse if i % 2 == 0 else h
            z = times(np.linalg.inv(self.W(i, d)), z)
            z, _ = bend(z, exp(log_alpha[i]), exp(log_beta[i]))
        return times(np.linalg.inv(self.W(n - 1, d)), z)

    def log_p(self, x: Array, c: Array | None = None) -> Array:
        """Equation 1, with z ~ N(0, I)."""
        z, log_det = self.enc(x, c)
        return -(z**2 + log(2 * np.pi)).sum(-1) / 2 + log_det


def times(W: Array, x: Array) -> Array:
    """W x, for arrays of both."""
    return (W @ x[..., None])[..., 0]


# --- Algorithm 1: what it has, and what it is told ------------------------------------------------


class Models(NamedTuple):
    """f(s), d(s'|s,a), pi(a|s,g), c(s|g), V(s,g)."""

    f: Flow
    d: Flow
    pi: Flow
    c: Flow
    V: MLP
    unit: Array
    """Of s' - s, which is what d models [section 3]."""

    def next(self, s: Array, a: Array, eps: Array) -> Array:
        """s' = d(s, a; eps)."""
        return s + self.unit * self.d.dec(eps, cat(s, a))

    def log_d(self, s: Array, a: Array, s_next: Array) -> Array:
        """log d(s'|s,a)."""
        return self.d.log_p((s_next - s) / self.unit, cat(s, a)) - log(self.unit).sum()


def value(V: MLP, s: Array, g: Array) -> Array:
    """V(s, g)."""
    return V(cat(s, g))[..., 0]


def cat(s: Array, g: Array) -> Array:
    """Both of them, of as many examples as either has."""
    shape = np.broadcast_shapes(s.shape[:-1], g.shape[:-1])
    both = [np.broadcast_to(x, (*shape, x.shape[-1])) for x in (s, g)]
    return np.concatenate(both, axis=-1)


class Minibatch(NamedTuple):
    """mb_size samples from each of the replay buffers."""

    s: Array
    g: Array
    t: tuple[Array, Array, Array]
    """s^d, a^d, s'^d."""
    g_t: Array
    """Goals of the transitions in hindsight: s'^d, or what followed it [2.3, section 3]."""


class Chance(NamedTuple):
    """All random numbers of one update; the noises of likelihoods only if there are any [D3]."""

    z: Array
    """Of s_c, [mb_size, state]."""
    u: Array
    """Uniform in [0, 1]: whether s_c replaces s, [mb_size]."""
    z_pi: Array
    """Of a^pi, [mb_size, j, action]."""
    a_rand: Array
    """Uniform in [-1, 1], [mb_size, j, action]."""
    z_grad: Array
    """Of the s' that each gradient is taken at, [mb_size, 2 j, state]."""
    eps: Array
    """[mb_size, N, state]."""
    noise: dict[str, Array]
    """Standard normal, by what it is added to."""


class Stabilisers(NamedTuple):
    """What preset `paper` adds to the paper; as they stand here they do nothing."""

    state_noise: float = 0.0
    dynamics_noise: float = 0.0
    action_noise: float = 0.0
    lowest: float | None = None
    share: float | None = None
    longest_step: float = np.inf
    largest_norm: float = np.inf

    def noisy(self, x: Array, noise: Array, sd: Array | float) -> Array:
        """Likelihoods have a noise floor [D3]."""
        return x + sd * noise

    def bounded(self, v: Array) -> Array:
        """V_targ stays within the values it can have [D4]."""
        if self.lowest is None:
            return v
        return np.select([v.real < self.lowest, v.real > 0], [self.lowest + 0 * v, 0 * v], v)

    def shares(self, l: Array, v: Array, weights: Array) -> Array:  # noqa: E741
        """Curriculum weights are normalised, and limited [D5]."""
        if self.share is None:
            return weights
        w = (l + 1e-8) * exp(v - v.max())
        return np.minimum(w / w.sum(), self.share)

    def clipped(self, gradient: list[Array]) -> list[Array]:
        """A gradient clip for each model [D6]."""
        norm = sqrt(sum((x**2).sum() for x in gradient))
        return [x * min(1, self.largest_norm / norm) for x in gradient]

    def limited(self, step: Array) -> Array:
        """The candidates' gradient step is limited [D12]."""
        return np.clip(step, -self.longest_step, self.longest_step)


class Hyperparameters(NamedTuple):
    """Those of the inner loop."""

    p_curric: float
    k: float
    h: float
    rate: float


# --- Algorithm 1: Update_Value_Function_and_Policy ------------------------------------------------


def returns(
    models: Models, V_targ: MLP, s_next: Array, g: Array, hyper: Hyperparameters, add: Stabilisers
) -> Array:
    """r(s, a, s', g) + V_targ(s', g), r = -1 + exp(-k |f_enc(s') - f_enc(g)|^2)."""
    distance = ((models.f.enc(s_next)[0] - models.f.enc(g)[0]) ** 2).sum(-1)
    r = -1 + exp(-hyper.k * distance)
    return r + add.bounded(value(V_targ, s_next, g))


class Improvement(NamedTuple):
    """Of one (s, g)."""

    A_cand: Array
    outcomes: Array
    """r + V_targ of every candidate under every eps, [4 j, N]."""
    a_best: Array
    v_targ: float


def improve(
    models: Models,
    V_targ: MLP,
    s: Array,
    g: Array,
    chance: Chance,
    hyper: Hyperparameters,
    add: Stabilisers,
) -> Improvement:
    """The function's first half, for one (s, g) and with that one's share of chance."""
    # Sample A_cand = {a^pi ~ pi(s, g)} u {a^rand ~ U([-1, 1])}. Samples are clipped [section 3].
    A_cand = [np.clip(models.pi.dec(z, cat(s, g)).real, -1, 1) for z in chance.z_pi]
    A_cand += list(chance.a_rand)
    # For each a add a' = a + grad_a (r(s, a, s', g) + V_targ(s', g)) for s' ~ d(s, a).
    for a, z in list(zip(A_cand, chance.z_grad, strict=True)):

        def outcome(a: Array, z: Array = z) -> Array:
            return returns(models, V_targ, models.next(s, a, z), g, hyper, add)

        grad = np.array([outcome(a + 1j * H * e).imag / H for e in np.eye(len(a))])
        A_cand.append(np.clip(a + add.limited(grad), -1, 1))
    # Select a_best = argmax_a min_eps [r + V_targ]; eps are the same for all candidates.
    outcomes = np.array(
        [returns(models, V_targ, models.next(s, a, chance.eps), g, hyper, add).real for a in A_cand]
    )
    best = outcomes.min(axis=1).argmax()
    # Compute v_targ = 1/N sum [r + V_targ], where s'_i = d(s, a_best; eps_i) [misprint 3].
    v_targ = outcomes[best].sum() / len(chance.eps)
    return Improvement(np.array(A_cand), outcomes, A_cand[best], v_targ)


# --- Algorithm 1: for update in range(n_updates) --------------------------------------------------


class Update(NamedTuple):
    """What one update comes to."""

    s: Array
    """After the replacement."""
    improvements: list[Improvement]
    w_t: Array
    """Log of the transitions' new weights."""
    w_g: Array
    """Log of the goals' new weights."""
    losses: dict[str, Callable[[], Array]]
    """By model: what each minimises, in all of its terms, as a function of its learned arrays."""
    terms: dict[str, float]
    """By name: the losses, term by term."""


def update(
    models: Models,
    V_targ: MLP,
    minibatch: Minibatch,
    chance: Chance,
    hyper: Hyperparameters,
    add: Stabilisers,
) -> Update:
    """All of it with the models as they were before; then they step, all at once [D11]."""
    f, _, pi, c, V, _ = models
    s, g, (s_d, a_d, s_d_next), g_t = minibatch
    noise = chance.noise

    # Update f, d and pi to maximize the expected log-likelihood of f(s), d(s'|s, a), pi(a|s, g).
    def loss_f() -> Array:
        return -f.log_p(add.noisy(s_drawn, noise["f"], add.state_noise)).mean()

    def loss_d() -> Array:
        reached = add.noisy(s_d_next, noise["d"], add.dynamics_noise * models.unit)
        return -models.log_d(s_d, a_d, reached).mean()

    def loss_hindsight() -> Array:
        a = add.noisy(a_d, noise["hindsight"], add.action_noise)
        return -pi.log_p(a, cat(s_d, g_t)).mean()

    # Update the weight of t_i to 1 / (p_f(s^d) p_f(s'^d)), and that of g_i to 1 / p_f(g_i).
    w_t = -f.log_p(s_d).real - f.log_p(s_d_next).real
    w_g = -f.log_p(g).real

    # Sample s_c = c(g; z). Update s <- s_c with probability p_curric p_f(s_c) / (p_curric p_f(s_c)
    # + (1 - p_curric) p_f(s)).
    s_drawn, s_c, p = s, c.dec(chance.z, g).real, hyper.p_curric
    p_s, p_s_c = exp(f.log_p(s).real), exp(f.log_p(s_c).real)
    replace = chance.u < p * p_s_c / (p * p_s_c + (1 - p) * p_s)
    s = np.where(replace[:, None], s_c, s)

    # For each (s, g) do (l, v) = Update_Value_Function_and_Policy(s, g).
    improvements = [
        improve(models, V_targ, s[i], g[i], one_of(chance, i), hyper, add) for i in range(len(s))
    ]
    a_best = np.array([x.a_best for x in improvements])
    v = np.array([x.v_targ for x in improvements])
    l = (value(V, s, g).real - v) ** 2  # noqa: E741

    def loss_V() -> Array:  # noqa: N802
        return ((value(V, s, g) - v) ** 2).mean()

    def loss_pi() -> Array:
        return -pi.log_p(add.noisy(a_best, noise["pi"], add.action_noise), cat(s, g)).mean()

    # Update c(s|g) to maximize the probability of s, weighted by l exp(v).
    weights = add.shares(l, v, l * exp(v) / len(s))

    def loss_c() -> Array:
        return -(weights * c.log_p(add.noisy(s, noise["c"], add.state_noise), g)).sum()

    # Update V to minimize V(g, g)^2.
    def loss_goals() -> Array:
        return (value(V, g, g) ** 2).mean()

    return Update(
        s,
        improvements,
        w_t,
        w_g,
        losses={
            "f": loss_f,
            "d": loss_d,
            "pi": lambda: loss_pi() + loss_hindsight(),
            "c": loss_c,
            "V": lambda: loss_V() + loss_goals(),
        },
        terms={
            "f": float(loss_f().real),
            "d": float(loss_d().real),
            "pi": float(loss_pi().real),
            "hindsight": float(loss_hindsight().real),
            "c": float(loss_c().real),
            "V": float(loss_V().real + loss_goals().real),
        },
    )


def one_of(chance: Chance, i: int) -> Chance:
    """What chance decides about (s_i, g_i)."""
    return Chance(*(x[i] for x in chance[:-1]), noise={})


def decayed(weights: Array, hyper: Hyperparameters) -> Array:
    """Downweight all states in the state replay buffer by w_state_decay = 0.5^(1/h)."""
    return weights * 0.5 ** (1 / hyper.h)


# --- The gradient step ----------------------------------------------------------------------------


def gradient(loss: Callable[[], Array], theta: list[Array]) -> list[Array]:
    """Of a loss of learned arrays, one number of these after the other."""
    result = [np.zeros(x.shape) for x in theta]
    for x, dx in zip(theta, result, strict=True):
        for at in np.ndindex(x.shape):
            x[at] += 1j * H
            dx[at] = loss().imag / H
            x[at] -= 1j * H
    return result


class Adam(NamedTuple):
    """Kingma & Ba (2014): moments, and how many steps they have seen."""

    m: list[Array]
    v: list[Array]
    t: int

    def step(self, theta: list[Array], grad: list[Array], rate: float) -> list[Array]:
        """New arrays in the place of theta."""
        t = self.t + 1
        result = []
        for x, dx, m, v in zip(theta, grad, self.m, self.v, strict=True):
            m = (0.9 * m + 0.1 * dx) / (1 - 0.9**t)
            v = (0.999 * v + 0.001 * dx**2) / (1 - 0.999**t)
            result.append(x.real - rate * m / (sqrt(v) + 1e-8))
        return result
