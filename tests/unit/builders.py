"""Small things the unit tests share: a four-arm map by hand, traffic on it, programs and snapshots of it."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gameopt_im.core import decision, interlock, program
from gameopt_im.core.conflicts import PAPER_GROUPS, ground
from gameopt_im.core.decision import Picture
from gameopt_im.core.interlock import Limits
from gameopt_im.core.kinematics import NEVER
from gameopt_im.core.leading import Room, room_of
from gameopt_im.core.parameters import Parameters
from gameopt_im.core.program import Traffic
from gameopt_im.core.reservations import Book
from gameopt_im.core.snapshot import Snapshot
from gameopt_im.core.windows import HORIZON
from gameopt_wire.intersection import (
    ConflictArea,
    Footprint,
    Intention,
    IntersectionMap,
    Lane,
    Movement,
)

INTENTIONS: tuple[Intention, ...] = ("right", "straight", "left")
GROUPS = [f"{road}-{way}" for road, way in itertools.product(range(4), range(3))]
"""The movements of `four_arm`, in order: movement 3 x + y is the paper's group x-y, on a lane of its own."""
CAR = Footprint(name="car", length_m=5.0, width_m=2.0)
TRUCK = Footprint(name="truck", length_m=12.0, width_m=2.5)
CONFLICT: NDArray[np.bool_] = np.array(
    [[a in PAPER_GROUPS and b in PAPER_GROUPS and a != b and b not in PAPER_GROUPS[a] for b in GROUPS] for a in GROUPS]
)
"""The paper's table as a matrix over `GROUPS`."""


def window(entry_m: float) -> list[list[tuple[float, float] | None]]:
    """Windows 4 m long for cars; trucks touch 1 m earlier and leave 2 m later, once for each truck."""
    return [[(entry_m - f - g, entry_m + 4.0 + 2.0 * (f + g)) for g in range(2)] for f in range(2)]


def movement(number: int, **changes: Any) -> Movement:
    """Movement `number` of `four_arm`."""
    values: dict[str, Any] = {
        "id": GROUPS[number],
        "group": GROUPS[number],
        "lane": number,
        "exit_lane": f"exit {number}",
        "exit_speed_mps": 20.0,
        "exit_length_m": 200.0,
        "intention": INTENTIONS[number % 3],
        "length_m": 20.0 + number,
        "clear_m": 22.0,
        "turn_speed_mps": None if number % 3 == 1 else 8.0 + number % 3,
        "path": [(0.0, 0.0), (10.0, 0.0)],
    }
    return Movement(**(values | changes))


def area(a: int, b: int, **changes: Any) -> ConflictArea:
    """Where movements a < b cross: for two cars from 4 + a m on the first and from 4 + b m on the other."""
    values: dict[str, Any] = {
        "a": a,
        "b": b,
        "merge": False,
        "a_windows_m": window(4.0 + a),
        "b_windows_m": window(4.0 + b),
    }
    return ConflictArea(**(values | changes))


def four_arm(**changes: Any) -> IntersectionMap:
    """The paper's intersection: twelve movements, each on its own lane, conflicting as in its table."""
    values: dict[str, Any] = {
        "intersection": "test",
        "control_zone_m": 150.0,
        "lanes": [Lane(id=f"lane {i}", approach=i // 3, speed_limit_mps=20.0 - i % 3, zone_m=150.0) for i in range(12)],
        "movements": [movement(i) for i in range(12)],
        "footprints": [CAR, TRUCK],
        "areas": [area(int(a), int(b)) for a, b in np.argwhere(np.triu(CONFLICT))],
    }
    return IntersectionMap(**(values | changes))


def traffic(**columns: Any) -> Traffic:
    """Vehicles by column; what is not given is that of a car of its own lane, going straight on road 0."""
    n = len(columns["s"])
    default: dict[str, Any] = {
        "v": np.full(n, 10.0),
        "length": np.full(n, 5.0),
        "a_max": np.full(n, 2.6),
        "b_max": np.full(n, 4.5),
        "v_max": np.full(n, 20.0),
        "speed_priority": np.ones(n),
        "variation_priority": np.ones(n),
        "movement": np.ones(n, dtype=np.int64),
        "lane": np.arange(n),
    }
    given = {name: np.asarray(value, dtype=default.get(name, np.ones(1)).dtype) for name, value in columns.items()}
    return Traffic(**(default | given))


def random_traffic(n: int, seed: int) -> tuple[Traffic, NDArray[np.int64]]:
    """Dense traffic on `four_arm`, some of it past the line, and a sequence that respects the lanes."""
    rng = np.random.default_rng(seed)
    lane = rng.integers(0, 12, n)
    place = np.array([np.count_nonzero(lane[:i] == lane[i]) for i in range(n)], dtype=np.float64)
    truck = rng.random(n) < 0.2
    vehicles = traffic(
        s=rng.uniform(-3.0, 12.0, n) + 18.0 * place,
        v=rng.uniform(0.0, 18.0, n),
        length=np.where(truck, 12.0, 5.0),
        a_max=np.where(truck, 1.0, 2.6),
        speed_priority=rng.choice([0.8, 1.2, 5.0], n),
        variation_priority=np.where(truck, 2.5, 1.0),
        movement=lane,
        lane=lane,
    )
    return vehicles, np.lexsort((rng.random(n), place))


def paper_program(vehicles: Traffic, order: NDArray[np.int64], *, elastic: bool = True) -> program.QP:
    """The paper's program with its own constants: lambda 0.7, M_sr 2 m, M_sl 25 m, reduced rows."""
    rear_end = program.rear_end_rows(vehicles, 2.0, 0.1)
    lateral = program.lateral_rows(vehicles, order, CONFLICT, 25.0, 0.1, reduced=True)
    return program.assemble(vehicles, 0.7, 0.1, rear_end, lateral, elastic=elastic)


GROUND = ground(four_arm(), "areas", 25.0, turn_speed=True)
ACROSS, OTHER = 1, 7
"""Two movements straight on that cross: windows [5, 9] m on the first, [11, 15] m on the second."""


def snapshot(**columns: Any) -> Snapshot:
    """Cars by column, each on the lane of its movement; what is not given is that of a fresh car going straight on."""
    n = len(columns["s"])
    movements = np.asarray(columns.pop("movement", [ACROSS] * n), dtype=np.int64)
    values: dict[str, Any] = {
        "cycle": 0, "time_s": 0.0, "ids": tuple("abcdefgh"[:n]), "v": np.full(n, 10.0), "length": np.full(n, 5.0),
        "a_max": np.full(n, 2.6), "b_max": np.full(n, 4.5), "v_max": np.full(n, 19.0), "movement": movements,
        "lane": movements, "footprint": np.zeros(n, dtype=np.int64), "waited": np.zeros(n),
        "assertiveness": np.ones(n), "speed_priority": np.ones(n), "variation_priority": np.ones(n),
        "accepted": np.full(n, -1), "silent": np.zeros(n, dtype=np.bool_), "age": np.zeros(n),
        "gap": np.full(n, np.inf),
        "stranger_x": np.full(n, NEVER), "stranger_v": np.zeros(n), "stranger_b": np.ones(n),
    }  # fmt: skip
    values |= {k: v if np.isscalar(v) else np.asarray(v) for k, v in columns.items()}
    return Snapshot(**({"heard_s": values["s"], "heard_v": values["v"]} | values))


def limits_of(cars: Snapshot, book: Book) -> Limits:
    return interlock.limits(cars, GROUND, book, Parameters().exit)


def picture_of(cars: Snapshot, book: Book) -> Picture:
    return decision.picture(cars, GROUND, book, Parameters())


def behind(room: NDArray[np.float64], v: NDArray[np.float64]) -> Room:
    """One leader that leaves this much room and drives at v, step by step."""
    made: Room = room_of(room, v, 4.5, 0.0, -NEVER)
    return made


def braking(x0: float, v0: float, b: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(x, v) of a vehicle that brakes fully from now."""
    times = np.arange(HORIZON) * 0.1
    moving = np.minimum(times, v0 / b)
    return x0 + v0 * moving - 0.5 * b * moving**2, np.maximum(0.0, v0 - b * times)
