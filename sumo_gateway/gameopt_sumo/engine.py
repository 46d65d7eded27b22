"""The one SUMO of this process: libsumo runs a single simulation, at which several junctions may look."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import libsumo

from gameopt_sumo import readings
from gameopt_sumo.readings import SUMO_FAULTS
from gameopt_sumo.run_files import Hush, SimulationError


class Engine:
    """SUMO, running. Whoever asks first for a step makes it for all; the last one to leave ends it."""

    def __init__(self, config: Path, seed: int, *, gui: bool, extra_args: Sequence[str]) -> None:
        """Start SUMO; raises `SimulationError`."""
        self.taken: set[str] = set()
        """The vehicles that some junction has taken over: no other may touch them."""
        self._users = 0
        self._steps = 0
        self._hush = Hush()
        try:
            readings.start(config, seed, gui, extra_args, self._hush)
        except SimulationError:
            self._hush.close()
            raise
        self.time_s = float(libsumo.simulation.getTime())

    def join(self) -> int:
        """One more looks at it; the number of steps made so far."""
        self._users += 1
        return self._steps

    def leave(self) -> None:
        """One less looks at it; without any it ends, which completes SUMO's output files."""
        self._users -= 1
        if self._users == 0:
            readings.end(self._hush)
            self._hush.close()

    def step(self, number: int) -> None:
        """See to it that this many steps are made; raises `SimulationError` when SUMO gives up."""
        if number <= self._steps:
            return
        try:
            with self._hush:
                libsumo.simulationStep()
        except SUMO_FAULTS as error:
            reason = self._hush.reason(str(error))
            raise SimulationError(f"SUMO stopped after {self.time_s:.1f} s: {reason}") from None
        self._steps = number
        self.time_s = float(libsumo.simulation.getTime())
