"""An agent as one file, a zip archive of its folder; and agents on the Hugging Face hub."""

import hashlib
import os
import shutil
import tempfile
import zipfile
import zlib
from pathlib import Path

from everystate.agent.compile_cache import cache_folder
from everystate.errors import EverystateError

ARCHIVE = ".zip"
"""How the name of an agent in one file ends."""
HUB = "hf:"
"""How the name of an agent on the hub begins: hf:OWNER/NAME, or hf:OWNER/NAME@REVISION."""
LIMIT = 2**30
"""Bytes that an archive may unpack to; our largest agents have a hundredth of it."""
_FILES = ["agent.json", "agent.safetensors", "body/*"]
_PROBLEMS = (OSError, ValueError, RuntimeError, EOFError, zipfile.BadZipFile, zlib.error)
"""What a file that is no archive may raise, or one that is damaged or encrypted."""


def pack(folder: Path, target: Path) -> None:
    """An archive of a folder's files, which appears whole or not at all."""
    os.replace(shutil.make_archive(str(folder), "zip", folder), target)


def unpack(path: Path) -> Path:
    """The folder of an agent in one file: in the user's cache, where it is unpacked once.

    Raises:
        EverystateError: it is no archive, a damaged one, or too large.
    """
    try:
        folder = cache_folder() / "agents" / hashlib.sha256(path.read_bytes()).hexdigest()
        if folder.exists():
            return folder
        folder.parent.mkdir(parents=True, exist_ok=True)
        with (
            zipfile.ZipFile(path) as archive,
            tempfile.TemporaryDirectory(dir=folder.parent, prefix=".") as draft,
        ):
            size = sum(one.file_size for one in archive.infolist())
            if size > LIMIT:
                raise ValueError(f"it would unpack to {size} bytes, more than {LIMIT}")
            unpacked = Path(draft) / "agent"
            archive.extractall(unpacked)  # keeps to that folder, whatever names it holds
            if not folder.exists():  # another process may have been first
                unpacked.rename(folder)
    except _PROBLEMS as error:
        raise EverystateError(
            f"{path} is no agent in one file ({error}): give a run folder or an exported agent"
        ) from error
    return folder


def from_hub(name: str) -> Path:
    """The folder of an agent on the hub, as its client keeps it on this machine.

    Raises:
        EverystateError: the client is not installed, or cannot get it.
    """
    try:
        import huggingface_hub  # pyright: ignore[reportMissingImports]
    except ImportError as error:
        raise EverystateError(
            f"{name} is on the hub, whose client is not here: pip install huggingface_hub"
        ) from error
    repo, _, revision = name.removeprefix(HUB).partition("@")
    try:
        found = huggingface_hub.snapshot_download(
            repo, revision=revision or None, allow_patterns=_FILES
        )
    except Exception as error:  # of many kinds: wrong names, no network, no such agent, no leave
        problem = " ".join(str(error).split())
        raise EverystateError(f"cannot get {name} from the hub: {problem}") from error
    return Path(found)
