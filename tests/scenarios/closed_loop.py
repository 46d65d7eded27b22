"""A closed loop in one process: the real simulation, fleet, agents and manager; only the network is missing.

libsumo has one simulation per process, so `in_a_process` runs `python closed_loop.py '{"sumocfg": …}'` and
reads the JSON line it prints. `broken` takes one safety measure away, so that the collision check has
something to find.
"""

from __future__ import annotations

import asyncio
import hashlib
import inspect
import json
import subprocess
import sys
import time
from collections import deque
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

PATIENCE_S = 120.0
"""No run takes this long; one that hangs fails instead."""


def in_a_process(**request: Any) -> dict[str, Any]:
    """The result of `drive(**request)` in a process of its own."""
    done = subprocess.run(
        [sys.executable, "-W", "error", __file__, json.dumps(request, default=str)],
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    result: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return result


class InProcessBus:
    """What the fleet takes for its bus: what is put goes straight to a manager, which answers the step."""

    def __init__(self, manager: Any, intersection: str) -> None:
        self.intersection = intersection
        self.commands: deque[Any] = deque()
        self.reports: deque[Any] = deque()
        self.presence: deque[bool] = deque()
        self.digest = hashlib.sha256()
        self.last_report: Any = None
        self._manager = manager
        self._inbox: list[Any] = []

    def put(self, key: str, payload: bytes, mark: bytes | None = None) -> None:
        """Keep one message for the control cycle."""
        del mark
        from gameopt_im.inbox import Raw

        stream: Any = key.split("/")[2]
        self._inbox.append(Raw(stream, payload, key))

    async def wait(self, timeout_s: float) -> bool:
        """Let the manager answer the step that was announced."""
        del timeout_s
        from gameopt_im.inbox import split_steps
        from gameopt_vehicles.bus import Received
        from gameopt_wire import codec

        messages, steps = split_steps(self._inbox)
        self._inbox.clear()
        step = codec.STEP.decode(steps[0].payload)
        outcome = await self._manager.control_cycle(step.cycle, step.time_s, messages)
        for command in outcome.commands:
            payload = codec.COMMAND.encode(command)
            self.digest.update(payload)
            self.commands.append(Received(time.monotonic(), payload))
        self.last_report = outcome.report
        self.reports.append(Received(time.monotonic(), codec.CYCLE.encode(outcome.report)))
        return True

    def wake(self) -> None:
        """Nobody sleeps here."""


class QpShare:
    """Counts the uncleared vehicles' commands that would differ had the program sat on its upper bounds.

    It wraps `decision.conclude` and compares within one control cycle, so the run itself is not changed.
    """

    def __init__(self, at_least_mps: float = 0.01) -> None:
        self.commands = self.changed = 0
        self._at_least_mps = at_least_mps

    def install(self) -> None:
        """Listen to every control cycle from now on."""
        from gameopt_im.core import decision, interlock
        from gameopt_wire.messages import STEP_S

        conclude = decision.conclude
        signature = inspect.signature(conclude)

        def watched(*given: Any, **named: Any) -> Any:
            concluded = conclude(*given, **named)
            call = signature.bind(*given, **named).arguments
            snapshot, limits = call["snapshot"], call["picture"].limits
            upper = interlock.bounded(np.minimum(snapshot.v_max, snapshot.v + snapshot.a_max * STEP_S), limits)
            # whoever was granted a clearance in this very control cycle is on its profile already
            waiting = [i for i in call["who"].index if snapshot.ids[i] not in call["book"].held]
            self.commands += len(waiting)
            self.changed += int(np.sum(np.abs(upper - concluded.speeds)[waiting] > self._at_least_mps))
            return concluded

        decision.conclude = watched


def break_margins() -> Any:
    """Parameters under which windows may overlap: in granting and, to get that far, in planning."""
    from gameopt_im.core.parameters import Interlock, Parameters, Planner

    # Out of the ranges a configuration file may name, and therefore only to be had here.
    return Parameters(interlock=Interlock(margin_s=-0.8, margin_m=-1e3), planner=Planner(margin_s=-0.8))


def break_rear_end_rule() -> None:
    """Rule 2 taken out of the manager's interlock and granting, and out of the vehicles' own radar."""
    from gameopt_im.core import granting, interlock
    from gameopt_im.core.kinematics import NEVER
    from gameopt_vehicles import driving

    bound = interlock.limits
    interlock.limits = lambda *given: replace(bound(*given), follow=np.full(len(given[0]), NEVER))
    crossing = granting.crossing

    def alone(snapshot: Any, ground: Any, stack: Any, scene: Any, *more: Any) -> Any:
        nobody = np.full_like(scene.leaders, -1)
        nowhere = {"bound": np.arange(len(snapshot)), "stranger_x": np.full(len(snapshot), NEVER)}
        return crossing(snapshot, ground, stack, scene._replace(leaders=nobody, **nowhere), *more)

    granting.crossing = alone
    driving.radar_limit = lambda _: float("inf")


def watch_standing(road: Any) -> set[str]:
    """The vehicles that will have stood with their front past the line and their rear not yet clear."""
    step = road.step
    clear_m = {movement.id: movement.clear_m for movement in road.map.movements}
    standing: set[str] = set()

    def watched() -> Any:
        observations = step()
        standing.update(
            seen.vehicle
            for seen in observations
            if seen.speed_mps < 0.1 and 0.0 < -seen.distance_m < clear_m[seen.movement] + seen.length_m
        )
        return observations

    road.step = watched
    return standing


def watch_halts(road: Any) -> dict[str, bool]:
    """Who has crossed its line, and whether it had come to a stand at it or at its setback."""
    step = road.step
    setback_m = {movement.id: max(movement.setback_m or [0.0]) for movement in road.map.movements}
    stood: set[str] = set()
    crossed: dict[str, bool] = {}

    def watched() -> Any:
        observations = step()
        for seen in observations:
            if seen.speed_mps < 0.1 and 0.0 < seen.distance_m < 1.5 + setback_m[seen.movement]:
                stood.add(seen.vehicle)
        for seen in observations:
            if seen.distance_m < 0.0:
                crossed.setdefault(seen.vehicle, seen.vehicle in stood)
        return observations

    road.step = watched
    return crossed


async def drive(
    sumocfg: str,
    duration_s: float,
    *,
    seed: int = 1,
    junction: str | None = None,
    broken: str = "",
    qp_share: bool = False,
    inflate_m: float = 0.0,
    articulated: bool = False,
    profile: Any = "default",
    geometry: Any = "areas",
    configuration: str = "",
    **settings: Any,
) -> dict[str, Any]:
    """One run: collisions by both counts, vehicles, programs and a digest of all commands."""
    from gameopt_im import config
    from gameopt_im.manager import Manager
    from gameopt_im.options import ServeOptions
    from gameopt_im.service import solver_of
    from gameopt_sumo.simulation import Simulation
    from gameopt_vehicles.fleet import Fleet, Settings

    parameters = config.parse(configuration)
    if broken == "margin":
        parameters = break_margins()
    elif broken == "rear end":
        break_rear_end_rule()
    share = QpShare()
    if qp_share:
        share.install()
    with Simulation(Path(sumocfg), junction, seed, inflate_m=inflate_m, articulated=articulated) as road:
        standing, halts = watch_standing(road), watch_halts(road)
        known = msgspec.structs.replace(road.map, areas=[]) if broken == "conflict area" else road.map
        options = ServeOptions(
            map=known, parameters=parameters, clock="lockstep", workers=0, profile=profile, geometry=geometry
        )
        async with solver_of(options) as pool:
            bus: Any = InProcessBus(Manager(options, 1, pool), known.intersection)
            fleet = Fleet(road, bus, Settings(duration_s=duration_s, seed=seed, **settings))
            await fleet.run()
        measured = msgspec.to_builtins(road.measurements(0.0))
        overlapping = list(road.overlapping)
    return {
        "safety": measured["safety"],
        "vehicles": measured["vehicles"],
        "overlapping": overlapping,
        "standing": sorted(standing),
        "halted": sum(halts.values()),
        "ran_through": sorted(vehicle for vehicle, stood in halts.items() if not stood),
        "solved": bus.last_report.qp_solved_total,
        "rejected": bus.last_report.rejected_total,
        "fallbacks": fleet.tally.fallbacks,
        "lost": fleet.lost,
        "commands": fleet.tally.received,
        "digest": bus.digest.hexdigest(),
        "uncleared_commands": share.commands,
        "changed_commands": share.changed,
    }


def main(arguments: Sequence[str]) -> None:
    """The run a test asked for; the result is the last line of stdout."""
    from gameopt_im import logs

    logs.configure("text")
    print(json.dumps(asyncio.run(drive(**json.loads(arguments[0])))))  # noqa: T201


if __name__ == "__main__":
    main(sys.argv[1:])
