"""What runs on a node of a cluster: a group of bodies, in a process of its own."""

import platform
from importlib.metadata import PackageNotFoundError, version
from typing import Any

from everystate.config import Config

_PACKAGES = ("everystate", "ray", "jax", "jaxlib", "numpy", "mujoco")


def versions() -> dict[str, str]:
    """Those on which it depends what bodies do."""
    found = {"python": ".".join(platform.python_version_tuple()[:2])}
    for name in _PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "none"
    return found


class Station:
    """`Bodies` by remote calls."""

    def versions(self) -> tuple[str, dict[str, str]]:
        """The node's name, and what is installed there."""
        return platform.node(), versions()

    def open(self, config: Config) -> None:
        """Builds the bodies of a group; which one is not known before they start."""
        import jax

        jax.config.update("jax_platforms", "cpu")  # A node's accelerator is not ours to take.
        from everystate.agent import keep_compiled_programs
        from everystate.training.bodies import Bodies, make_bodies
        from everystate.training.groups import size_of
        from everystate.training.learner import compiled

        keep_compiled_programs()
        self._bodies = Bodies(make_bodies(config, size_of(config)), compiled(config))

    def do(self, method: str, *arguments: Any) -> Any:
        """What a method of `Bodies` returns, on the host."""
        import jax

        return jax.device_get(getattr(self._bodies, method)(*arguments))
