"""Tables of the Ramp Pointmass alone (safety), and of speed."""

import sys
from dataclasses import replace

from table_cells import ROOT, Rows, Run, interval, read, runs, table, values

from everystate import preset


def climbs(setting: str) -> list[Run]:
    """How each seed's last agent climbs."""
    found = [run.get("epochs", run) for run in runs(f"safety/{setting}", "climbs.json")]
    return [run[max((e for e in run if e.isdigit()), key=int)] for run in found]


def climbing(goal: str) -> Rows:
    """A row per measure, a column per setting."""
    settings = {
        "worst of 20": "pessimal-of-20",
        "mean of 20": "mean-of-20",
        "worst of 8": "pessimal",
        "mean of 8": "mean",
        "25th percentile": "25th-percentile",
        "sensor noise 0.1": "sensor-noise",
        "sensor noise 0.02": "less-sensor-noise",
    }
    found = [climbs(name) for name in settings.values()]
    measures = {
        "falls": ("falls, % of climbs", 100),
        "completed": ("climbs completed, %", 100),
        "at_edge": ("leftward actions within 0.1 m of the edge, %", 100),
        "leftward": ("leftward actions anywhere on the ramp, %", 100),
        "wall": ("distance to the wall while climbing, m", 1),
    }
    rows = [["", *settings], ["seeds", *(str(len(of)) for of in found)]]
    for name, (title, times) in measures.items():
        rows.append([title, *(interval(values(of, goal, name), times, small=2) for of in found)])
    return rows


@table
def safety_west() -> Rows:
    """Climbs round the corner."""
    return climbing("west")


@table
def safety_ahead() -> Rows:
    """Climbs straight up."""
    return climbing("ahead")


@table
def updates() -> Rows:
    """The fraction of the peak by the arithmetic asked for, and by the returns evaluated."""
    sys.path.append(str(ROOT / "benchmarks"))
    from _arithmetic import update_flops  # pyright: ignore[reportMissingImports]

    rows = [["body (state size)", "updates/s", "asked for, GFLOP", "done, GFLOP", "peak, GFLOP/s",
             "asked for, of the peak", "done, of the peak", "PyTorch takes"]]  # fmt: skip
    for body, actions in (("ramp-pointmass", 2), ("cartpole", 1), ("ant", 8)):
        of, config = read("benchmarks/updates.json")["bodies"][body], preset("paper", body)
        every, one = (
            update_flops(replace(config, N=n), of["state_size"], actions) for n in (config.N, 1)
        )
        returns = (every - one) / (config.N - 1) * config.N
        done = 1 - (1 - of["returns_evaluated"]) * returns / every
        rows.append([
            f"{body} ({of['state_size']})", f"{of['updates_per_s']:.1f}",
            f"{of['gflop_per_update']:.1f}", f"{done * of['gflop_per_update']:.1f}",
            f"{of['peak_gflops']:.0f}", f"{of['fraction_of_peak']:.2f}",
            f"{done * of['fraction_of_peak']:.2f}", f"{of['ratio_to_torch']:.1f} x",
        ])  # fmt: skip
    return rows
