"""How a decision's cost grows with traffic: 50 to 1,000 vehicles on a made-up junction of 48 lanes.

    python tests/load/growth.py --cycles 400

Leaves `bench.json`, and the fits as `decision-growth.md`, in the output folder. Ends with exit 1 where the whole
decision, with or without its programs, grows faster than n log n by more than the fit's uncertainty.
"""

from __future__ import annotations

import subprocess
import sys
from datetime import UTC, datetime
from pathlib import Path

import click
import msgspec

sys.path.append(str(Path(__file__).parents[1] / "maps"))
from many_lanes import LANES, write_net

from gameopt_im.bench import DECISION, WITHOUT, Results
from gameopt_im.benchmarks.growth import FASTER, Growth
from gameopt_sumo.compare.processes import BIN

PAGE, FIGURES = "decision-growth.md", "bench.json"


def page(results: Results, cycles: int) -> str:
    """The figures and fits, to read."""
    measured = [each for each in results.measured if each.traffic.endswith("vehicles")]
    versions = ", ".join(f"{name} {found}" for name, found in results.versions.items())
    lines = [
        "# How a decision grows with traffic",
        "",
        f"{datetime.now(UTC):%Y-%m-%d}; {versions}; {results.workers} solver workers. `make growth`: {cycles} control "
        f"cycles of each number of vehicles, in turns of twenty, after 200 that are not counted, on a made-up junction "
        f"of four arms with {LANES} lanes each. Medians, ms; what counts is how they grow.",
        "",
        "| vehicles | uncleared | " + " | ".join(measured[0].stages_ms) + " |",
        "| ---: | ---: |" + " ---: |" * len(measured[0].stages_ms),
        *(
            f"| {each.vehicles:.0f} | {each.uncleared:.0f} | "
            + " | ".join(f"{figures['p50']:.2f}" for figures in each.stages_ms.values())
            + " |"
            for each in measured
        ),
        "",
        "t = c n^exponent by least squares of log t, with 95 % intervals; *beyond n log n* is the exponent of "
        "t / (n log n): at 0 or below, t grows no faster. *Last two* is the exponent between the two largest numbers. "
        "*Off* is the standard deviation of the medians around c n log n and c n^2.",
        "",
        "| stage | exponent | beyond n log n | last two | by uncleared | off n log n | off n^2 | than n log n |",
        "| --- |" + " ---: |" * 6 + " --- |",
        *(_row(each) for each in results.growth),
        "",
    ]
    return "\n".join(lines)


def _row(each: Growth) -> str:
    return (
        f"| {each.stage} | {each.exponent} | {each.beyond} | {each.last:.2f} | {each.by_uncleared or '-'} "
        f"| {100 * each.spread_n_log_n:.0f} % | {100 * each.spread_n_squared:.0f} % | {each.verdict} |"
    )


@click.command(context_settings={"show_default": True})
@click.option("--vehicles", default="50,100,200,400,700,1000", help="Numbers of vehicles to make up.")
@click.option("--cycles", default=400, help="Control cycles of each.")
@click.option("--workers", default=1, help="Solver processes.")
@click.option("--out", type=click.Path(path_type=Path), default=Path("out/growth"))
def main(vehicles: str, cycles: int, workers: int, out: Path) -> None:
    """Make the junction, measure, and write the page."""
    out.mkdir(parents=True, exist_ok=True)
    net, figures = out / "many-lanes.net.xml", out / FIGURES
    write_net(net)
    asked = ["--map", net, "--vehicles", vehicles, "--cycles", str(cycles), "--workers", str(workers), "--no-ratios"]
    subprocess.run([BIN / "gameopt-im", "bench", *asked, "--json", figures], check=True)
    results = msgspec.json.decode(figures.read_bytes(), type=Results)
    (out / PAGE).write_text(page(results, cycles), encoding="utf-8")
    print(f"{out / PAGE}")  # noqa: T201
    sys.exit(any(each.verdict == FASTER for each in results.growth if each.stage in (DECISION, WITHOUT)))


if __name__ == "__main__":
    main()
