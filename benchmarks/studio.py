"""Whether the studio lives in real time: `python benchmarks/studio.py [--json]` (needs chromium).

A body under an agent that plans, with a browser looking on: how much of its time passes in a
second, and how much of a core the studio takes; the browser's own work is not counted. The ant is
of preset `quick` after an epoch: it can do nothing yet, but acting takes it as long as ever.
"""

import shutil
import tempfile
import time
from pathlib import Path

import _benchmark as benchmark
import psutil
from playwright.sync_api import Browser, sync_playwright

import everystate
from everystate.viewing.studio import Studio


def lived(browser: Browser, run: Path | str, seconds: float) -> dict[str, float]:
    """Seconds of the body's time and of a core's, in a second."""
    studio = Studio(run, port=0, plan=True)
    page = browser.new_page(viewport={"width": 1200, "height": 860})
    page.goto(studio.address)
    page.get_by_role("button", name="surprise me").click(timeout=60_000)
    time.sleep(10)  # programs are compiled, the page has drawn itself
    process, world = psutil.Process(), studio.world
    step = world.env.control_step or float("nan")
    began, steps, cpu = time.perf_counter(), world.steps, sum(process.cpu_times()[:2])
    time.sleep(seconds)
    passed = time.perf_counter() - began
    result = {
        "body_seconds": (world.steps - steps) * step / passed,
        "core_seconds": (sum(process.cpu_times()[:2]) - cpu) / passed,
        "control_step_ms": 1000 * step,
    }
    page.close()
    studio.close()
    return result


def main() -> None:
    """Measures and prints."""
    parser = benchmark.options(__doc__, seconds=20.0)
    options = parser.parse_args()
    if not (chromium := shutil.which("chromium")):
        parser.error("a browser has to look on: apt-get install chromium")
    result: dict = {
        "benchmark": "studio",
        "machine": benchmark.machine(),
    }
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        ant = everystate.train(
            "ant", run_dir=Path(folder) / "ant", epochs=1, num_updates=20, progress=False
        )
        for run in ("ramp-pointmass", "cartpole", ant):
            name = everystate.load(run).config.body
            result[name] = lived(browser, run, options.seconds)
        browser.close()
    benchmark.show(result, as_json=options.json, out=options.out)


if __name__ == "__main__":
    main()
