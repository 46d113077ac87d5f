"""The controls and readings beside the studio's scene."""

import html
import math
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, Literal

import numpy as np
import viser
from jaxtyping import Float
from mujoco import mjtJoint

from everystate import goals
from everystate.envs import MujocoVectorEnv
from everystate.skills import SKILLS
from everystate.viewing import plots
from everystate.viewing.readings import Readings
from everystate.viewing.snippet import as_python
from everystate.viewing.world import MASSES, REMEMBERED, World

Do = Callable[[str, Callable[[], None]], None]
"""Has something done between two steps, in the place of what else that control asked for."""
_WIDTH = 380
"""Pixels: a page of 1000 leaves more to the body."""
_FEW = 8
"""So many positions are shown unfolded, whatever they are."""
_FREE = (mjtJoint.mjJNT_FREE, mjtJoint.mjJNT_BALL)


class Panel:
    """What is pressed goes to `do`, and is done by the thread in which the body lives."""

    def __init__(
        self,
        gui: viser.GuiApi,
        world: World,
        do: Do,
        film: Callable[[viser.ClientHandle], None],
        name: str,
    ) -> None:
        """Puts everything on the page; `film` sends a browser a film of the last steps."""
        self._gui, self._world, self._do, self._name = gui, world, do, name
        self._seconds = world.env.control_step or 0.04
        self._slid_to: Float[np.ndarray, " state"] = np.empty(0, dtype=np.float32)
        self._shown = self._slid_to
        gui.configure_theme(show_logo=False, show_share_button=False)
        gui.main_panel.dock_right()
        gui.main_panel.set_width(_WIDTH)
        self._said = gui.add_html("")
        self.tell()
        with gui.add_folder("Send it"):
            self._add_sending(film)
        with gui.add_folder(f"What it thinks, over {REMEMBERED * self._seconds:.0f} s"):
            self.readings = Readings(gui, world)
        self._sliders: dict[int, viser.GuiSliderHandle[float]] = {}
        assert isinstance(world.env, MujocoVectorEnv)
        for title, (components, unfolded) in grouped(world.env).items():
            with gui.add_folder(f"Goal: {title}", expand_by_default=unfolded):
                self._add_sliders(components)
        with gui.add_folder("Body and time"):
            self._add_how()

    def _add_sending(self, film: Callable[[viser.ClientHandle], None]) -> None:
        world = self._world
        skills = SKILLS.get(world.agent.config.body, {})
        if skills:
            performed = {name: partial(world.perform, name) for name in skills}
            self._buttons("skill", performed, "what it asks for is told above")
        sent = {
            "surprise me": world.surprise,
            "anywhere": world.anywhere,
            "stay here": lambda: world.send(world.state, "stay here"),
        }
        self._buttons("goal", sent, "a goal it proposes, one of the evaluation's, its own state")
        self._add_asking()
        touched = {"push": world.push, "start over": world.restart}
        self._buttons("body", touched, "keys P and R; or drag the body with the mouse, and let go")
        kept = {"GIF": film, "Python": self._show_python}
        took = f"a film of the last {REMEMBERED * self._seconds:.0f} s; a program for this goal"
        group = self._gui.add_button_group("take away", tuple(kept), hint=took)
        group.on_click(lambda event: event.client and kept[group.value](event.client))
        self._key("push", "P", partial(self._do, "body", world.push))
        self._key("start over", "R", partial(self._do, "body", world.restart))

    def _add_asking(self) -> None:
        """Where one says what matters, and nothing of the rest."""
        agent = self._world.agent
        every = ", ".join([*agent.feature_names, *agent.state_names])
        hint = f"what matters, and no more, as {every.split(',')[0]}=0.5; names: {every}"
        words = self._gui.add_text("ask for", "", hint=hint)
        send = self._gui.add_button("go there, whatever the rest")
        send.on_click(lambda _: self._do("goal", partial(self.ask, words.value)))

    def ask(self, words: str) -> None:
        """Sends the body to what is written, as in `everystate render --goal`.

        Raises:
            EverystateError: no goal, or none of this body.
        """
        self._world.send(goals.read(words.split()), words)

    def _add_sliders(self, components: list[int]) -> None:
        env, goal = self._world.env, self._world.goal.tolist()
        low, high = (ends.tolist() for ends in _ranges(self._world))
        for i in components:
            unit = env.state_units[i]
            step = 10.0 ** math.floor(math.log10((high[i] - low[i]) / 200))
            value = _on_grid(goal[i], low[i], high[i], step)
            label = env.state_names[i] + (f" ({unit})" if unit != "1" else "")
            slider = self._gui.add_slider(label, low[i], high[i], step, value)
            slider.on_update(self._slid)
            self._sliders[i] = slider

    def _add_how(self) -> None:
        gui, world, do = self._gui, self._world, self._do
        self._paused = gui.add_checkbox("pause", False, hint="key: space")
        self._key("pause", "space", lambda: setattr(self._paused, "value", not self.paused))
        self._speed = gui.add_slider("speed", 0.1, 2.0, 0.1, 1.0)
        plan = gui.add_checkbox("plan ahead", world.plan, hint="blue lines: where it means to go")
        plan.on_update(lambda _: do("plan", partial(setattr, world, "plan", plan.value)))
        fear = gui.add_checkbox("expect the worst", world.pessimistic)
        fear.on_update(lambda _: do("fear", partial(setattr, world, "pessimistic", fear.value)))
        mass = gui.add_slider("mass", *MASSES, 0.05, 1.0)
        mass.on_update(lambda _: do("mass", partial(world.weigh, mass.value)))

    def _buttons(self, label: str, actions: Mapping[str, Callable[[], None]], hint: str) -> None:
        group = self._gui.add_button_group(label, tuple(actions), hint=hint)
        group.on_click(lambda _: self._do(label, actions[group.value]))

    def _key(self, label: str, key: Literal["P", "R", "space"], action: Callable) -> None:
        self._gui.add_command(label, hotkey=key).on_trigger(lambda _: action())

    def _slid(self, event: Any) -> None:
        if event.client is not None:  # not by us
            goal = self._world.goal.copy()
            for i, slider in self._sliders.items():
                goal[i] = slider.value
            self._slid_to = goal
            self._do("goal", partial(self._world.send, goal))

    def _show_python(self, client: viser.ClientHandle) -> None:
        code = html.escape(as_python(self._world, self._name))
        with client.gui.add_modal("As Python") as window:
            client.gui.add_html(_CODE.format(code=code))
            client.gui.add_button("Close").on_click(lambda _: window.close())

    # --- What the living body changes ---

    @property
    def paused(self) -> bool:
        """Whether its time stands still."""
        return self._paused.value

    @property
    def speed(self) -> float:
        """Of its time."""
        return self._speed.value

    def tell(self, problem: str = "") -> None:
        """What it was asked for, whether that is done, and what went wrong."""
        pursuit = self._world.pursuit
        color = plots.GREEN if pursuit.reached is not None else plots.GREY
        text = pursuit.skill.text if pursuit.skill else "its goal is the green ghost"
        text += f"; {pursuit.search}" if pursuit.search else ""
        self._said.content = _STATUS.format(
            name=html.escape(pursuit.name),
            color=plots.RED if pursuit.over and pursuit.reached is None else color,
            told=pursuit.told(self._seconds),
            text=html.escape(problem or text),
            weight="bold" if problem else "normal",
        )

    def show(self) -> None:
        """Its goal on the sliders, and its thoughts."""
        world = self._world
        world.pursuit.judge(world.env)
        self.tell()
        self.readings.show()
        goal = world.goal
        # Sliders that brought it there may have been moved on since.
        if not np.array_equal(goal, self._shown) and not np.array_equal(goal, self._slid_to):
            for i, slider in self._sliders.items():
                slider.value = _on_grid(float(goal[i]), slider.min, slider.max, slider.step)
        self._shown = goal.copy()


def grouped(env: MujocoVectorEnv) -> dict[str, tuple[list[int], bool]]:
    """Components of the state under pose, joints and velocities; and which begin unfolded.

    Pose is that of what is free to move anywhere, as a torso.
    """
    model = env.model
    free = [model.joint(i).name for i in range(model.njnt) if mjtJoint(model.jnt_type[i]) in _FREE]
    groups: dict[str, list[int]] = {"pose": [], "joints": [], "velocities": []}
    for i, (name, unit) in enumerate(zip(env.state_names, env.state_units, strict=True)):
        posed = any(name.startswith(f"{joint}_") for joint in free if joint)
        kind = "velocities" if unit.endswith("/s") else "pose" if posed else "joints"
        groups[kind].append(i)
    few = len(groups["pose"]) + len(groups["joints"]) <= _FEW
    if not groups["pose"]:
        groups = {"position": groups["joints"], "velocities": groups["velocities"]}
    return {
        title: (components, title in ("pose", "position") or (few and title == "joints"))
        for title, components in groups.items()
        if components
    }


def _ranges(world: World) -> tuple[Float[np.ndarray, " state"], Float[np.ndarray, " state"]]:
    """Bounds of the sliders: the body's, or three spreads where it has none."""
    space: Any = world.env.single_observation_space
    centre, spread = (np.asarray(x, dtype=float) for x in world.agent.scale)
    low = np.where(np.isfinite(space.low), space.low, np.floor(centre - 3 * spread))
    high = np.where(np.isfinite(space.high), space.high, np.ceil(centre + 3 * spread))
    return low.astype(float), high.astype(float)


def _on_grid(value: float, low: float, high: float, step: float) -> float:
    return min(max(low + round((value - low) / step) * step, low), high)


_STATUS = """<div style="padding: 0.3em 0.7em 0.9em; font-size: 0.9em; line-height: 1.4">
<b style="font-size: 1.15em">{name}</b>
<b style="font-size: 1.15em; color: {color}">&ensp;{told}</b>
<div style="font-weight: {weight}; color: #555">{text}</div></div>"""
_CODE = """<pre style="font-size: 0.8em; overflow: auto; background: #f4f4f6; padding: 0.8em"
>{code}</pre><button style="margin: 0 0 0.8em" onclick="
const text = this.previousElementSibling, range = document.createRange();
range.selectNodeContents(text); getSelection().removeAllRanges(); getSelection().addRange(range);
this.textContent = document.execCommand('copy') ? 'Copied' : 'Press Ctrl-C'">Copy</button>"""
