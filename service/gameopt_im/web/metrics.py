"""`/metrics`: what Prometheus scrapes, made of the manager's plain counters when it asks.

No metric carries the id of a vehicle: a label value costs memory for as long as Prometheus remembers.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterable, Iterator
from importlib.metadata import version
from itertools import accumulate
from typing import NamedTuple, get_args

from aiohttp import web
from prometheus_client import ProcessCollector
from prometheus_client.core import (
    CounterMetricFamily,
    GaugeMetricFamily,
    HistogramMetricFamily,
    InfoMetricFamily,
    Metric,
)
from prometheus_client.exposition import choose_encoder
from prometheus_client.registry import Collector

from gameopt_im.options import ServeOptions
from gameopt_im.stages import Histogram
from gameopt_im.tracker import Reason
from gameopt_im.vitals import WHOLE, Vitals

PREFIX = "gameopt_"
OVERFLOW = "overflow"
"""Not a fault of the message, so it has a metric of its own."""
PROCESS = ProcessCollector(namespace="gameopt", registry=None)
REASONS: tuple[str, ...] = get_args(Reason)
ABOUT = ("version", "intersection", "clock", "profile", "geometry")
"""The labels of `gameopt_manager_info`."""


class Plain(NamedTuple):
    """A metric without labels: its name, what it says, and where it is read."""

    name: str
    help: str
    read: Callable[[Vitals], float]


GAUGES = (
    Plain("ready", "1 once the manager is announced on Zenoh and its workers are warm", lambda v: v.announced),
    Plain("vehicles", "vehicles present, from zone entry to the end of the exit stretch", lambda v: v.report.vehicles),
    Plain("vehicles_cleared", "vehicles that follow a clearance", lambda v: v.report.cleared),
    Plain("vehicles_waiting", "vehicles that still have to be cleared", lambda v: v.report.uncleared),
    Plain("vehicles_silent", "vehicles present whose last state is too old", lambda v: v.report.silent),
    Plain("vehicles_fallback", "vehicles that say they drive without commands", lambda v: v.report.fallback),
)
COUNTERS = (
    Plain("control_cycles", "control cycles", lambda v: v.control_cycles),
    Plain("missed_control_cycles", "control cycles that never began (wall clock)", lambda v: v.report.missed_total),
    Plain("commands", "commands sent", lambda v: v.commands),
    Plain("received_messages", "states and bids that came, taken or rejected", lambda v: v.report.received_total),
    Plain("overflow_messages", "messages the queue could not hold", lambda v: v.report.rejected_total.get(OVERFLOW, 0)),
    Plain("bids", "bids taken", lambda v: v.bids),
    Plain("grants", "clearances granted, taken or not", lambda v: v.grants),
    Plain("refusals", "times a vehicle asked for a clearance in vain, each control cycle anew", lambda v: v.refusals),
    Plain("withdrawals", "clearances asked back", lambda v: v.withdrawals),
    Plain("crossings", "vehicles that have left the conflict zone, cleared by this manager", lambda v: v.crossings),
    Plain(
        "fallback_vehicle_cycles",
        "vehicles on their own fallback, summed over control cycles",
        lambda v: v.fallback_vehicle_cycles,
    ),
    Plain("candidates", "candidate sequences evaluated", lambda v: v.candidates),
    Plain("dropped_candidates", "candidates not tried for want of time", lambda v: v.report.dropped_total),
    Plain(
        "unsolved_control_cycles", "control cycles without programs, for the same", lambda v: v.report.unsolved_total
    ),
    Plain("lost_workers", "solver processes that ended on their own", lambda v: v.programs.lost_workers),
)


class ManagerCollector(Collector):
    """All metrics of one manager, read when they are asked for."""

    def __init__(self, vitals: Vitals, about: dict[str, str]) -> None:
        self._vitals = vitals
        self._about = about

    def collect(self) -> Iterator[Metric]:
        """The metrics as they stand; `prometheus_client` calls this."""
        vitals = self._vitals
        yield InfoMetricFamily(f"{PREFIX}manager", "how the manager runs; always 1", value=self._about)
        for name, told, read in GAUGES:
            yield GaugeMetricFamily(PREFIX + name, told, value=float(read(vitals)))
        for name, told, read in COUNTERS:
            yield CounterMetricFamily(PREFIX + name, told, value=float(read(vitals)))
        yield self._rejected()
        yield self._programs()
        yield from self._stages()

    def _rejected(self) -> Metric:
        """Every reason from the start, at 0: an increase from nothing is none to Prometheus."""
        counted = self._vitals.report.rejected_total
        family = CounterMetricFamily(f"{PREFIX}rejected_messages", "messages rejected, by reason", labels=["reason"])
        for reason in dict.fromkeys((*REASONS, *counted)):
            if reason != OVERFLOW:
                family.add_metric([reason], counted.get(reason, 0))
        return family

    def _programs(self) -> Metric:
        counts = self._vitals.programs
        told = "quadratic programs, by outcome: solved, failed (no solution), late (not there by the deadline)"
        family = CounterMetricFamily(f"{PREFIX}solver_programs", told, labels=["outcome"])
        for outcome, count in (("solved", counts.solved), ("failed", counts.failed), ("late", counts.late)):
            family.add_metric([outcome], count)
        return family

    def _stages(self) -> Iterator[Metric]:
        whole = HistogramMetricFamily(
            f"{PREFIX}control_cycle_seconds", "the whole way of control cycles, to the last command handed to Zenoh"
        )
        parts = HistogramMetricFamily(
            f"{PREFIX}control_cycle_stage_seconds", "the stages of control cycles", labels=["stage"]
        )
        for stage, histogram in self._vitals.stages.snapshot().items():
            if stage == WHOLE:
                whole.add_metric([], _buckets(histogram), histogram.sum)
            else:
                parts.add_metric([stage], _buckets(histogram), histogram.sum)
        yield whole
        yield parts


def _buckets(histogram: Histogram) -> list[tuple[str, float]]:
    """Upper bounds and how many observations lie below or on each, as Prometheus wants them."""
    bounds = (*map(str, histogram.bounds), "+Inf")
    return list(zip(bounds, accumulate(histogram.counts), strict=True))


class Everything(Collector):
    """The metrics of a manager, and those of its process, which have been read already."""

    def __init__(self, manager: ManagerCollector, process: Iterable[Metric]) -> None:
        self._manager = manager
        self._process = process

    def collect(self) -> Iterator[Metric]:
        """All of them; `prometheus_client` calls this."""
        yield from self._manager.collect()
        yield from self._process


def about(options: ServeOptions) -> dict[str, str]:
    """What never changes while the manager runs."""
    values = (version("gameopt"), options.map.intersection, options.clock, options.profile, options.geometry)
    return dict(zip(ABOUT, values, strict=True))


def _format(accept: str) -> tuple[Callable[[Collector], bytes], str]:
    """How to write metrics for who accepts this, and its content type; as plain text where a version is none."""
    try:
        return choose_encoder(accept)
    except TypeError:
        return choose_encoder("")


def routes(options: ServeOptions, vitals: Vitals) -> list[web.RouteDef]:
    """The metrics of a manager, in the format that the scraper prefers."""
    manager = ManagerCollector(vitals, about(options))

    async def metrics(request: web.Request) -> web.Response:
        encode, content_type = _format(request.headers.get("Accept", ""))
        process = await asyncio.to_thread(PROCESS.collect)  # reads files
        await vitals.between_cycles()
        return web.Response(body=encode(Everything(manager, process)), headers={"Content-Type": content_type})

    return [web.get("/metrics", metrics)]
