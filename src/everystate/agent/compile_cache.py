"""What JAX compiled, kept from one process to the next: compiling is most of a short run."""

import os
from pathlib import Path

import jax
from jax.experimental.compilation_cache import compilation_cache

_ours: list[Path] = []


def cache_folder() -> Path:
    """$EVERYSTATE_CACHE, by default in the user's cache folder."""
    default = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "everystate"
    return Path(os.environ.get("EVERYSTATE_CACHE") or default)


def keep_compiled_programs() -> None:
    """Keeps them in `cache_folder`.

    A cache that was already chosen, by JAX_COMPILATION_CACHE_DIR or in code, stays the one used.
    """
    if jax.config.values["jax_compilation_cache_dir"] is not None:
        return
    folder = cache_folder()
    jax.config.update("jax_compilation_cache_dir", str(folder / "jax"))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.5)
    compilation_cache.reset_cache()  # JAX looks only once, and may have looked before.
    _ours.append(folder / "programs")


def programs_folder() -> Path | None:
    """Where traced programs are kept; nowhere if the cache is not ours."""
    return _ours[-1] if _ours else None
