"""The controls and readings beside the studio's scene."""

import html
from collections.abc import Callable, Mapping
from functools import partial
from typing import Literal

import numpy as np
import viser

from everystate.goals import Goal
from everystate.skills import SKILLS
from everystate.viewing import plots
from everystate.viewing.driving import add_driving, can_drive
from everystate.viewing.goal_panel import GoalPanel
from everystate.viewing.readings import Readings
from everystate.viewing.snippet import as_python
from everystate.viewing.world import MASSES, REMEMBERED, Do, World

_WIDTH = 380
"""Pixels: a page of 1000 leaves more to the body."""
_NAMED = 3
"""So many of what matters are named."""


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
        gui.configure_theme(show_logo=False, show_share_button=False)
        gui.main_panel.dock_right()
        gui.main_panel.set_width(_WIDTH)
        self._said = gui.add_html("")
        self.tell()
        with gui.add_folder("Send it"):
            self._add_sending(film)
        with gui.add_folder(f"What it thinks, over {REMEMBERED * self._seconds:.0f} s"):
            self.readings = Readings(gui, world)
        self.goal = GoalPanel(gui, world, do)
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
        if can_drive(world.agent):
            add_driving(self._gui, world, self._do)
        touched = {"push": world.push, "start over": world.restart}
        self._buttons("body", touched, "keys P and R; or drag the body with the mouse, and let go")
        kept = {"GIF": film, "Python": self._show_python}
        took = f"a film of the last {REMEMBERED * self._seconds:.0f} s; a program for this goal"
        group = self._gui.add_button_group("take away", tuple(kept), hint=took)
        group.on_click(lambda event: event.client and kept[group.value](event.client))
        self._key("push", "P", partial(self._do, "body", world.push))
        self._key("start over", "R", partial(self._do, "body", world.restart))

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
        text = pursuit.skill.text if pursuit.skill else _asked(self._world.asked)
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
        self.goal.show()


def _asked(goal: Goal) -> str:
    """What a goal asks for, in words."""
    if not isinstance(goal, Mapping):
        return "its goal is the green ghost"
    few = ", ".join(f"{name} = {np.asarray(value).item():.3g}" for name, value in goal.items())
    told = few if len(goal) <= _NAMED else f"{len(goal)} of the sliders"
    return f"asked: {told}; the ghost has its choice of the rest"


_STATUS = """<div style="padding: 0.3em 0.7em 0.9em; font-size: 0.9em; line-height: 1.4">
<b style="font-size: 1.15em">{name}</b>
<b style="font-size: 1.15em; color: {color}">&ensp;{told}</b>
<div style="font-weight: {weight}; color: #555">{text}</div></div>"""
_CODE = """<pre style="font-size: 0.8em; overflow: auto; background: #f4f4f6; padding: 0.8em"
>{code}</pre><button style="margin: 0 0 0.8em" onclick="
const text = this.previousElementSibling, range = document.createRange();
range.selectNodeContents(text); getSelection().removeAllRanges(); getSelection().addRange(range);
this.textContent = document.execCommand('copy') ? 'Copied' : 'Press Ctrl-C'">Copy</button>"""
