"""A page on this machine where one watches an agent and sends it about: `everystate studio`."""

import contextlib
import io
import socket
import threading
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import viser
from jaxtyping import Float
from viser import uplot

from everystate.agent import load
from everystate.envs import MujocoVectorEnv
from everystate.errors import EverystateError
from everystate.skills import SKILLS
from everystate.viewing import plots
from everystate.viewing.gate import Gate
from everystate.viewing.stage import Stage
from everystate.viewing.world import MASSES, World

HOST = "127.0.0.1"
"""This machine alone."""
_PLOT_PERIOD = 0.25  # seconds between updates of the plots
_FOLLOW_PERIOD = 5.0  # seconds between looks for a newer checkpoint of the run
_PLOTS = {
    "V": "value",
    "steps to go": "steps_to_goal",
    "distance, σ": "distance",
    "log density": "log_density",
}


class Studio:
    """A live body and the page that shows it; what is pressed there is done between two steps."""

    def __init__(
        self,
        run: Path | str,
        *,
        host: str = HOST,
        port: int = 8080,
        plan: bool | None = None,
        seed: int = 0,
    ) -> None:
        """Loads the agent, serves the page and begins to live.

        Args:
            run: run folder, also one that is still training, exported agent, or a shipped one.
            host: address to serve the page on; one that other machines can reach asks for a token.
            port: of the page; 0 takes any that is free.
            plan: whether it begins by planning ahead or by the policy; None: as the agent says.
            seed: of where the body starts, its noise, and what surprises it.

        Raises:
            EverystateError: no agent there, a body that cannot be drawn, or an address that
                cannot be had.
        """
        self.run = Path(run)
        self.world = World(load(run), seed, plan=plan)
        env = self.world.env
        if not isinstance(env, MujocoVectorEnv):
            raise EverystateError(f"{env.name} has no model that a browser can draw")
        self.gate = Gate(host)
        port = _free(host, port)
        # Quietly: its banner names it and not us.
        with contextlib.redirect_stdout(io.StringIO()), self.gate.around():
            self._server = viser.ViserServer(host, port, label="Everystate", verbose=False)
        self.address = self.gate.address(self._server.get_port())
        self._stage = Stage(self._server, env.body)
        self._commands: dict[str, Callable[[], None]] = {}  # The last of each control.
        self._control_step = env.control_step or 0.04
        self._stopped = threading.Event()
        self._slid_to: Float[np.ndarray, " state"] = np.empty(0, dtype=np.float32)
        self._newest: Path | None = None  # of the checkpoints that were looked at
        self._page(env)
        self._live = threading.Thread(target=self._run, name="studio", daemon=True)
        self._live.start()

    def close(self) -> None:
        """Ends the body's life and the page."""
        self._stopped.set()
        self._live.join()  # a first step compiles, and the page must be there when it is done
        with contextlib.redirect_stdout(io.StringIO()):
            self._server.stop()

    def wait(self) -> None:
        """Until it is closed, Ctrl-C, or an error that ends the body's life and is printed."""
        while self._live.is_alive():
            self._live.join(timeout=0.5)

    # --- The page ---

    def _page(self, env: MujocoVectorEnv) -> None:
        gui, world = self._server.gui, self.world
        gui.configure_theme(control_width="large", show_logo=False, show_share_button=False)
        self._said = gui.add_markdown(self._about())
        with gui.add_folder("Send it"):
            skills = SKILLS.get(world.agent.config.body, {})
            if skills:
                performed = {name: partial(world.perform, name) for name in skills}
                texts = (f"{name}: {skill.text}" for name, skill in skills.items())
                self._buttons("skill", performed, "\n".join(texts))
            sent = {
                "surprise me": world.surprise,
                "anywhere": world.anywhere,
                "stay here": lambda: world.send(world.state),
            }
            self._buttons(
                "goal", sent, "a goal it proposes, one of the evaluation's, its own state"
            )
        with gui.add_folder("Goal"):
            low, high = _ranges(world)
            self._sliders = [
                gui.add_slider(
                    f"{name} ({unit})", float(a), float(b), float((b - a) / 400), float(x)
                )
                for name, unit, a, b, x in zip(
                    env.state_names,
                    env.state_units,
                    low,
                    high,
                    world.goal.clip(low, high),
                    strict=True,
                )
            ]
            for slider in self._sliders:
                slider.on_update(self._slid)
        with gui.add_folder("What it thinks"):
            self._plots = {
                name: gui.add_uplot(
                    (np.arange(2.0), np.zeros(2)),
                    ({"label": "step"}, {"label": title, "stroke": plots.BLUE, "width": 2}),
                    title=title, height=110, scales={"x": uplot.Scale(time=False)},
                    legend={"show": False},
                )
                for title, name in _PLOTS.items()
            }  # fmt: skip
            self._map = None
            if len(env.state_names) == 2:
                self._map = gui.add_image(
                    self._map_of(world.goal), label="V, and goals it proposes"
                )
        with gui.add_folder("How"):
            self._paused = gui.add_checkbox("pause", False)
            self._speed = gui.add_slider("speed", 0.1, 2.0, 0.1, 1.0)
            plan = gui.add_checkbox("plan ahead", world.plan)
            plan.on_update(lambda _: self._do("plan", partial(setattr, world, "plan", plan.value)))
            fear = gui.add_checkbox("expect the worst", world.pessimistic)
            fear.on_update(
                lambda _: self._do("fear", partial(setattr, world, "pessimistic", fear.value))
            )
            mass = gui.add_slider("mass", *MASSES, 0.05, 1.0)
            mass.on_update(lambda _: self._do("mass", partial(world.weigh, mass.value)))
            self._buttons("disturb", {"push": world.push}, "jolts the body")

    def _buttons(self, label: str, actions: dict[str, Callable[[], None]], hint: str) -> None:
        group = self._server.gui.add_button_group(label, tuple(actions), hint=hint)
        group.on_click(lambda _: self._do(label, actions[group.value]))

    def _do(self, control: str, action: Callable[[], None]) -> None:
        """Leaves it to the thread in which the body lives: the last that was wanted in a step."""
        self._commands[control] = action

    def _slid(self, event: Any) -> None:
        if event.client is not None:  # not by us
            self._slid_to = np.array([slider.value for slider in self._sliders], dtype=np.float32)
            self._do("goal", partial(self.world.send, self._slid_to))

    def _about(self, problem: str = "") -> str:
        config = self.world.agent.config
        text = f"**{config.body}**, {self.run}. Its goal is the green ghost."
        return f"{text}\n\n**{problem}**" if problem else text

    def _map_of(self, goal: Float[np.ndarray, " state"]) -> np.ndarray:
        bounds = self.world.env.single_observation_space
        return plots.value_image(self.world.agent, bounds.low, bounds.high, goal)  # pyright: ignore

    # --- The life ---

    def _run(self) -> None:
        due = shown = checked = 0.0
        goal = None
        while not self._stopped.is_set():
            began = time.perf_counter()
            try:
                while self._commands:
                    self._commands.popitem()[1]()
                if not self._paused.value:
                    self.world.step()
                if goal is None or not np.array_equal(goal, self.world.goal):
                    goal = self.world.goal.copy()
                    self._show_goal(goal)
                self._stage.show(self.world.state, self.world.trail)
                if began - shown > _PLOT_PERIOD:
                    shown = began
                    self._show_thoughts()
                if began - checked > _FOLLOW_PERIOD:
                    checked = began
                    self._follow()
            except EverystateError as error:
                self._said.content = self._about(str(error))
            # A late step is made up for by the next ones; a very late one is not.
            due = max(due, began - _PLOT_PERIOD) + self._control_step / self._speed.value
            self._stopped.wait(max(0.0, due - time.perf_counter()))

    def _show_goal(self, goal: Float[np.ndarray, " state"]) -> None:
        self._stage.show_goal(goal)
        # Sliders that brought it there may have been moved on since.
        if not np.array_equal(goal, self._slid_to):
            for slider, value in zip(self._sliders, goal, strict=True):
                slider.value = float(np.clip(value, slider.min, slider.max))
        if self._map is not None:
            self._map.image = self._map_of(goal)

    def _show_thoughts(self) -> None:
        thoughts = self.world.thoughts()
        ago = np.arange(1.0 - len(thoughts.value), 1.0)
        for name, plot in self._plots.items():
            plot.data = (ago, getattr(thoughts, name).astype(float))

    def _follow(self) -> None:
        """A run that is still training: takes its newest checkpoint."""
        found = sorted(self.run.glob("checkpoints/[0-9]*"))
        if found and found[-1] != self._newest:
            self._newest = found[-1]
            self.world.follow(load(self.run))


def _ranges(world: World) -> tuple[Float[np.ndarray, " state"], Float[np.ndarray, " state"]]:
    """Bounds of the sliders: the body's, or three spreads where it has none."""
    space: Any = world.env.single_observation_space
    centre, spread = (np.asarray(x, dtype=float) for x in world.agent.scale)
    low = np.where(np.isfinite(space.low), space.low, np.floor(centre - 3 * spread))
    high = np.where(np.isfinite(space.high), space.high, np.ceil(centre + 3 * spread))
    return low, high


def _free(host: str, port: int) -> int:
    """The port, if nobody has it; viser would quietly take another."""
    if not 0 <= port < 2**16:
        raise EverystateError(f"port {port} is none: choose one from 1 to 65535, or 0 for any")
    try:
        family, *_, place = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        with socket.socket(family) as probe:
            probe.bind(place)
            return probe.getsockname()[1]
    except (OSError, UnicodeError) as error:
        raise EverystateError(
            f"port {port} of {host} cannot be had ({error}): choose another"
        ) from error


def studio(
    run: Path | str,
    *,
    host: str = HOST,
    port: int = 8080,
    plan: bool | None = None,
    seed: int = 0,
) -> None:
    """Serves the page until Ctrl-C; see `Studio`."""
    page = Studio(run, host=host, port=port, plan=plan, seed=seed)
    print(f"{page.address} (Ctrl-C ends it)", flush=True)
    try:
        page.wait()
    finally:
        page.close()
