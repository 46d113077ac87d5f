"""Features of a body that moves freely, whether its state says which way it faces or not."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from everystate.features.feature import DEGREES, Feature, States, Values, replaced


@dataclass(frozen=True)
class Free:
    """A body that moves freely: how high, which way it faces and leans, how it goes and turns.

    The state has its height, the first two columns of its rotation matrix, its velocity in the
    world's frame and its angular velocity in its own (MuJoCo's free joint). It faces along its x
    axis, with its y axis to the left and its z axis up.
    """

    name: str
    prefix: str
    """Of the names of its features; nothing if there is only one such body."""
    z: int
    axes: int
    v: int
    w: int
    """Where in the state its height, axes, velocity and angular velocity begin."""

    @property
    def features(self) -> tuple[Feature, ...]:
        """In metres, degrees, and m/s and rad/s."""
        axes = tuple(f"{self.name}_{column}{axis}" for column in "xy" for axis in "xyz")
        flat = axes[:2] + axes[3:5]
        going = f"{self.name}_vx", f"{self.name}_vy"
        turns = tuple(f"{self.name}_w{axis}" for axis in "xyz")
        every = (
            Feature("height", "m", (f"{self.name}_z",), self.z),
            Feature("heading", "deg", flat, bound=180.0),
            Feature("pitch", "deg", axes, bound=90.0),
            Feature("roll", "deg", axes, bound=180.0),
            Feature("forward_velocity", "m/s", going, self.v),
            Feature("sideways_velocity", "m/s", going, self.v + 1),
            Feature("turning_rate", "rad/s", turns, self.w + 2),
        )
        return tuple(f._replace(name=self.prefix + f.name) for f in every)

    def read(self, states: States) -> dict[str, Values]:
        """Heading is about the vertical, to the left; pitch lifts its front, roll its left side."""
        xp = states.__array_namespace__()
        (xx, xy, xz), y, z = self._axes(states)
        heading = xp.atan2(xy, xx)
        ahead, aside = xp.cos(heading), xp.sin(heading)
        vx, vy = (states[..., self.v + i] for i in range(2))
        values = (
            states[..., self.z],
            heading * DEGREES,
            xp.asin(xp.clip(xz, -1, 1)) * DEGREES,
            xp.atan2(y[2], z[2]) * DEGREES,
            vx * ahead + vy * aside,
            vy * ahead - vx * aside,
            _dot(_three(states, self.w), (xz, y[2], z[2])),
        )
        return dict(zip((f.name for f in self.features), values, strict=True))

    def set(self, states: States, asked: Mapping[str, Values]) -> States:
        """As in `Part`: a new heading turns the velocity with it."""
        xp = states.__array_namespace__()
        names = [feature.name for feature in self.features]
        known = {**self.read(states), **asked}
        height, heading, pitch, roll, forward, sideways, turning = (known[n] for n in names)
        new = {self.z: height}
        if asked.keys() & set(names[1:4]):
            axes = _axes(xp, *(angle / DEGREES for angle in (heading, pitch, roll)))
            new |= dict(zip(range(self.axes, self.axes + 6), axes, strict=True))
        if asked.keys() & {names[1], *names[4:6]}:
            ahead, aside = xp.cos(heading / DEGREES), xp.sin(heading / DEGREES)
            new[self.v] = forward * ahead - sideways * aside
            new[self.v + 1] = forward * aside + sideways * ahead
        states = replaced(states, new)
        if names[6] not in asked:
            return states
        x, y, z = self._axes(states)
        more = turning - self.read(states)[names[6]]
        turned = enumerate((x[2], y[2], z[2]), start=self.w)
        return replaced(states, {at: states[..., at] + more * up for at, up in turned})

    def _axes(self, states: States) -> tuple[tuple[Values, Values, Values], ...]:
        """The three axes in the world's frame: two of the state, and what stands on both."""
        x, y = _three(states, self.axes), _three(states, self.axes + 3)
        return x, y, _cross(x, y)


@dataclass(frozen=True)
class Leaning:
    """The same without the way it faces: of its orientation the state has where up is.

    Up and both velocities are in the body's own frame.
    """

    name: str
    prefix: str
    """See `Free`."""
    z: int
    up: int
    v: int
    w: int
    """Where in the state its height, up, velocity and angular velocity begin."""

    @property
    def features(self) -> tuple[Feature, ...]:
        """Those of `Free`, but for its heading."""
        lean = tuple(f"{self.name}_up{axis}" for axis in "xyz")
        goes, turns = (tuple(f"{self.name}_{v}{axis}" for axis in "xyz") for v in "vw")
        every = (
            Feature("height", "m", (f"{self.name}_z",), self.z),
            Feature("pitch", "deg", lean, bound=90.0),
            Feature("roll", "deg", lean, bound=180.0),
            Feature("forward_velocity", "m/s", goes, self.v),
            Feature("sideways_velocity", "m/s", goes, self.v + 1),
            Feature("turning_rate", "rad/s", turns, self.w + 2),
        )
        return tuple(f._replace(name=self.prefix + f.name) for f in every)

    def read(self, states: States) -> dict[str, Values]:
        """As of `Free`."""
        xp = states.__array_namespace__()
        up, v, w = (_three(states, at) for at in (self.up, self.v, self.w))
        ahead, aside = _level(xp, up)
        values = (
            states[..., self.z],
            xp.asin(xp.clip(up[0], -1, 1)) * DEGREES,
            xp.atan2(up[1], up[2]) * DEGREES,
            _dot(v, ahead),
            _dot(v, aside),
            _dot(w, up),
        )
        return dict(zip((f.name for f in self.features), values, strict=True))

    def set(self, states: States, asked: Mapping[str, Values]) -> States:
        """As in `Part`: it goes on as it did, seen from the floor, however it leans."""
        xp = states.__array_namespace__()
        names = [feature.name for feature in self.features]
        before = self.read(states)
        height, pitch, roll, forward, sideways, _ = ({**before, **asked}[n] for n in names)
        up = _three(states, self.up)
        rises = _dot(_three(states, self.v), up)
        if asked.keys() & set(names[1:3]):
            p, r = pitch / DEGREES, roll / DEGREES
            up = (xp.sin(p), xp.cos(p) * xp.sin(r), xp.cos(p) * xp.cos(r))
        ahead, aside = _level(xp, up)
        new = {self.z: height}
        for i in range(3):
            new[self.up + i] = up[i]
            new[self.v + i] = forward * ahead[i] + sideways * aside[i] + rises * up[i]
        states = replaced(states, new)
        if names[5] not in asked:
            return states
        more = asked[names[5]] - _dot(_three(states, self.w), up)
        turned = {self.w + i: states[..., self.w + i] + more * up[i] for i in range(3)}
        return replaced(states, turned)


def _three(states: States, at: int) -> tuple[Values, Values, Values]:
    return states[..., at], states[..., at + 1], states[..., at + 2]


def _dot(one: tuple[Values, ...], other: tuple[Values, ...]) -> Values:
    return one[0] * other[0] + one[1] * other[1] + one[2] * other[2]


def _cross(one: tuple[Values, ...], other: tuple[Values, ...]) -> tuple[Values, Values, Values]:
    (a, b, c), (x, y, z) = one, other
    return b * z - c * y, c * x - a * z, a * y - b * x


def _level(xp: Any, up: tuple[Values, ...]) -> tuple[tuple[Values, ...], tuple[Values, ...]]:
    """Ahead and to the left along the floor, in the body's frame, from where up is."""
    flat = xp.sqrt(xp.clip(1 - up[0] ** 2, 1e-6, 1))
    ahead = tuple((float(i == 0) - up[0] * up[i]) / flat for i in range(3))
    return ahead, _cross(up, ahead)


def _axes(xp: Any, heading: Values, pitch: Values, roll: Values) -> tuple[Values, ...]:
    """Columns x and y of the rotation by heading, after pitch, after roll."""
    ch, sh, cp, sp, cr, sr = (
        f(angle) for angle in (heading, pitch, roll) for f in (xp.cos, xp.sin)
    )
    return (
        *(ch * cp, sh * cp, sp),
        *(-sh * cr - ch * sp * sr, ch * cr - sh * sp * sr, cp * sr),
    )
