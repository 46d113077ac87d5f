"""A model travels with all that it names, and is told from every other."""

import hashlib
import json
import os
import shutil
import struct
from pathlib import Path

import imageio.v3 as imageio
import numpy as np
import pytest

from everystate.envs import copy_model, make
from everystate.envs.body import load_model
from everystate.envs.model_copy import copied_model, model_hash
from everystate.errors import EverystateError

ROBOT = """<mujoco><compiler meshdir="../assets" texturedir="../assets/looks"/>
<include file="parts/motors.xml"/>
<asset>
  <mesh name="foot" file="part.stl"/>
  <texture name="skin" type="2d" file="part.png"/><material name="skin" texture="skin"/>
  <texture name="sky" type="skybox" fileup="part.png" filedown="part.png"/>
  <hfield name="hills" file="hills.bin" size="1 1 .1 .1"/>
  <model name="hand" file="hand/hand.xml"/>
</asset>
<worldbody><geom type="hfield" hfield="hills"/>
  <body pos="0 0 1"><joint name="hip" range="-1 1"/><geom type="mesh" mesh="foot" material="skin"/>
    <frame pos="0 0 1"><attach model="hand" body="hand" prefix="left_"/></frame></body>
</worldbody></mujoco>"""
MOTORS = '<mujoco><actuator><motor name="hip" joint="hip"/></actuator></mujoco>'
HAND = """<mujoco model="hand"><compiler meshdir="shapes"/><asset><mesh name="m" file="part.stl"/>
</asset><worldbody><body name="hand"><joint name="wrist"/><geom type="mesh" mesh="m"/></body>
</worldbody></mujoco>"""
FILES = {
    *("assets/part.stl", "assets/looks/part.png", "assets/hills.bin", "robot/robot.xml"),
    *("robot/parts/motors.xml", "robot/hand/hand.xml", "robot/hand/shapes/part.stl", "body.json"),
}


def mesh(size: float) -> bytes:
    """A tetrahedron, as binary STL."""
    corners = size * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=np.float32)
    faces = [corners[list(face)] for face in ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3))]
    triangles = [struct.pack("<3f", 0, 0, 0) + face.tobytes() + b"\0\0" for face in faces]
    return b"\0" * 80 + struct.pack("<I", 4) + b"".join(triangles)


@pytest.fixture
def robot(tmp_path: Path) -> Path:
    """A model of many files, two of which have the same name."""
    hills = struct.pack("<2i", 4, 4) + np.linspace(0, 1, 16, dtype=np.float32).tobytes()
    (tmp_path / "assets" / "looks").mkdir(parents=True)
    imageio.imwrite(tmp_path / "assets/looks/part.png", np.full((8, 8, 3), 99, dtype=np.uint8))
    for name, content in {
        "assets/part.stl": mesh(0.1),
        "assets/hills.bin": hills,
        "robot/robot.xml": ROBOT.encode(),
        "robot/parts/motors.xml": MOTORS.encode(),
        "robot/hand/hand.xml": HAND.encode(),
        "robot/hand/shapes/part.stl": mesh(0.3),
    }.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_bytes(content)
    return tmp_path / "robot" / "robot.xml"


def test_meshes_textures_fields_includes_and_parts_travel(
    robot: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    known = make(str(robot), 1, 0).model_hash
    monkeypatch.chdir(tmp_path)
    copy_model(robot.relative_to(tmp_path), tmp_path / "copy")
    there = tmp_path / "far" / "away"
    there.parent.mkdir()
    (tmp_path / "copy").rename(there)
    for original in ("robot", "assets"):
        shutil.rmtree(tmp_path / original)
    assert {p.relative_to(there).as_posix() for p in there.rglob("*") if p.is_file()} == FILES
    env = make(str(robot), 1, 0, model_copy=str(there))
    assert (env.name, env.model_hash) == (str(robot), known)


@pytest.mark.parametrize("name", sorted(FILES - {"body.json"}))
@pytest.mark.parametrize("damage", ["gone", "flipped"])
def test_a_copy_that_is_not_whole_is_refused(
    robot: Path, tmp_path: Path, name: str, damage: str
) -> None:
    copy_model(robot, tmp_path / "copy")
    path = tmp_path / "copy" / name
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 4
    path.write_bytes(content)
    if damage == "gone":
        path.unlink()
    said = {"gone": "is missing", "flipped": "is not what it was"}[damage]
    with pytest.raises(EverystateError, match=f"{path} {said}"):
        copied_model(tmp_path / "copy")


def test_a_path_out_of_the_copy_is_refused(robot: Path, tmp_path: Path) -> None:
    absolute = ROBOT.replace("../assets/looks", str(tmp_path / "assets" / "looks"))
    robot.write_text(absolute)
    with pytest.raises(EverystateError, match=r"robot\.xml names .*part\.png by a path that leads"):
        copy_model(robot, tmp_path / "copy")


EVIL = """<mujoco>{}<worldbody><body><joint name="hip"/><geom size="1"/></body></worldbody>
<actuator><motor joint="hip"/></actuator></mujoco>"""


@pytest.mark.parametrize(
    ("names", "named"),
    [
        ("", "../secret.xml"),
        ("", "/etc/hostname"),
        ('<include file="../secret.xml"/>', "arm.xml"),
        ('<asset><mesh name="m" file="../secret.stl"/></asset>', "arm.xml"),
        ('<compiler meshdir=".."/><asset><mesh name="m" file="secret.stl"/></asset>', "arm.xml"),
        ('<asset><hfield name="h" file="../secret.stl" size="1 1 1 1"/></asset>', "arm.xml"),
    ],
)
def test_a_copy_made_to_lead_elsewhere_is_refused(tmp_path: Path, names: str, named: str) -> None:
    """Its checksums are right, as one who means harm would have them."""
    folder = tmp_path / "body"
    folder.mkdir()
    (folder / "arm.xml").write_text(EVIL.format(names))
    (tmp_path / "secret.xml").write_text("<mujoco><option timestep='0.003'/></mujoco>")
    (tmp_path / "secret.stl").write_bytes(mesh(0.1))
    checksum = hashlib.sha256((folder / named).read_bytes()).hexdigest()
    listed = {"model": named, "files": {named: checksum}}
    (folder / "body.json").write_text(json.dumps(listed))
    with pytest.raises(EverystateError, match=r"must lie in that folder|leads out of its copy"):
        copied_model(folder)


@pytest.mark.parametrize(
    ("name", "old", "new", "alike"),
    [
        ("robot/robot.xml", "<mujoco>", "<mujoco><!-- a note -->", True),
        ("robot/robot.xml", 'material="skin"', 'material="skin" rgba="1 0 0 1"', True),
        ("robot/robot.xml", "<worldbody>", '<worldbody><camera name="c"/>', True),
        ("robot/robot.xml", "<worldbody>", '<option timestep="0.001"/><worldbody>', False),
        ("robot/robot.xml", "<worldbody>", '<option gravity="0 0 -9.8"/><worldbody>', False),
        ("robot/robot.xml", 'range="-1 1"', 'range="-1 1.0001"', False),
        ("robot/robot.xml", 'range="-1 1"', 'range="-1 1" damping="0.01"', False),
        ("robot/robot.xml", 'mesh="foot"', 'mesh="foot" friction="0.9"', False),
        ("robot/robot.xml", 'size="1 1 .1 .1"', 'size="1 1 .2 .1"', False),
        ("robot/parts/motors.xml", 'joint="hip"', 'joint="hip" gear="2"', False),
        ("robot/hand/hand.xml", 'name="wrist"', 'name="wrist" axis="1 0 0"', False),
    ],
)
def test_the_hash_is_of_how_it_moves(
    robot: Path, name: str, old: str, new: str, alike: bool
) -> None:
    before = model_hash(load_model(robot))
    path = robot.parents[1] / name
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new, 1))
    assert (model_hash(load_model(robot)) == before) == alike


@pytest.mark.parametrize("name", ["assets/part.stl", "robot/hand/shapes/part.stl"])
def test_the_hash_is_of_meshes_too(robot: Path, name: str) -> None:
    before = model_hash(load_model(robot))
    (robot.parents[1] / name).write_bytes(mesh(0.11))
    os.utime(robot.parents[1] / name, (0, 0))  # or MuJoCo takes the mesh that it has kept
    assert model_hash(load_model(robot)) != before


def test_the_hash_does_not_hang_on_last_bits(robot: Path) -> None:
    model = load_model(robot)
    before = model_hash(model)
    model.body_mass[:] *= 1 + 1e-15
    model.body_pos[0, 1] = -1e-17
    assert model_hash(model) == before
    model.body_mass[:] *= 1 + 1e-6
    assert model_hash(model) != before
