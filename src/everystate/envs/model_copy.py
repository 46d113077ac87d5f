"""A model that travels: a copy of an MJCF file and of all that it names, and what it compiles to.

The copy has the same files, byte for byte and in the same places relative to one another, under a
folder of its own, with a `body.json` that lists them with their checksums. (MuJoCo can save a model
as one XML file, but rounds its numbers to six digits, so that it would no longer be the same.)
"""

import hashlib
import json
import os
import shutil
from pathlib import Path, PurePosixPath

import mujoco
import numpy as np

from everystate.errors import EverystateError

LIST = "body.json"

_OPTIONS = """timestep gravity wind magnetic density viscosity impratio integrator cone solver
 iterations tolerance ls_iterations ls_tolerance noslip_iterations noslip_tolerance ccd_iterations
 ccd_tolerance disableflags enableflags disableactuator o_margin o_solref o_solimp o_friction"""
_FIELDS = {
    "body": "parentid mocapid pos quat ipos iquat mass inertia gravcomp",
    "jnt": """type bodyid limited range axis pos stiffness stiffnesspoly solref solimp margin
 actfrclimited actfrcrange actgravcomp""",
    "dof": "armature damping dampingpoly frictionloss solref solimp",
    "geom": """type bodyid dataid contype conaffinity condim priority size pos quat friction solmix
 solref solimp margin gap fluid adhesion surfacevel""",
    "site": "bodyid type size pos quat",
    "mesh": "vert vertadr face faceadr pos quat",
    "hfield": "size nrow ncol data",
    "flex": """dim contype conaffinity condim priority friction solmix solref solimp margin gap
 radius vert vertbodyid elem stiffness damping edgestiffness edgedamping""",
    "pair": "dim geom1 geom2 solref solreffriction solimp margin gap friction adhesion",
    "exclude": "signature",
    "eq": "type obj1id obj2id objtype active0 solref solimp data",
    "tendon": """adr num limited range stiffness stiffnesspoly damping dampingpoly frictionloss
 lengthspring armature solref_lim solimp_lim solref_fri solimp_fri actfrclimited actfrcrange""",
    "wrap": "type objid prm",
    "actuator": """trntype dyntype gaintype biastype trnid gear dynprm gainprm biasprm ctrllimited
 ctrlrange forcelimited forcerange actlimited actrange cranklength armature damping dampingpoly
 delay""",
    "plugin": "attr",
    "key": "qpos",
    "qpos0": "",
    "qpos": "spring",
}
"""What decides how a model moves and starts, by the names of `mjModel`: no colours, no cameras, and
nothing that MuJoCo works out from these."""


def model_hash(model: mujoco.MjModel) -> str:
    """A hash of the compiled model: the same wherever its files lie, another for another physics.

    Arrays are rounded to 2^-30 of their largest number, so that the last bits, in which processors
    and compilers differ, do not count.
    """
    digest = hashlib.sha256()
    found = {f"opt.{name}": getattr(model.opt, name, None) for name in _OPTIONS.split()}
    for prefix, names in _FIELDS.items():
        for name in (f"{prefix}_{one}" for one in names.split() or [""]):
            found[name.rstrip("_")] = getattr(model, name.rstrip("_"), None)
    for name, value in found.items():
        array = np.asarray(np.nan if value is None else value, dtype=np.float64)
        finite = np.abs(array[np.isfinite(array)])
        _, exponent = np.frexp(finite.max() if finite.size else 0.0)
        rounded = np.round(np.ldexp(array, 30 - int(exponent))) + 0.0  # -0.0 is 0.0
        digest.update(f"{name} {array.shape} {exponent};".encode() + rounded.tobytes())
    return digest.hexdigest()


def copy_model(xml: Path, folder: Path) -> None:
    """Copies an MJCF file that compiles, with all that it names, to a new folder.

    Raises:
        EverystateError: it names a file in a way that means another one from another folder.
        OSError: a file cannot be read or written.
    """
    files = model_files(xml)
    root = Path(os.path.commonpath([file.parent for file in files]))
    names = {file.relative_to(root): file for file in files}
    for name, file in names.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(file, folder / name)
    model = _absolute(xml).relative_to(root)
    described = {
        "model": model.as_posix(),
        "files": {name.as_posix(): _checksum(folder / name) for name in sorted(names)},
    }
    (folder / LIST).write_text(json.dumps(described, indent=2) + "\n")
    _require_inside(folder, model, xml)


def copied_model(folder: Path) -> Path:
    """The MJCF file in a folder that `copy_model` made, if it is all as it was then.

    Raises:
        EverystateError: a file is missing, is not what it was, or lies elsewhere.
    """
    try:
        described = json.loads((folder / LIST).read_text())
        model, files = PurePosixPath(described["model"]), dict(described["files"])
        for name, checksum in files.items():
            place = PurePosixPath(name)
            if place.is_absolute() or ".." in place.parts:
                raise EverystateError(f"{folder / LIST} names {name}: it must lie in that folder")
            if not (folder / name).is_file():
                raise EverystateError(f"{folder / name} is missing: the body cannot be built")
            if _checksum(folder / name) != checksum:
                raise EverystateError(
                    f"{folder / name} is not what it was: it was changed or damaged; put back the"
                    " file that the agent was trained with"
                )
        if str(model) not in files:
            raise ValueError(f"{model} is not among its files")
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        problem = " ".join(f"{type(error).__name__}: {error}".split())[:300]
        raise EverystateError(f"{folder / LIST} cannot be read ({problem})") from error
    _require_inside(folder, model, folder / model)
    return folder / model


def _require_inside(folder: Path, model: PurePosixPath | Path, named: Path) -> None:
    """Raises unless a copied file names copied files only."""
    for file in model_files(folder / model):
        if not file.is_relative_to(_absolute(folder)):
            raise EverystateError(
                f"{named} names {file} by a path that leads out of its copy: name it relative to"
                " the MJCF file, so that it can travel with the agent"
            )


def model_files(xml: Path) -> list[Path]:
    """The file and all that it names, however deeply: included files, meshes, textures, fields.

    The licences that lie beside them too, which ask to go wherever the files go.

    MuJoCo's own list looks for height fields in the wrong folder. So every file is added that one
    of the assets may mean, in the folder of any of the XML files.
    """
    try:
        listed = {Path(name) for name in mujoco.mju_getXMLDependencies(str(xml))}
        spec = mujoco.MjSpec.from_file(str(xml))
    except (mujoco.FatalError, ValueError) as error:
        problem = " ".join(str(error).split())[:300]
        raise EverystateError(f"the files that {xml} names cannot be found: {problem}") from error
    named = {
        Path(folder, name)
        for asset in (*spec.meshes, *spec.hfields, *spec.textures, *spec.skins)
        for name in (asset.file, *getattr(asset, "cubefiles", ()))
        for folder in ("", asset.compiler.meshdir, asset.compiler.texturedir)
        if name
    }
    listed |= {file.parent / name for file in listed for name in named}
    listed |= {found for file in listed for found in file.parent.glob("LICEN[CS]E*")}
    return sorted({_absolute(file) for file in listed if file.is_file()})


def _absolute(path: Path) -> Path:
    return Path(os.path.abspath(path))  # with no `..` left, and links as they are


def _checksum(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()
