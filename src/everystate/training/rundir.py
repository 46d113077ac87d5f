"""The folder of a run: whose it is, that only one process writes to it, that nothing is lost.

config.json       the config, what the body's model compiled to, and the versions it ran with
config.toml       the config, for `everystate train --config`
body/             a copy of the body's model, if that is a file of its user's own
metrics.jsonl     one JSON object per epoch
tensorboard/      the same for TensorBoard
checkpoints/N/    everything after N epochs, and the agent as it then was
samples/N.npz     some visited states, the goals and the cells visited, for pictures
"""

import json
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path
from typing import Any

from everystate import config_file, locks
from everystate.agent import BodyInfo, config_to_json, config_to_plain
from everystate.agent.files import BODY
from everystate.agent.json_files import read_json
from everystate.config import Config
from everystate.errors import EverystateError
from everystate.presets import PRESETS, preset

FORMAT = 10
_LOCK = ".lock"
_PACKAGES = ("everystate", "jax", "jaxlib", "equinox", "flowjax", "optax", "mujoco", "numpy")


def default_run_dir(config: Config, preset_name: str) -> Path:
    """runs/BODY-PRESET-seedSEED."""
    body = re.sub(r"[^\w.-]+", "-", config.body)
    return Path("runs") / f"{body}-{preset_name}-seed{config.seed}"


def preset_name(config: Config) -> str:
    """The preset that a config is, or "custom"."""
    for name in PRESETS:
        if preset(name, config.body, seed=config.seed) == config:
            return name
    return "custom"


@contextmanager
def open_run(folder: Path, config: Config, body: BodyInfo) -> Iterator[Path]:
    """Claims a run folder, new or begun by the same config and body, for this process.

    Raises:
        EverystateError: it is foreign, of another config or body, or in use; nothing is written
            then.
    """
    if folder.exists() and not folder.is_dir():
        raise EverystateError(f"{folder} is a file: choose another --run-dir")
    ours = (folder / "config.json").exists()
    if not ours and folder.exists() and any(p.name != _LOCK for p in folder.iterdir()):
        raise EverystateError(
            f"{folder} is not empty and is no run: choose another --run-dir or an empty folder"
        )
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock = (folder / _LOCK).open("w")
    except OSError as error:
        raise EverystateError(f"cannot write to {folder}: {error.strerror}") from error
    with lock:
        try:
            locks.lock(lock)
        except BlockingIOError as error:
            raise EverystateError(
                f"{folder} is in use by another process: wait for it or choose another --run-dir"
            ) from error
        # Only now: the other process may have made it a run.
        if (folder / "config.json").exists():
            description = _require_same(folder, config, body)
        else:
            description = {
                "format": FORMAT,
                "config": {},
                "body": {"model_hash": body.model_hash, "versions": dict(body.versions)},
                "versions": {name: version(name) for name in _PACKAGES},
            }
        wanted = config_to_json(config)
        if description["config"] != wanted:
            description = {**description, "config": wanted}
            write_atomically(folder / "config.json", json.dumps(description, indent=2) + "\n")
            write_atomically(folder / "config.toml", config_file.text(config_to_plain(config)))
        yield folder


def _require_same(folder: Path, config: Config, body: BodyInfo) -> dict[str, Any]:
    """What config.json says, if it is of the same config and body: more epochs may be asked for."""
    try:
        description = read_json(folder / "config.json")
        found, format_found = dict(description["config"]), description["format"]
        model = dict(description["body"]) if format_found == FORMAT else {}
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise EverystateError(
            f"{folder / 'config.json'} cannot be read ({error}): choose another --run-dir"
        ) from error
    if format_found != FORMAT:
        raise EverystateError(
            f"{folder} has format {format_found} and this everystate writes format {FORMAT}: "
            f"choose another --run-dir"
        )
    wanted = config_to_json(config)
    differing = [
        f"{name} {found.get(name)} there and {wanted.get(name)} here"
        for name in [*wanted, *sorted(found.keys() - wanted.keys())]
        if found.get(name) != wanted.get(name)
        and not (name == "epochs" and _longer(config, found.get(name)))
    ]
    if differing:
        raise EverystateError(
            f"{folder} holds a run of another config ({'; '.join(differing)}): choose another"
            f" --run-dir, or the same config to go on with it"
        )
    if model.get("model_hash") != body.model_hash:
        copy = f"put back the file as in {folder / BODY}, or " if (folder / BODY).exists() else ""
        raise EverystateError(
            f"{folder} learned on another {config.body} than there is now (its model compiled to"
            f" another one, under {model.get('versions')} then and {dict(body.versions)} now):"
            f" {copy}choose another --run-dir"
        )
    return description


def _longer(config: Config, epochs: object) -> bool:
    return isinstance(epochs, int) and epochs < config.epochs


def write_atomically(path: Path, text: str) -> None:
    """Either the old file or the whole new one is there, whatever happens."""
    draft = path.with_name(f".{path.name}.draft")
    draft.write_text(text, encoding="utf-8")
    os.replace(draft, path)
