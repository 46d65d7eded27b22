"""What each experiment runs, and the list of runs behind a command line."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType

from gameopt_sumo.compare.methods import Method, MethodError, known
from gameopt_sumo.compare.runs import KNOBS, Run
from gameopt_sumo.compare.settings import TUNING_SEEDS
from gameopt_sumo.compare.views import ABLATION

FIRST_SEED = 101
"""`--seeds 3` are 101, 102 and 103; lights are tuned on others, and so is `coop` with `--first-seed 301`."""
_EVERY = ("coop", "coop@box", "coop-paper", "coop-fifo", "coop-v1", "fixed", "actuated", "stop-sign", "all-way-stop")
_QUARTERS = (0.0, 0.25, 0.5, 0.75, 1.0)


@dataclass(frozen=True, kw_only=True)
class Experiment:
    """What is run unless options say otherwise; knobs are turned one at a time, at their values."""

    methods: tuple[str, ...] = ()
    flows_veh_h: tuple[float, ...] = ()
    ratios: tuple[float, ...] = (1.0,)
    knobs: Mapping[str, tuple[float, ...]] = field(default_factory=lambda: MappingProxyType({}))
    computation: bool = False


def experiments() -> dict[str, Experiment]:
    """The experiments by name."""
    ablations = [name for name in known() if name.startswith(ABLATION)]
    return {
        "flows": Experiment(methods=_EVERY, flows_veh_h=(2000.0, 4000.0, 6000.0, 8000.0, 10000.0, 16000.0)),
        "unbalanced": Experiment(
            methods=("coop", "coop-paper", "fixed", "fixed-held", "actuated", "stop-sign", "all-way-stop"),
            flows_veh_h=(5200.0,),
            ratios=(1.0, 2.0, 3.0, 4.0),
        ),
        "preferences": Experiment(
            methods=("coop",),
            flows_veh_h=(8000.0,),
            knobs={"aggressiveness": _QUARTERS, "lambda": _QUARTERS, "trucks": (0.0, 0.1, 0.2, 0.3, 0.4)},
        ),
        "ablation": Experiment(
            methods=tuple(f"{name}@{on}" for on in ("areas", "box") for name in ("coop", *ablations)),
            flows_veh_h=(10000.0,),
        ),
        "computation": Experiment(computation=True),
        "drift": Experiment(methods=("coop",), flows_veh_h=(5200.0,), knobs={"noise": (0.0, 0.1, 0.2, 0.5, 1.0)}),
    }


def runs_of(
    experiment: Experiment, methods: Sequence[Method], seeds: int, own_net: bool, first_seed: int = FIRST_SEED
) -> list[Run]:
    """Every run, seed by seed, so that whatever is interrupted has something of everything."""
    demands: list[tuple[float | None, float | None]] = [(None, None)]
    if not own_net:
        demands = [(flow, ratio) for ratio in experiment.ratios for flow in experiment.flows_veh_h]
    runs = [
        Run(method=method.name, flow_veh_h=flow, ratio=ratio, seed=seed, knob=knob, value=value)
        for seed in range(first_seed, first_seed + seeds)
        for flow, ratio in demands
        for knob, value in _settings(experiment.knobs)
        for method in methods
    ]
    return list(dict.fromkeys(runs))


def check_knobs(experiment: Experiment, methods: Sequence[Method], own_net: bool) -> None:
    """Refuse knobs that a method does not have. Raises `MethodError`."""
    for knob in experiment.knobs:
        assert knob in KNOBS
        for method in methods:
            if not method.ours or (knob == "lambda" and method.configuration is not None):
                raise MethodError(f"{method.name} has no {knob} to vary; allowed: coop, coop-paper")
        if own_net and knob in ("trucks", "aggressiveness"):
            raise MethodError(f"the arrivals of --sumo are its own: {knob} cannot be varied")


def check_seeds(first_seed: int, seeds: int, methods: Sequence[Method]) -> None:
    """Refuse to measure lights on the arrivals that they are tuned on. Raises `MethodError`."""
    seen = set(range(first_seed, first_seed + seeds)) & set(TUNING_SEEDS)
    tuned = [method.name for method in methods if method.plan is not None]
    if seen and tuned:
        raise MethodError(
            f"{tuned[0]} is tuned on seed {min(seen)}; allowed: seeds without {', '.join(map(str, TUNING_SEEDS))}"
        )


def _settings(knobs: Mapping[str, tuple[float, ...]]) -> Iterator[tuple[str | None, float | None]]:
    if not knobs:
        yield None, None
    for knob, values in knobs.items():
        for value in values:
            yield knob, value
