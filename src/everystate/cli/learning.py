"""Commands that train: `train`, and `demo`, which shows what comes of it too."""

import argparse
import contextlib
import dataclasses
from pathlib import Path
from typing import Any

from everystate import config_file
from everystate.cli.measuring import shown
from everystate.cli.options import Train
from everystate.cli.parsing import parse
from everystate.cli.progress import working
from everystate.config import Config
from everystate.errors import EverystateError
from everystate.presets import preset


def train(argv: list[str], command: str = "train", run_dir: Path | None = None) -> Path:
    """Train an agent, or go on; returns the folder of the run."""
    peek = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    peek.add_argument("--preset", nargs="?")
    peek.add_argument("--config", nargs="?", type=Path)
    early = peek.parse_known_args(argv)[0]
    given = config_file.read(early.config) if early.config else {}
    named = bool(argv) and not argv[0].startswith("-")
    if not named and "body" not in given and {"-h", "--help"}.isdisjoint(argv):
        raise EverystateError("name the body first: everystate train BODY [options]")
    given["body"] = body = argv[0] if named else given.get("body", Train.body)
    of_file = given.pop("preset", Train.preset)
    name = early.preset or of_file
    try:
        numbers = preset(name, **given)
    except EverystateError as error:
        raise EverystateError(f"{early.config}: {error}" if early.config else error) from error
    defaults = Train(**dataclasses.asdict(numbers), preset=name, run_dir=run_dir)
    options = parse(Train, command, argv, defaults)
    if options.body != body:
        raise EverystateError(f"name the body first: everystate {command} {options.body} [options]")
    fields = {field.name: getattr(options, field.name) for field in dataclasses.fields(Config)}
    from everystate import training

    if (options.hosts, options.coordinator, options.host_id) != (1, None, None):
        training.join(options.hosts, options.coordinator, options.host_id)
    config = Config(**fields)
    named = training.default_run_dir(config, early.config.stem if early.config else name)
    body, how = fields.pop("body"), {"progress": "plain" if options.quiet else True}
    with (
        _crew(options.collectors, options.ray_address) as how["crew"],
        _tracker(options.track, (options.run_dir or named).name, config) as how["on_epoch"],
    ):
        return training.train(body, preset=name, run_dir=options.run_dir or named, **how, **fields)


def _tracker(tool: Any, name: str, config: Config) -> contextlib.AbstractContextManager[Any]:
    from everystate import training

    if tool is None or not training.leads():
        return contextlib.nullcontext()
    return training.Tracker(tool, name=name, config=dataclasses.asdict(config))


def _crew(collectors: int, address: str | None) -> contextlib.AbstractContextManager[Any]:
    if collectors:
        from everystate import scaling

        return scaling.on_ray(collectors, address)
    if address:
        raise EverystateError(
            f"--ray-address {address} is of no use without collectors: say --collectors N too"
        )
    return contextlib.nullcontext()


def demo(argv: list[str]) -> None:
    """Train, evaluate and report on the Ramp Pointmass."""
    run_dir = train(["ramp-pointmass", *argv], "demo", Path("runs/ramp-pointmass-demo"))
    from everystate import evaluation, viewing

    with working("measuring") as count:
        result = evaluation.evaluate(run_dir, on_step=count)
    for table in evaluation.tables(result):
        shown(table)
    print(f"report:      {viewing.report(run_dir, result)}")
    print(f"run:         {run_dir}")
    print(f"all metrics: {run_dir}/metrics.jsonl, and {run_dir}/tensorboard for TensorBoard")
    print(f"in Python:   everystate.load({str(run_dir)!r}).act(observation, goal)")
