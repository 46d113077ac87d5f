"""A slider for each number of a goal, and a tick that says whether it matters."""

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np
import viser
from jaxtyping import Float

from everystate.envs import MujocoVectorEnv
from everystate.goals import Goal
from everystate.viewing import sliders
from everystate.viewing.sliders import Slider
from everystate.viewing.world import Do, World

_BESIDE = """<style>
div:has(> div > div > div > p > label:empty) {
    display: grid; grid-template-columns: auto 1fr; align-items: center; }
div:has(> div > div > div > p > label:empty) > :nth-child(odd) { padding-right: 0 !important; }
div:has(> p > label:empty) { display: none; }
</style>"""
"""Puts each slider, which has no label, on the line of its tick, which has the name."""


class GoalPanel:
    """Shows the goal and sends the body to what is ticked of it; what is not is free."""

    def __init__(self, gui: viser.GuiApi, world: World, do: Do) -> None:
        """Puts them on the page, where it now is."""
        self._gui, self._world, self._do = gui, world, do
        self._names = world.env.state_names
        self._shown: Goal | None = None
        self._known: dict[str, Slider] = {}
        self.sliders: dict[str, viser.GuiSliderHandle[float]] = {}
        """By name, as those of a goal."""
        self.ticks: dict[str, viser.GuiCheckboxHandle] = {}
        """Likewise."""
        assert isinstance(world.env, MujocoVectorEnv)
        gui.add_html(_BESIDE)
        ticked = gui.add_button_group(
            "what matters", ("all", "none"), hint="what is not ticked is the agent's choice"
        )
        ticked.on_click(lambda _: self.tick_all() if ticked.value == "all" else self.tick_none())
        for title, (own, unfolded) in sliders.grouped(world.env, *_ranges(world)).items():
            with gui.add_folder(f"Goal: {title}", expand_by_default=unfolded):
                for slider in own:
                    self._add(slider)
        self.show()

    def _add(self, slider: Slider) -> None:
        name, low, high = slider.name, slider.low, slider.high
        self._known[name] = slider
        self.ticks[name] = self._gui.add_checkbox(slider.label, False, hint="whether it matters")
        self.ticks[name].on_update(partial(self._ticked, name))
        step = 10.0 ** np.floor(np.log10((high - low) / 200))
        self.sliders[name] = self._gui.add_slider("", low, high, float(step), low)
        self.sliders[name].on_update(partial(self._slid, name))

    # --- What the page changes; None instead of a client: not the page, but we ---

    def _slid(self, name: str, event: Any) -> None:
        if event.client is not None:
            self._tick(name)  # whoever sets it wants it so
            self._do("goal", self._send)

    def _ticked(self, name: str, event: Any) -> None:
        if event.client is not None:
            if self.ticks[name].value:
                self._tick(name)
            self._do("goal", self._send)

    def _tick(self, name: str) -> None:
        self.ticks[name].value = True
        for other, tick in self.ticks.items():
            if self._known[name].excludes(self._known[other]):
                tick.value = False

    def tick_all(self) -> None:
        """The whole state matters."""
        for name, tick in self.ticks.items():
            tick.value = not self._known[name].besides
        self._do("goal", self._send)

    def tick_none(self) -> None:
        """To begin anew; until something is ticked, the body goes on to where it was sent."""
        for tick in self.ticks.values():
            tick.value = False

    @property
    def ticked(self) -> set[str]:
        """The names of what matters."""
        return {name for name, tick in self.ticks.items() if tick.value}

    # --- In the thread in which the body lives ---

    def _send(self) -> None:
        if ticked := self.ticked:
            given = {name: slider.value for name, slider in self.sliders.items()}
            self._world.send(sliders.goal(self._known.values(), ticked, given, self._names))
            self._shown = self._world.asked

    def show(self) -> None:
        """What the body was sent to, if that was not from here; sliders may be on their way."""
        asked = self._world.asked
        if _same(asked, self._shown):
            return
        self._shown = asked
        matters = sliders.matter(self._known.values(), asked, self._names)
        values = sliders.values(self._world.goal, self._names)
        for name, slider in self.sliders.items():
            self.ticks[name].value = name in matters
            slider.value = _on_grid(values[name], slider.min, slider.max, slider.step)


def _same(one: Goal, other: Goal | None) -> bool:
    if isinstance(one, Mapping) or isinstance(other, Mapping) or other is None:
        return one is other
    return np.array_equal(np.asarray(one), np.asarray(other))


def _ranges(world: World) -> tuple[Float[np.ndarray, " state"], Float[np.ndarray, " state"]]:
    """Bounds of the components: the body's, or three spreads where it has none."""
    space: Any = world.env.single_observation_space
    centre, spread = (np.asarray(x, dtype=float) for x in world.agent.scale)
    low = np.where(np.isfinite(space.low), space.low, np.floor(centre - 3 * spread))
    high = np.where(np.isfinite(space.high), space.high, np.ceil(centre + 3 * spread))
    return low.astype(float), high.astype(float)


def _on_grid(value: float, low: float, high: float, step: float) -> float:
    return min(max(low + round((value - low) / step) * step, low), high)
