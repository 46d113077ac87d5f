"""What the agent thinks, as curves over the last seconds with axes that stay as they are."""

from typing import Any

import numpy as np
import viser
from jaxtyping import UInt8
from viser import uplot

from everystate.viewing import images, plots
from everystate.viewing.pursuit import REACHED
from everystate.viewing.world import REMEMBERED, World

_TITLES = {
    "steps_to_goal": "steps to go, as it thinks",
    "distance": "distance to its goal, σ",
    "log_density": "how familiar its state is, nats",
}
_MOST = 4.0  # σ


class Readings:
    """A plot for each field of `Thoughts`; for a flat world also a map of V."""

    def __init__(self, gui: viser.GuiApi, world: World) -> None:
        """Puts them on the page, where it now is."""
        self._world = world
        self._seconds = REMEMBERED * (world.env.control_step or 0.04)
        self._plots = {name: self._added(gui, name) for name in _TITLES}
        self.rescale()
        self._map, self._mapped = None, world.goal
        if len(world.state) == 2:
            self._map = gui.add_image(self._map_of(), label="V, and goals it proposes")

    def _added(self, gui: viser.GuiApi, name: str) -> viser.GuiUplotHandle:
        below: uplot.Axis = {"size": 26}
        beside: uplot.Axis = {"size": 44, "space": 22}
        line: uplot.Series = {"label": name, "stroke": plots.BLUE, "width": 2}
        data = [np.linspace(-self._seconds, 0.0, REMEMBERED), np.zeros(REMEMBERED)]
        series: list[uplot.Series] = [{"label": "s"}, line]
        if name == "distance":
            data.append(np.full(REMEMBERED, REACHED))
            series.append({"label": "reached", "stroke": plots.GREEN, "dash": (4, 4)})
        return gui.add_uplot(
            tuple(data),
            tuple(series),
            title=_TITLES[name],
            height=125,
            axes=(below, beside),
            legend={"show": False},
            cursor={"show": False},
            padding=(10, 12, 0, 0),
        )

    def rescale(self) -> None:
        """Fixes the axes, by the goals that the agent proposes and by where it is."""
        agent, here = self._world.agent, self._world.state
        goals = agent.propose_goals(64)
        steps = 2 * float(np.median(agent.steps_to_goal(goals, np.roll(goals, 1, axis=0))))
        strange, known = float(np.median(agent.log_density(goals))), float(agent.log_density(here))
        room = max(known - strange, 1.0)
        self._ends = {
            "steps_to_goal": (0.0, _round(steps)),
            "distance": (0.0, _MOST),
            "log_density": (strange - room, known + room),
        }
        for name, plot in self._plots.items():
            plot.scales = {"x": {"time": False}, "y": {"range": self._ends[name]}}

    def show(self) -> None:
        """What it thinks now; what leaves a plot is drawn at its edge."""
        thoughts, goal = self._world.thoughts(), self._world.goal
        for name, plot in self._plots.items():
            values = np.clip(getattr(thoughts, name).astype(float), *self._ends[name])
            plot.data = (plot.data[0], values, *plot.data[2:])
        if self._map is not None and not np.array_equal(goal, self._mapped):
            self._map.image, self._mapped = self._map_of(), goal.copy()

    def _map_of(self) -> UInt8[np.ndarray, "pixels pixels 3"]:
        bounds: Any = self._world.env.single_observation_space
        return images.value_image(self._world.agent, bounds.low, bounds.high, self._world.goal)


def _round(value: float) -> float:
    """The next of 1, 2, 5, 10, 20, 50 and so on."""
    power = 10 ** np.floor(np.log10(max(value, 1.0)))
    return float(next(power * n for n in (1, 2, 5, 10) if power * n >= value))
