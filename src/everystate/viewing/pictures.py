"""What a report consists of."""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from matplotlib.figure import Figure

from everystate.envs import BodyVectorEnv
from everystate.viewing import plots, video
from everystate.viewing.recording import Recording


class Picture(NamedTuple):
    """A figure of the report."""

    name: str
    """Its file is NAME.png."""
    title: str
    caption: str
    draw: Callable[[], Figure]

    @property
    def file(self) -> str:
        return f"{self.name}.png"

    def write(self, path: Path) -> None:
        plots.save(self.draw(), path)


class Film(NamedTuple):
    """A film of the report, in real time."""

    title: str
    caption: str
    record: Callable[[], Recording]
    env: BodyVectorEnv
    file: str = "film.gif"

    def write(self, path: Path) -> None:
        video.write(self.record(), self.env, path, width=400, height=300)
