"""Any Gymnasium environment with numbers in and numbers out, made into a body.

Bodies are named `module:id`, as Gymnasium itself has it: the module is imported, for it registers
the id; or `module:name` for a function or class in it that makes one. What cannot be learned is
refused with the reason, before anything is written.
"""

import importlib
import sys
from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Dict, Space
from gymnasium.wrappers import TimeLimit
from jaxtyping import Bool, Float

from everystate.envs.rendering import headless
from everystate.errors import EverystateError

EXTRA = "pip install 'everystate[bodies]'"
_OPTIONAL = {"gymnasium_robotics", "shimmy", "dm_control", "pygame"}  # what the extra has
_GOAL_KEYS = {"observation", "achieved_goal", "desired_goal"}
_HUGE = 1e6  # bounds beyond this are no bounds


def import_module(name: str, body: str) -> Any:
    """The module before the colon.

    Raises:
        EverystateError: it cannot be imported; says which extra it needs.
    """
    try:
        with headless():
            return importlib.import_module(name)
    except ModuleNotFoundError as error:
        missing = (error.name or name).partition(".")[0]
        if missing in _OPTIONAL:
            raise EverystateError(f"{body} needs {missing}: {EXTRA}") from error
        raise EverystateError(
            f"{body}: there is no module {error.name!r}: install it, or put its folder on"
            " PYTHONPATH"
        ) from error


def name_of(factory: Callable[..., Any]) -> str:
    """`module:name`, by which `make_single` finds a function or class that makes environments.

    Raises:
        EverystateError: another process would not find it there.
    """
    module, name = (getattr(factory, part, "") for part in ("__module__", "__qualname__"))
    if module == "__main__" or getattr(sys.modules.get(module), name, None) is not factory:
        raise EverystateError(
            f"{name or factory!r} cannot be found again when the run goes on or its agent is used:"
            " define it at the top level of a module of its own, say my_envs.py, import it from"
            " there, and give its arguments as body_options"
        )
    return f"{module}:{name}"


def make_single(body: str, render_mode: str | None = None, **kwargs: Any) -> gymnasium.Env:
    """The environment `module:id` or `module:name`, without its time limit.

    Raises:
        EverystateError: no such id, a missing package, arguments that it does not take, or what is
            made is no Gymnasium environment.
    """
    module, _, name = body.partition(":")
    factory = getattr(import_module(module, body), name, None)
    if render_mode is not None:  # there are constructors that do not take it
        kwargs["render_mode"] = render_mode
    try:
        with headless():
            if callable(factory):
                env = _unlimited(factory(**kwargs))
            else:
                kwargs |= {"max_episode_steps": -1, "disable_env_checker": True}
                env = gymnasium.make(name, **kwargs)
    except gymnasium.error.DependencyNotInstalled as error:
        raise EverystateError(f"{body} needs another package: {error}; see also {EXTRA}") from error
    except gymnasium.error.Error as error:
        raise EverystateError(f"{body}: {error}") from error
    except TypeError as error:
        raise EverystateError(f"{body} does not take these options: {error}") from error
    except (AssertionError, ImportError) as error:
        raise EverystateError(
            f"{body} does not work with the packages installed here: {error}"
        ) from error
    if not isinstance(env, gymnasium.Env):
        raise EverystateError(f"{body} makes a {_kind(env)}: expected one gymnasium.Env")
    # dm_control counts steps itself.
    control: Any = getattr(env.unwrapped, "_env", None)
    if hasattr(control, "_step_limit"):
        control._step_limit = float("inf")
    return env


def _unlimited(env: Any) -> Any:
    """The environment without Gymnasium's time limits, however deep in its wrappers they are."""
    if isinstance(env, gymnasium.Wrapper):
        inner = _unlimited(env.env)
        if isinstance(env, TimeLimit):
            return inner
        env.env = inner
    return env


class ActionScaling:
    """From actions in [-1, 1] to those of an environment."""

    def __init__(self, space: Space, body: str) -> None:
        if not isinstance(space, Box):
            raise EverystateError(
                f"{body} has {_kind(space)} actions: only Box actions can be learned, so wrap it"
                " in one that takes numbers"
            )
        low, high = space.low.astype(np.float64).ravel(), space.high.astype(np.float64).ravel()
        if not (np.isfinite(low) & np.isfinite(high)).all() or np.abs([low, high]).max() > _HUGE:
            bad = int(np.argmax(~(np.isfinite(low) & np.isfinite(high))))
            raise EverystateError(
                f"action component {bad} of {body} ranges over [{low[bad]:g}, {high[bad]:g}]:"
                " wrap it in gymnasium.wrappers.RescaleAction with bounds of your choice"
            )
        if (low >= high).any():
            bad = int(np.argmax(low >= high))
            raise EverystateError(
                f"action component {bad} of {body} can only be {low[bad]:g}: leave it out"
            )
        self.size, self.low, self.high = low.size, low, high
        self._shape, self._dtype = space.shape, space.dtype
        self._middle, self._half = (low + high) / 2, (high - low) / 2

    def __call__(self, action: Float[np.ndarray, " action"]) -> np.ndarray:
        """One action as the environment takes it."""
        scaled = self._middle + self._half * action
        return scaled.reshape(self._shape).astype(self._dtype)


class Flattening:
    """From an environment's observations to vectors, with the names of their components.

    Goal environments give their `observation`; other Dict observations all their parts, in the
    order of the Dict space (Gymnasium's is alphabetical), each part row by row. An angle that winds
    up is given as its cosine and sine, so that a body turned round once is where it was.
    """

    def __init__(self, space: Space, body: str) -> None:
        if isinstance(space, Dict):
            keys = tuple(space.spaces)
            self._keys = ("observation",) if set(keys) == _GOAL_KEYS else keys
            parts = {key: space.spaces[key] for key in self._keys}
        else:
            self._keys, parts = None, {"observation": space}
        boxes = {key: _numbers(part, key, body) for key, part in parts.items()}
        self._sizes = {key: int(np.prod(box.shape)) for key, box in boxes.items()}
        self.body, self.size = body, sum(self._sizes.values())
        if self.size == 0:
            raise EverystateError(f"{body} observes nothing: its observation has no component")
        self.low = np.concatenate([np.ravel(part.low) for part in boxes.values()])
        self.high = np.concatenate([np.ravel(part.high) for part in boxes.values()])
        unbounded = ~((np.abs(self.low) < _HUGE) & (np.abs(self.high) < _HUGE))
        self.low = np.where(unbounded, -np.inf, self.low.astype(np.float64))
        self.high = np.where(unbounded, np.inf, self.high.astype(np.float64))
        self.names = tuple(f"{key}_{i}" for key, size in self._sizes.items() for i in range(size))
        self._winds = np.zeros(self.size, dtype=bool)

    def unwind(self, winds: Bool[np.ndarray, " numbers"]) -> None:
        """From now on these numbers are angles that wind up."""
        self._winds, twice = winds, np.where(winds, 2, 1)
        self.low = np.repeat(np.where(winds, -1.0, self.low), twice)
        self.high = np.repeat(np.where(winds, 1.0, self.high), twice)
        named = zip(self.names, winds, strict=True)
        pairs = ((f"cos_{n}", f"sin_{n}") if turns else (n,) for n, turns in named)
        self.names = tuple(name for pair in pairs for name in pair)
        self.size = len(self.names)

    def __call__(self, observation: Any) -> Float[np.ndarray, " state"]:
        """One observation as a vector."""
        flat = self.numbers(observation)
        if not self._winds.any():
            return flat
        pairs = np.stack([np.where(self._winds, np.cos(flat), flat), np.sin(flat)], axis=1)
        return pairs[np.stack([np.ones_like(self._winds), self._winds], axis=1)]

    def numbers(self, observation: Any) -> Float[np.ndarray, " numbers"]:
        """All numbers of an observation, angles as they are."""
        parts = [observation] if self._keys is None else [observation[key] for key in self._keys]
        flat = np.concatenate([np.ravel(part) for part in parts]).astype(np.float64)
        if flat.size != (size := self._winds.size):
            raise EverystateError(
                f"an observation of {self.body} has {flat.size} numbers, where its space says"
                f" {size}: the shape must not change"
            )
        return flat


def _numbers(space: Space, key: str, body: str) -> Box:
    if not isinstance(space, Box):
        raise EverystateError(
            f"{body} has {_kind(space)} in its observation {key!r}: only Box observations of"
            " numbers can be learned"
        )
    if len(space.shape) >= 2 and space.dtype == np.uint8:
        raise EverystateError(
            f"{body} observes images {space.shape}: only states of numbers can be learned"
        )
    return space


def _kind(thing: object) -> str:
    return type(thing).__name__
