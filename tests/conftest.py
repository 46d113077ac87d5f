"""What every test runs under: shapes checked, JAX strict, compiled programs kept between runs."""

import functools
import gc
import importlib
import os
import shutil
from collections.abc import Callable, Iterator
from typing import Any

# Both before anything imports JAX: tests mean the same everywhere, and a GPU is asked for by name.
os.environ.setdefault("JAX_PLATFORMS", "cpu")
os.environ.setdefault("MPLBACKEND", "agg")

import jax
import jaxtyping
import pytest

# Every annotation of the package is checked at run time, shapes included. Installed here, at
# import, because a module that was imported earlier would go unchecked.
jaxtyping.install_import_hook("everystate", "beartype.beartype")

# Tracing makes objects by the thousand, and what is imported is never garbage: an eighth of tracing
# went into looking through it again and again.
gc.freeze()
gc.set_threshold(20_000)

jax.config.update("jax_numpy_dtype_promotion", "strict")
jax.config.update("jax_numpy_rank_promotion", "raise")

QUICKLY_COMPILED = (
    # Of XLA's two generators of code the one that takes a third of the time; both make code that
    # is as quick. (So is compiling with xla_cpu_opt_preset=FAST_COMPILE, but its code is not.)
    "--xla_cpu_use_fusion_emitters=false",
    "--xla_cpu_parallel_codegen_split_count=1",  # the other cores have tests of their own
)

# Library functions that promote inside themselves, each seen to fail under the two settings above.
# They alone run as they do for users; whatever calls them stays strict.
LENIENT = (
    ("optax.tree", "bias_correction"),  # 1 - decay**count, a float to an int32 power
    ("flowjax.bijections.masked_autoregressive", "rank_based_mask"),  # (n, 1) against (m,)
)


def lenient(function: Callable) -> Callable:
    """The same function, with JAX's own defaults while it is traced."""

    @functools.wraps(function)
    def wrapper(*args, **kwargs):
        with jax.numpy_dtype_promotion("standard"), jax.numpy_rank_promotion("allow"):
            return function(*args, **kwargs)

    return wrapper


for module_name, function_name in LENIENT:
    module = importlib.import_module(module_name)
    setattr(module, function_name, lenient(getattr(module, function_name)))


def pytest_configure(config: pytest.Config) -> None:
    """Keep compiled programs from run to run; compiling is most of the time of the fast tests.

    Down to the smallest: what is not jitted is hundreds of them, anew in every module and process.
    """
    cache: pytest.Cache | None = getattr(config, "cache", None)  # none under -p no:cacheprovider
    folder = cache.mkdir("jax") if cache is not None else None
    if folder is not None and "JAX_COMPILATION_CACHE_DIR" not in os.environ:
        os.environ["JAX_COMPILATION_CACHE_DIR"] = str(folder)  # for the processes that tests start
        os.environ["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = "0"
        jax.config.update("jax_compilation_cache_dir", str(folder))
    # Tests compile more than they run, and optimising is most of compiling.
    os.environ.setdefault("JAX_DISABLE_MOST_OPTIMIZATIONS", "1")
    jax.config.update("jax_disable_most_optimizations", True)
    os.environ.setdefault("XLA_FLAGS", " ".join(QUICKLY_COMPILED))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)


@pytest.fixture
def optimised(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """For what takes thousands of steps: programs that run quickly."""
    monkeypatch.delenv("JAX_DISABLE_MOST_OPTIMIZATIONS", raising=False)
    jax.config.update("jax_disable_most_optimizations", False)
    yield
    jax.config.update("jax_disable_most_optimizations", True)


@pytest.fixture
def as_users() -> dict[str, str]:
    """An environment for processes that compile as they do for a user."""
    quick = ("JAX_DISABLE_MOST_OPTIMIZATIONS", "XLA_FLAGS")
    return {name: x for name, x in os.environ.items() if name not in quick}


@pytest.fixture(scope="module", autouse=True)
def _forget_programs() -> Iterator[None]:
    """Frees a module's compiled programs: each maps memory, and a process has 65,530 maps."""
    yield
    jax.clear_caches()


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """Chromium, for the tests of pages."""
    from playwright.sync_api import sync_playwright

    chromium = shutil.which("chromium")
    assert chromium, "these tests need Chromium: apt-get install chromium"
    quiet = ("background-networking", "component-update", "sync", "quic")
    options = [*(f"--disable-{name}" for name in quiet), "--no-sandbox", "--no-first-run"]
    with sync_playwright() as playwright:
        opened = playwright.chromium.launch(executable_path=chromium, args=options)
        yield opened
        opened.close()
