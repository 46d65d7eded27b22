"""Order and speeds in one problem: the mixed-integer program that the paper takes apart, as data for a solver.

`eq: lateral_collision` asks for an order of each conflicting pair, and the paper fixes all of them by an auction before
it solves `eq:J2`. Here the orders are variables: x_ij = 1 puts i before j, and the lateral row i-j of
`program.lateral_rows` binds only then. Speeds, boxes, rear-end rows, slacks and their penalties are those of
`program.assemble` on full lateral rows, so that objectives compare. With reduced rows the set of rows would depend on
the order in a way that no linear row can say.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gameopt_im.core import program
from gameopt_im.core.parameters import Program
from gameopt_im.core.program import QP, Rows, Traffic
from gameopt_im.core.snapshot import Bools, Floats, Ints


@dataclass(frozen=True, slots=True)
class Joint:
    """min sum_i quadratic_i u_i^2 / 2 + linear_i u_i + constant + penalties, over speeds (n,) and orders; m/s.

    `rear_end` always bind; each of the m rows `lateral` where its source goes before its target: then its left side,
    between `least` and `most` (m,) within the boxes, has to stay below its slack.
    `before` (n, n) marks who goes before whom in every order: lanes are kept, and who is inside is through first.
    """

    quadratic: Floats
    linear: Floats
    constant: float
    lower: Floats
    upper: Floats
    rear_end: Rows
    lateral: Rows
    least: Floats
    most: Floats
    before: Bools

    def __len__(self) -> int:
        return len(self.lower)

    @property
    def free(self) -> Bools:
        """(n, n), symmetric: the pairs whose order is to be chosen, those that conflict and those between them."""
        named = np.zeros(len(self), dtype=np.bool_)
        named[self.ordered] = True
        return np.asarray(named[:, None] & named & ~self.before & ~self.before.T & ~np.eye(len(self), dtype=np.bool_))

    @property
    def ordered(self) -> Ints:
        """The vehicles whose place in the order matters: those that some lateral row names."""
        return np.unique(np.concatenate((self.lateral.source, self.lateral.target)))


def joint(vehicles: Traffic, conflict: Bools, settings: Program, dt_s: float) -> Joint:
    """The problem of these vehicles, `conflict` (M, M) being the movements' matrix."""
    quadratic, linear, constant = program.objective(vehicles, settings.lambda_)
    lower, upper = program.boxes(vehicles, dt_s)
    before = always_before(vehicles, dt_s)
    lateral = _possible(vehicles, conflict, settings.lateral_margin_m, dt_s, before)
    return Joint(
        quadratic=quadratic,
        linear=linear,
        constant=constant,
        lower=lower,
        upper=upper,
        rear_end=program.rear_end_rows(vehicles, settings.rear_gap_m, dt_s),
        lateral=lateral,
        least=lateral.c_target * lower[lateral.target] - lateral.c_source * upper[lateral.source] - lateral.bound,
        most=lateral.c_target * upper[lateral.target] - lateral.c_source * lower[lateral.source] - lateral.bound,
        before=before,
    )


def always_before(vehicles: Traffic, dt_s: float) -> Bools:
    """(n, n) who goes before whom in every order that counts: in a lane from the front, and from inside the zone."""
    inside = vehicles.s - 0.5 * dt_s * vehicles.v <= 0.0
    place = np.empty(len(vehicles), dtype=np.int64)
    place[np.argsort(vehicles.s, kind="stable")] = np.arange(len(vehicles))
    ahead = (vehicles.lane[:, None] == vehicles.lane) & (place[:, None] < place)
    return np.asarray((inside[:, None] & ~inside) | (ahead & (inside[:, None] == inside)))


def _possible(vehicles: Traffic, conflict: Bools, margin_m: float, dt_s: float, before: Bools) -> Rows:
    """The lateral rows of all orders: those of any one order and of its reverse, less those of no order that counts."""
    some = np.arange(len(vehicles))
    both = program.join(
        *(program.lateral_rows(vehicles, each, conflict, margin_m, dt_s, reduced=False) for each in (some, some[::-1]))
    )
    _, first = np.unique(both.source * len(vehicles) + both.target, return_index=True)
    kept = first[~before[both.target[first], both.source[first]]]
    return Rows(*(getattr(both, name)[kept] for name in Rows.__dataclass_fields__))


def in_order(vehicles: Traffic, order: Ints, conflict: Bools, settings: Program, dt_s: float) -> QP:
    """The paper's program for one order (n,), on full lateral rows: what the joint problem is once that is chosen."""
    rear_end = program.rear_end_rows(vehicles, settings.rear_gap_m, dt_s)
    lateral = program.lateral_rows(vehicles, order, conflict, settings.lateral_margin_m, dt_s, reduced=False)
    return program.assemble(vehicles, settings.lambda_, dt_s, rear_end, lateral)
