"""Metrics for an experiment tracker: Weights & Biases, or trackio, which is called alike."""

import importlib
from collections.abc import Mapping
from typing import Any, Literal, final

from everystate.errors import EverystateError


@final
class Tracker:
    """Sends each epoch's metrics to a tracker: `train(..., on_epoch=tracker)`. A context manager.

        with everystate.Tracker("wandb", project="ramp", mode="offline") as tracker:
            everystate.train("ramp-pointmass", on_epoch=tracker)

    The tracker's own run begins with the `with` block and ends with it. A run that is resumed is
    another one there, which begins at the epoch after the last.
    """

    def __init__(self, tool: Literal["wandb", "trackio"], **options: Any) -> None:
        """Imports the tool, which has to be installed.

        Args:
            tool: the name of its package.
            **options: of the tool's `init`: name, config, and so on; its project is "everystate"
                if none is named.

        Raises:
            EverystateError: the tool is not installed.
        """
        try:
            self._tool: Any = importlib.import_module(tool)
        except ImportError as error:
            raise EverystateError(
                f"cannot track with {tool} ({error}): pip install {tool}"
            ) from error
        self._options = {"project": "everystate", **options}

    def __enter__(self) -> "Tracker":
        self._run = self._tool.init(**self._options)
        return self

    def __call__(self, metrics: Mapping[str, int | float]) -> None:
        """One epoch; `metrics` has `epoch` among its names."""
        self._run.log(dict(metrics), step=int(metrics["epoch"]))

    def __exit__(self, *error: object) -> None:
        self._run.finish()
