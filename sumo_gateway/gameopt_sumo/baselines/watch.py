"""SUMO's own drivers under a control of SUMO's own, only watched: nobody is told anything."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from gameopt_sumo.figures import Measurements
from gameopt_sumo.simulation import Simulation

_TOLERANCE_S = 1e-6


@dataclass(frozen=True, kw_only=True)
class Run:
    """One SUMO run: what is driven, for how long, and from when on it is measured."""

    config: Path
    net: Path | None = None
    """Replaces the .sumocfg's."""
    junction: str | None = None
    seed: int = 1
    duration_s: float = 300.0
    """All simulated seconds, warm-up included."""
    warmup_s: float = 0.0
    inflate_m: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Watched:
    """What was seen of a run, and of which; `duration_s` is shorter than asked for if it was interrupted."""

    run: Run
    intersection: str
    flow_veh_h: float | None
    ratio: float | None
    duration_s: float
    measured: Measurements


def watch(run: Run, stopped: Callable[[], bool] = lambda: False) -> Watched:
    """Drive `run` to its end, or until `stopped`, with the meter of our own runs. Raises `SimulationError`.

    libsumo has one simulation per process.
    """
    net = ("--net-file", str(run.net)) if run.net else ()
    simulation = Simulation(run.config, run.junction, run.seed, extra_args=net, inflate_m=run.inflate_m, control=False)
    with simulation:
        start_s = simulation.time_s
        while simulation.time_s - start_s + _TOLERANCE_S < run.duration_s and not stopped():
            simulation.step()
        return Watched(
            run=run,
            intersection=simulation.map.intersection,
            flow_veh_h=simulation.flow_veh_h,
            ratio=simulation.ratio,
            duration_s=round(simulation.time_s - start_s, 1),
            measured=simulation.measurements(run.warmup_s),
        )
