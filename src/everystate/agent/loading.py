"""Agents from where they lie: a run, an exported folder or file, a name, a hub."""

import warnings
from pathlib import Path

from everystate.agent import files, policy_file, sharing
from everystate.agent.agent import Agent
from everystate.agent.compile_cache import keep_compiled_programs
from everystate.errors import EverystateError, suggest

SHIPPED = Path(__file__).parents[1] / "agents"


def load(path: str | Path) -> Agent:
    """The agent in an exported folder or file or a run folder (its latest), or one by its name.

    Names are those of agents that come along, and hf:OWNER/NAME of one on the Hugging Face hub
    whose files lie on top of its repository; that needs the package huggingface_hub.

    If it learned on a model file of its user's, its body is built from the copy in that folder:
    `config.body_options` then has the option `model_copy`. An agent of the format before checksums
    is read with a warning.

    Raises:
        EverystateError: no agent there, a damaged one, or one of another version.
    """
    keep_compiled_programs()
    folder = Path(path)
    if str(path).startswith(sharing.HUB):
        folder = sharing.from_hub(str(path))
    elif folder.is_file():
        policy_file.refuse(folder)
        folder = sharing.unpack(folder)
    elif not folder.exists() and (SHIPPED / path).is_dir():
        folder = SHIPPED / path
    if (folder / "agent.json").exists():
        return Agent(*files.read(folder))
    checkpoints = sorted(folder.glob("checkpoints/[0-9]*"), reverse=True)
    for checkpoint in checkpoints:
        try:
            # Checkpoints come and go; the run's own copy of its body stays.
            return Agent(*files.read(checkpoint, folder / files.BODY))
        except EverystateError as error:
            if checkpoint == checkpoints[-1]:
                raise
            warnings.warn(f"{error}; taking the one before", stacklevel=2)
    if folder.exists():
        raise EverystateError(f"{folder} holds no agent: give a run folder or an exported agent")
    names = [shipped.name for shipped in SHIPPED.glob("*/")]
    hint = suggest(str(path), names) if names else "give a run folder or an exported agent"
    raise EverystateError(f"no agent at {path}: {hint}")
