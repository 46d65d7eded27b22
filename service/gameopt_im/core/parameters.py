"""Every number the manager can be tuned by, with unit, default and range. `config.py` reads them from TOML.

The description of a key is its documentation: the reference page is generated from here.
"""

from __future__ import annotations

from typing import Annotated

import msgspec
from msgspec import Meta

Share = Annotated[float, Meta(ge=0.0, le=1.0)]
Seconds = Annotated[float, Meta(ge=0.0, le=60.0)]
Decel = Annotated[float, Meta(ge=0.1, le=10.0)]


class Section(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A table of the configuration; an unknown key is an error, not a silence."""


class VehicleClass(Section, frozen=True, kw_only=True):
    """Bounds within which a class bids and is weighed; the declared assertiveness picks the point between."""

    assertiveness: Annotated[tuple[float, float], Meta(description="range of A, the paper's scale of 1 to 10 (1)")] = (
        1.0,
        5.0,
    )
    speed_priority: Annotated[tuple[float, float], Meta(description="range of Ps, weight of going fast (1)")] = (
        0.8,
        1.2,
    )
    variation_priority: Annotated[
        tuple[float, float],
        Meta(description="range of Pv, weight of steady speed (1); the assertive end comes last"),
    ] = (1.2, 0.8)


def _classes() -> dict[str, VehicleClass]:
    return {
        "passenger": VehicleClass(),
        "truck": VehicleClass(assertiveness=(3.0, 6.0), speed_priority=(0.8, 1.2), variation_priority=(3.0, 2.0)),
        "bus": VehicleClass(assertiveness=(3.0, 7.0), speed_priority=(1.0, 2.0), variation_priority=(2.0, 1.5)),
        "emergency": VehicleClass(assertiveness=(7.0, 10.0), speed_priority=(4.0, 6.0), variation_priority=(0.5, 0.3)),
    }


def _weights() -> list[tuple[float, float, float, float]]:
    """From almost nothing, which leaves the order to the slots and makes platoons, to single features.

    Two of them ask who is in a hurry above all: among their sequences is one that lets an emergency vehicle through.
    """
    return [
        (0.0, 0.0, 0.05, 0.0),
        (0.05, 0.05, 0.1, 0.05),
        (0.2, 0.0, 0.2, 0.1),
        (0.0, 0.0, 0.05, 0.5),
        (0.3, 0.0, 0.0, 0.0),
        (0.0, 0.0, 1.0, 0.0),
        (0.0, 0.0, 0.1, 1.0),
        (0.25, 0.25, 0.25, 0.25),
    ]


class Auction(Section, frozen=True, kw_only=True):
    """Features, weights and item values of the sponsored-search auction."""

    order: Annotated[
        str,
        Meta(
            pattern="^(dispatch|sorted|arrival)$",
            description="who goes next: the dispatch auction's choice, the highest bid as in the paper, "
            "or who entered the zone first, whatever it bids",
        ),
    ] = "dispatch"
    time_bound_s: Annotated[float, Meta(ge=1, le=120, description="c1, bound of the time feature T (s)")] = 15.0
    distance_bound_m: Annotated[float, Meta(ge=10, le=2000, description="c2, bound of the distance feature D (m)")] = (
        150.0
    )
    waiting_bound_s: Annotated[
        float, Meta(ge=1, le=600, description="waiting time that makes the feature W equal 1 (s)")
    ] = 30.0
    assertiveness_bound: Annotated[
        float, Meta(ge=1, le=100, description="assertiveness that makes the feature A equal 1 (1)")
    ] = 10.0
    min_speed_mps: Annotated[float, Meta(ge=0.1, le=10, description="v_min in tau = s / max(v, v_min) (m/s)")] = 1.0
    weights: Annotated[
        list[tuple[float, float, float, float]],
        Meta(min_length=1, max_length=64, description="weight vectors omega for T, D, W, A, one a candidate"),
    ] = msgspec.field(default_factory=_weights)
    bid_seconds: Annotated[
        float, Meta(ge=0, le=120, description="seconds of slot that a master bid of 1 is worth (s)")
    ] = 3.0
    waiting_multiplier: Annotated[
        float, Meta(ge=0, le=10, description="Carlino's multiplier: bids grow by this share per second (1/s)")
    ] = 0.0
    slot_value_ratio: Annotated[
        float, Meta(gt=0, lt=1, description="alpha_{k+1} / alpha_k, value of a later turn (1)")
    ] = 0.9
    transfer_share: Annotated[
        Share, Meta(description="share of the overflow bound that a blocked follower transfers (1)")
    ] = 0.5


class Planner(Section, frozen=True, kw_only=True):
    """Slots, approach and selection of the default profile."""

    incumbent: Annotated[
        bool, Meta(description="whether last cycle's order, with newcomers appended, competes with the new ones")
    ] = True
    selection: Annotated[
        str,
        Meta(
            pattern="^(delay|objective)$",
            description="q* by predicted weighted delay with J beside it, or by J alone as in the paper",
        ),
    ] = "delay"
    upstream: Annotated[
        bool, Meta(description="whether a delayed vehicle waits upstream to cross fast, or at its line")
    ] = True
    margin_s: Annotated[
        Seconds,
        Meta(description="margin between windows when planning; keep it above interlock.margin_s (s)"),
    ] = 0.16
    headway_s: Annotated[Seconds, Meta(description="added to (length + 2 m) / speed between slots of one lane (s)")] = (
        0.1
    )
    incumbent_bonus: Annotated[Share, Meta(description="share taken off the incumbent's cost (1)")] = 0.02
    decels_mps2: Annotated[
        tuple[Decel, ...],
        Meta(description="decelerations the approach tries, softest first (m/s^2)"),
    ] = (1.0, 1.5, 2.25, 3.4)
    accel_share: Annotated[
        float, Meta(ge=0.1, le=1, description="share of its acceleration an approach counts on (1)")
    ] = 1.0
    hold_weight: Annotated[
        float,
        Meta(ge=0, le=10, description="seconds of slot that keeping contested ground for a second costs (1)"),
    ] = 0.3
    patience_s: Annotated[
        float,
        Meta(ge=0, le=600, description="time in the zone after which waiting begins to count (s)"),
    ] = 10.0
    impatience: Annotated[
        tuple[Annotated[float, Meta(ge=0, le=20)], ...],
        Meta(min_length=1, description="seconds of slot a bid grows by per second after that, by candidate (1)"),
    ] = (0.0, 0.3, 1.0)
    starvation_weight: Annotated[
        float,
        Meta(ge=0, le=10, description="selection's weight of the squared time after that, at the slot (1/s)"),
    ] = 0.05
    line_share: Annotated[
        float, Meta(ge=0.3, le=1, description="share of the limit that a delayed vehicle aims for at its line (1)")
    ] = 1.0
    min_cruise_mps: Annotated[
        float, Meta(ge=0.1, le=5, description="an approach slower than this stops instead (m/s)")
    ] = 0.5


class Program(Section, frozen=True, kw_only=True):
    """The quadratic programs."""

    solve: Annotated[
        bool, Meta(description="whether programs are solved; without, vehicles are driven on the approach law")
    ] = True
    lambda_: Annotated[Share, Meta(description="trade-off lambda between speed and steadiness (1)")] = msgspec.field(
        default=0.7, name="lambda"
    )
    blocks_s: Annotated[
        tuple[Annotated[float, Meta(ge=0.1, le=10)], ...],
        Meta(min_length=1, max_length=60, description="lengths of the horizon's steps (s)"),
    ] = (0.5, 0.5, 1.0, 1.0, 1.5, 1.5, 2.0, 2.0)
    objective_weight: Annotated[
        float, Meta(ge=0, le=10, description="weight of J beside the predicted weighted delay (s)")
    ] = 0.0005
    residual_mps: Annotated[
        float, Meta(gt=0, le=0.1, description="largest primal residual that counts as a solution (m/s)")
    ] = 1e-3
    deadline_s: Annotated[
        float, Meta(gt=0, le=0.1, description="wall clock: candidates later than this are dropped (s)")
    ] = 0.04
    rear_gap_m: Annotated[float, Meta(ge=0, le=20, description="M_sr of the paper's rows (m)")] = 2.0
    lateral_margin_m: Annotated[
        float, Meta(ge=0, le=200, description="M_sl of the paper's rows and of box geometry (m)")
    ] = 25.0
    lateral_rows: Annotated[
        str, Meta(pattern="^(reduced|full)$", description="lateral rows: transitive reduction or all pairs")
    ] = "reduced"


class Interlock(Section, frozen=True, kw_only=True):
    """The last word over any solver."""

    ask: Annotated[
        str,
        Meta(
            pattern="^(slot|rule|standing)$",
            description="a clearance is asked for ahead of the slot or where rule 1 binds; only where rule 1 binds; "
            "only once the vehicle has come to a stand at its line, as at a stop sign",
        ),
    ] = "slot"
    margin_s: Annotated[
        float, Meta(ge=0.05, le=10, description="least time between two windows on one conflict area (s)")
    ] = 0.15
    margin_m: Annotated[
        float, Meta(ge=0, le=20, description="the same as a distance at the speed driven there (m)")
    ] = 1.0
    grant_ahead_s: Annotated[
        float, Meta(ge=0.5, le=30, description="clearances are asked for this long before the slot (s)")
    ] = 6.0
    retries: Annotated[
        int, Meta(ge=0, le=20, description="times a refused profile aims later within one control cycle")
    ] = 4
    offer_valid_s: Annotated[
        float, Meta(ge=0.1, le=5, description="how long an offered clearance can be taken (s)")
    ] = 0.5


class Exit(Section, frozen=True, kw_only=True):
    """Control after the conflict zone."""

    headway_s: Annotated[Seconds, Meta(description="headway opened before the vehicle is released (s)")] = 1.3
    distance_m: Annotated[float, Meta(ge=0, le=2000, description="way over which it is opened (m)")] = 200.0
    decel_mps2: Annotated[Decel, Meta(description="most it brakes to open the gap (m/s^2)")] = 1.5
    sight_m: Annotated[
        float,
        Meta(ge=0, le=2000, description="how far along the exit vehicles are heard; beyond, one may stand (m)"),
    ] = 250.0


class Service(Section, frozen=True, kw_only=True):
    """The control cycle and the vehicles' messages."""

    collect_s: Annotated[
        float,
        Meta(ge=0, le=0.08, description="wall clock: longest time after the grid point that states are waited for (s)"),
    ] = 0.02
    budget_s: Annotated[
        float,
        Meta(gt=0, le=0.1, description="wall clock: time of a control cycle that candidates have to fit into (s)"),
    ] = 0.06
    prompt_s: Annotated[
        float,
        Meta(
            ge=0,
            le=0.1,
            description="wall clock: a control cycle longer than this and than 1.5 times its usual time leaves out "
            "candidates, and programs end after a fifth of this and twice theirs (s)",
        ),
    ] = 0.01
    command_valid_s: Annotated[
        float, Meta(ge=0.1, le=5, description="how long a command holds without a fresh one (s)")
    ] = 0.5
    stale_s: Annotated[
        float, Meta(ge=0.2, le=60, description="silence after which an uncleared vehicle is left out (s)")
    ] = 2.0
    hold_s: Annotated[
        float,
        Meta(ge=1, le=600, description="longest a silent vehicle blocks the ground it may stand on (s)"),
    ] = 30.0
    max_vehicles: Annotated[int, Meta(ge=1, le=100_000, description="more vehicles than this are not taken in")] = 1000
    realtime: Annotated[
        bool,
        Meta(description="wall clock: go before the machine's other work (SCHED_FIFO), where the system lets us"),
    ] = True


class Parameters(Section, frozen=True, kw_only=True):
    """The whole configuration file, one table a field."""

    auction: Auction = Auction()
    planner: Planner = Planner()
    program: Program = Program()
    interlock: Interlock = Interlock()
    exit: Exit = Exit()
    service: Service = Service()
    classes: Annotated[
        dict[str, VehicleClass],
        Meta(description="bounds per vehicle class; a class not listed counts as passenger"),
    ] = msgspec.field(default_factory=_classes)
