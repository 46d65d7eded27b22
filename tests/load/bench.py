"""Record busy traffic with the real system, then measure the manager's decisions on it and on made-up traffic.

    python tests/load/bench.py --flows 10000,16000 --vehicles 50,60,100,200,260

Leaves the recordings and `bench.json` in the output folder; a recording that is there already is used again.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import click

from gameopt_sumo.compare.processes import BIN, Processes


def recorded(flow: int, seconds: int, out: Path) -> Path:
    """A recording of the four-arm junction at this demand, from an empty road."""
    folder = out / f"recording-{flow}-{seconds}"
    path = folder / f"{flow}-veh-h.mcap"
    if not path.exists():
        scenario = ["--flow", str(flow), "--seed", "102", "--duration", str(seconds), "--out", str(folder)]
        subprocess.run([BIN / "gameopt-sumo", "scenario", "four-arm", *scenario], check=True, stdout=subprocess.DEVNULL)
        partial = path.with_suffix(".part")
        lockstep = ["--clock", "lockstep"]
        drive = [*lockstep, "--sumo", folder / "four-arm.sumocfg", "--duration", str(seconds)]
        Processes().two([*lockstep, "--record", partial], drive, folder)
        partial.rename(path)
    return path


@click.command(context_settings={"show_default": True})
@click.option("--flows", default="10000,16000", help="Demands to record, veh/h.")
@click.option("--seconds", default=160, help="Simulated seconds of each; the first 20 s are not measured.")
@click.option("--vehicles", default="50,60,100,200,260", help="Numbers of vehicles to make up.")
@click.option("--cycles", default=2000, help="Control cycles of each.")
@click.option("--workers", default=1, help="Solver processes.")
@click.option("--out", type=click.Path(path_type=Path), default=Path("out/bench"))
def main(flows: str, seconds: int, vehicles: str, cycles: int, workers: int, out: Path) -> None:
    """Record, measure, and print the table."""
    recordings = [recorded(int(flow), seconds, out) for flow in flows.split(",")]
    named = [part for path in recordings for part in ("--recording", path)]
    figures = ["--vehicles", vehicles, "--cycles", str(cycles), "--workers", str(workers), "--no-ratios"]
    done = subprocess.run([BIN / "gameopt-im", "bench", *figures, *named, "--json", out / "bench.json"], check=False)
    sys.exit(done.returncode)


if __name__ == "__main__":
    main()
