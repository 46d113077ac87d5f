"""Videos and filmstrips of recordings, drawn from their states; nothing is simulated again."""

import os
import shutil
import tempfile
import warnings
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import imageio.v2 as imageio
import imageio_ffmpeg
import numpy as np
from jaxtyping import UInt8

from everystate.envs import BodyVectorEnv
from everystate.envs.rendering import Along
from everystate.errors import EverystateError, suggest
from everystate.viewing import images, plots
from everystate.viewing.recording import Recording

FORMATS = (".mp4", ".gif", ".png")
_FILM_FRAMES = 12
_CHUNK = 64
_CURSOR = np.array([213, 94, 0], dtype=np.uint8)  # plots.RED


def check_target(path: Path) -> Path:
    """The path of a picture to be made.

    Raises:
        EverystateError: of another kind, already there, in no folder, or a film without ffmpeg.
            Nothing is overwritten.
    """
    if path.suffix not in FORMATS:
        raise EverystateError(f"cannot write {path}: {suggest(path.suffix, FORMATS)}")
    if path.exists():
        raise EverystateError(f"{path} is there already: remove it or choose another --out")
    if not path.parent.is_dir():
        raise EverystateError(f"{path.parent} is no folder: make it first, or choose another --out")
    if path.suffix == ".mp4":
        _find_ffmpeg()
    return path


def _find_ffmpeg() -> None:
    try:
        found = shutil.which(imageio_ffmpeg.get_ffmpeg_exe())
    except RuntimeError:  # none came with imageio-ffmpeg, and none is installed
        found = None
    if found is None:
        raise EverystateError(
            "films need ffmpeg: `apt-get install ffmpeg` and unset IMAGEIO_FFMPEG_EXE,"
            " or give --out NAME.gif"
        )


def write(
    recording: Recording, env: BodyVectorEnv, path: Path, *, width: int = 480, height: int = 360
) -> Path:
    """A video (.mp4, .gif) in real time, the goal as a ghost and V below; or a filmstrip (.png).

    Args:
        recording: what to show.
        env: its body.
        path: the file, which must not exist.
        width: of a frame, in pixels; even, for videos.
        height: the same, without the strip below.

    Raises:
        EverystateError: see `check_target`; or nothing to draw with.
    """
    check_target(path)
    rate = 1 / env.control_step if env.control_step else 25.0
    part = path.with_name(f".{os.getpid()}-{path.name}")  # a kill leaves no half of a video
    try:
        if path.suffix == ".png":
            plots.save(filmstrip(recording, env, width=width, height=height), part)
        elif path.suffix == ".gif":
            every = max(1, round(rate / 12))  # frames a second enough, or the file grows large
            frames = list(_frames(recording, env, width, height))[::every]
            imageio.mimwrite(part, frames, duration=1000 * every / rate, loop=0)  # pyright: ignore
        else:
            options = {"fps": rate, "macro_block_size": 2, "quality": 7}
            with warnings.catch_warnings(), closing(imageio.get_writer(part, **options)) as writer:
                # JAX warns of any fork; this one becomes ffmpeg before a line of Python runs.
                warnings.filterwarnings("ignore", message=r"os\.fork\(\) was called")
                for frame in _frames(recording, env, width, height):
                    writer.append_data(frame)
        os.link(part, path)  # unlike a renaming it does not take the place of another file
    except FileExistsError as error:
        raise EverystateError(f"{path} is there already: choose another --out") from error
    finally:
        part.unlink(missing_ok=True)
    return path


def as_gif(recording: Recording, env: BodyVectorEnv) -> tuple[str, bytes]:
    """A file name and what is to be in it.

    Raises:
        EverystateError: nothing to draw with.
    """
    name = f"{Path(env.name).name}-{recording.title.replace(' ', '-')}.gif"
    with tempfile.TemporaryDirectory() as folder:
        return name, write(recording, env, Path(folder) / "film.gif").read_bytes()


def filmstrip(
    recording: Recording, env: BodyVectorEnv, *, width: int = 480, height: int = 360
) -> plots.Figure:
    """Moments evenly spread over the recording, as in the paper's figures."""
    last = len(recording.states) - 1
    at = np.unique(np.linspace(0, last, _FILM_FRAMES).round().astype(int))
    along = Along(recording.states, at)
    frames = env.render_states(recording.states[at], recording.goals[at], width, height, along)
    step = env.control_step
    titles = [f"{t * step:.1f} s" if step else f"step {t}" for t in at]
    return images.filmstrip(list(frames), titles, columns=4)


def _frames(
    recording: Recording, env: BodyVectorEnv, width: int, height: int
) -> Iterator[UInt8[np.ndarray, "rows width 3"]]:
    """Pictures with the strip below them, a cursor at the moment shown."""
    curves = {"steps to go, -V": recording.steps_to_goal, "distance, σ": recording.distance}
    strip, cursors = images.strip(curves, width, max(80, height // 8 * 2))
    steps = np.arange(len(recording.states))
    for start in range(0, len(steps), _CHUNK):
        part = slice(start, start + _CHUNK)
        shown = recording.states[part], recording.goals[part]
        along = Along(recording.states, steps[part])
        pictures = env.render_states(*shown, width, height, along)
        for picture, columns in zip(pictures, cursors[part], strict=True):
            below = strip.copy()
            below[:, columns] = np.minimum(below[:, columns], _CURSOR)
            yield np.concatenate([picture, below])
