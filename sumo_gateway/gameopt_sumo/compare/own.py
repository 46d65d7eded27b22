"""SUMO's own drivers under the net's own control, only watched, with the fixed report.

python -m gameopt_sumo.compare.own CONFIG.sumocfg --junction ID --seed N --duration S --warmup S --report FILE.json
"""

from __future__ import annotations

import sys
from pathlib import Path

import click


@click.command()
@click.argument("config", type=click.Path(exists=True, dir_okay=False, path_type=Path))
@click.option("--junction")
@click.option("--seed", type=int, default=1)
@click.option("--duration", "duration_s", type=float, required=True)
@click.option("--warmup", "warmup_s", type=float, default=0.0)
@click.option("--report", type=click.Path(dir_okay=False, path_type=Path), required=True)
def own(config: Path, junction: str | None, seed: int, duration_s: float, warmup_s: float, report: Path) -> None:
    """Watch one run and write its report."""
    from gameopt_sumo.baselines.report import assemble
    from gameopt_sumo.baselines.watch import Run, watch

    seen = watch(Run(config=config, junction=junction, seed=seed, duration_s=duration_s, warmup_s=warmup_s))
    measured = assemble("own", seen)
    report.write_bytes(measured.to_json())
    sys.exit(4 if measured.collided() else 0)


if __name__ == "__main__":
    own()
