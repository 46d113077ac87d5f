"""The same update as a PyTorch user would write it: batched, no tricks, `paper`'s numbers.

The peer of `benchmarks/updates.py`. It has every part of Algorithm 1's inner loop: three weighted
draws, the curriculum's states, candidates and their gradients, all rollouts, six losses, one Adam
step per model with its clip, new weights.
"""

import math

import torch
from torch import Tensor, nn

LOG_2PI = math.log(2 * math.pi)


def mlp(inputs: int, outputs: int, width: int, depth: int) -> nn.Sequential:
    """`depth` hidden layers with PReLU."""
    layers: list[nn.Module] = []
    for _ in range(depth):
        layers += [nn.Linear(inputs, width), nn.PReLU()]
        inputs = width
    return nn.Sequential(*layers, nn.Linear(inputs, outputs))


def bend(x: Tensor, log_alpha: Tensor, log_beta: Tensor) -> tuple[Tensor, Tensor]:
    """The smooth PReLU and its log-slopes."""
    alpha, beta = log_alpha.exp(), log_beta.exp()
    m = x.clamp(-1, 1)
    y = torch.where(
        x.abs() < 1,
        (beta - alpha) / 4 * (x**2 + 1) + (beta + alpha) / 2 * x,
        torch.where(x < 0, alpha * x, beta * x),
    )
    return y, torch.log((beta * (1 + m) + alpha * (1 - m)) / 2)


def unbend(y: Tensor, log_alpha: Tensor, log_beta: Tensor) -> tuple[Tensor, Tensor]:
    """Its inverse, and the log-slopes of that."""
    alpha, beta = log_alpha.exp(), log_beta.exp()
    m = torch.minimum(torch.maximum(y, -alpha), beta)
    slope = (alpha * beta + (beta - alpha) * m).clamp(min=1e-12).sqrt()
    inside = 2 * (m - (beta - alpha) / 4) / ((beta + alpha) / 2 + slope)
    outside = torch.where(y < 0, y / alpha, y / beta)
    return torch.where((y > -alpha) & (y < beta), inside, outside), -torch.log(slope)


class Flow(nn.Module):
    """n layers of P L D U with h and its inverse between, conditional if it has a condition."""

    def __init__(self, size: int, layers: int, condition: int, width: int, depth: int) -> None:
        super().__init__()
        rotation = torch.linalg.qr(torch.randn(layers, size, size))[0]
        permutation, lower, upper = torch.linalg.lu(rotation)
        diagonal = upper.diagonal(dim1=1, dim2=2)
        self.register_buffer("permutation", permutation)
        self.register_buffer("sign", diagonal.sign())
        self.lower, self.upper = nn.Parameter(lower), nn.Parameter(upper / diagonal[..., None])
        self.log_d = nn.Parameter(diagonal.abs().log())
        self.log_alpha = nn.Parameter(torch.zeros(layers - 1, size))
        self.log_beta = nn.Parameter(torch.zeros(layers - 1, size))
        self.sizes = [layers * size, (layers - 1) * size, (layers - 1) * size]
        self.network = mlp(condition, sum(self.sizes), width, depth) if condition else None
        self.size, self.layers = size, layers

    def given(self, condition: Tensor | None = None) -> tuple[Tensor, Tensor, Tensor]:
        """log d, log alpha and log beta, [batch or 1, layers, size] each."""
        own = (self.log_d, self.log_alpha, self.log_beta)
        if self.network is None or condition is None:
            return tuple(x[None] for x in own)
        moves = self.network(condition).split(self.sizes, dim=-1)
        return tuple(x + m.unflatten(-1, (-1, self.size)) for x, m in zip(own, moves, strict=True))

    def triangles(self) -> tuple[Tensor, Tensor]:
        """P L and U of every layer."""
        eye = torch.eye(self.size)
        return self.permutation @ (self.lower.tril(-1) + eye), self.upper.triu(1) + eye

    def encode(self, x: Tensor, given: tuple[Tensor, Tensor, Tensor]) -> tuple[Tensor, Tensor]:
        """z = f_enc(x) and its log-determinant."""
        log_d, log_alpha, log_beta = given
        lower, upper = self.triangles()
        total = torch.zeros(x.shape[:-1])
        for i in range(self.layers):
            x = (x @ upper[i].T * (self.sign[i] * log_d[:, i].exp())) @ lower[i].T
            total = total + log_d[:, i].sum(-1)
            if i < self.layers - 1:
                h = bend if (self.layers - 1 - i) % 2 else unbend
                x, slopes = h(x, log_alpha[:, i], log_beta[:, i])
                total = total + slopes.sum(-1)
        return x, total

    def decode(self, z: Tensor, given: tuple[Tensor, Tensor, Tensor]) -> Tensor:
        """x = f_dec(z)."""
        log_d, log_alpha, log_beta = given
        lower, upper = (torch.linalg.inv(x) for x in self.triangles())
        for i in reversed(range(self.layers)):
            if i < self.layers - 1:
                h = unbend if (self.layers - 1 - i) % 2 else bend
                z, _ = h(z, log_alpha[:, i], log_beta[:, i])
            z = (z @ lower[i].T / (self.sign[i] * log_d[:, i].exp())) @ upper[i].T
        return z

    def log_prob(self, x: Tensor, given: tuple[Tensor, Tensor, Tensor]) -> Tensor:
        """Log-density."""
        z, log_det = self.encode(x, given)
        return log_det - (z**2 + LOG_2PI).sum(-1) / 2


class TorchLearner:
    """The models, buffers and optimisers, and one `update()`."""

    def __init__(self, config, states: Tensor, actions: Tensor, reached: Tensor) -> None:
        """Of a config and what its buffers hold, scaled: states, actions, next states."""
        s, a, size = states.shape[1], actions.shape[1], (config.width, config.depth)
        self.config, self.floor = config, -50.0
        self.f = Flow(s, config.state_layers, 0, *size)
        self.d = Flow(s, config.dynamics_layers, s + a, *size)
        self.pi = Flow(a, config.policy_layers, 2 * s, *size)
        self.c = Flow(s, config.curriculum_layers, s, *size)
        self.value, self.target = mlp(2 * s, 1, *size), mlp(2 * s, 1, *size)
        self.models = (self.f, self.d, self.pi, self.c, self.value)
        self.optimisers = [torch.optim.Adam(m.parameters(), 1e-3) for m in self.models]
        self.states, self.actions, self.reached = states, actions, reached
        self.change = (reached - states).std(0).clamp(min=1e-3)
        self.log_weights = {n: torch.zeros(len(states)) for n in ("state", "goal", "transition")}

    def _draw(self, name: str) -> Tensor:
        logs, config = self.log_weights[name], self.config
        if name != "state":
            logs = config.weight_temper * (logs - logs.median())
            logs = logs.clamp(-config.weight_clip, config.weight_clip)
        return torch.multinomial((logs - logs.max()).exp(), config.batch_size, replacement=True)

    def _returns(self, reached: Tensor, goals: Tensor) -> Tensor:
        given = self.f.given()
        places = self.f.encode(reached, given)[0], self.f.encode(goals, given)[0]
        near = torch.exp(-self.config.k * ((places[0] - places[1]) ** 2).sum(-1))
        goals = goals.expand_as(reached)
        value = self.target(torch.cat([reached, goals], -1))[..., 0].clamp(self.floor, 0)
        return near - 1 + value

    def improve(self, states: Tensor, goals: Tensor) -> tuple[Tensor, Tensor]:
        """a_best and v_targ, from all rollouts of all candidates."""
        config, (batch, s) = self.config, states.shape
        both = torch.cat([states, goals], -1).repeat(config.j, 1)
        given = self.pi.given(both)
        by_policy = self.pi.decode(torch.randn(batch * config.j, self.pi.size), given).clamp(-1, 1)
        started = torch.cat([by_policy, torch.rand_like(by_policy) * 2 - 1]).detach()
        started.requires_grad_(True)
        many_states, many_goals = (x.repeat(2 * config.j, 1) for x in (states, goals))
        step = self.d.decode(
            torch.randn_like(many_states), self.d.given(torch.cat([many_states, started], -1))
        )
        outcome = self._returns(many_states + self.change * step, many_goals).sum()
        (gradient,) = torch.autograd.grad(outcome, started)
        moved = (started + gradient.clamp(-1, 1)).clamp(-1, 1)
        with torch.no_grad():
            candidates = torch.cat([started, moved]).unflatten(0, (-1, batch)).transpose(0, 1)
            count = candidates.shape[1]
            rows = torch.cat([states[:, None].expand(-1, count, -1), candidates], -1).flatten(0, 1)
            noise = torch.randn(batch, 1, config.N, s).expand(-1, count, -1, -1).flatten(0, 1)
            given = tuple(x.repeat_interleave(config.N, 0) for x in self.d.given(rows))
            change = self.d.decode(noise.reshape(-1, s), given).view(batch, count, config.N, s)
            reached = states[:, None, None] + self.change * change
            returns = self._returns(reached, goals[:, None, None])
            best = returns.min(-1).values.argmax(1)
            every = torch.arange(batch)
            return candidates[every, best], returns[every, best].mean(-1)

    def update(self) -> float:
        """Once; the sum of the losses."""
        config = self.config
        with torch.no_grad():
            slots = {name: self._draw(name) for name in self.log_weights}
            states, goals = self.reached[slots["state"]], self.reached[slots["goal"]]
            t = slots["transition"]
            before, actions, after = self.states[t], self.actions[t], self.reached[t]
            proposed = self.c.decode(torch.randn_like(goals), self.c.given(goals))
            scored = torch.stack([states, proposed, goals, before, after])
            log_p = self.f.log_prob(scored, self.f.given())
            odds = math.log(config.p_curric / (1 - config.p_curric)) + log_p[1] - log_p[0]
            use = torch.rand_like(odds) < odds.sigmoid()
            starts = torch.where(use[:, None], proposed, states)
        best, target = self.improve(starts, goals)

        def noisy(x: Tensor, sd: float) -> Tensor:
            return x + sd * torch.randn_like(x)

        value = self.value(torch.cat([starts, goals], -1))[:, 0]
        errors = (value - target) ** 2
        share = torch.softmax(torch.log(errors.detach() + 1e-8) + target, 0)
        weights = share.clamp(max=config.curriculum_share)
        change = noisy((after - before) / self.change, config.dynamics_noise)
        pi_rows = torch.cat([torch.cat([starts, before]), torch.cat([goals, after])], -1)
        pi_actions = noisy(torch.cat([best, actions]), config.action_noise)
        losses = (
            -self.f.log_prob(noisy(states, config.state_noise), self.f.given()).mean(),
            -self.d.log_prob(change, self.d.given(torch.cat([before, actions], -1))).mean(),
            -2 * self.pi.log_prob(pi_actions, self.pi.given(pi_rows)).mean(),
            -(
                weights * self.c.log_prob(noisy(starts, config.state_noise), self.c.given(goals))
            ).sum(),
            errors.mean() + (self.value(torch.cat([goals, goals], -1)) ** 2).mean(),
        )
        total = torch.stack(losses).sum()
        for optimiser in self.optimisers:
            optimiser.zero_grad(set_to_none=True)
        total.backward()
        for model, optimiser in zip(self.models, self.optimisers, strict=True):
            nn.utils.clip_grad_norm_(model.parameters(), config.gradient_clip)
            optimiser.step()
        with torch.no_grad():
            self.log_weights["goal"][slots["goal"]] = -log_p[2]
            self.log_weights["transition"][t] = -log_p[3] - log_p[4]
        return float(total.detach())
