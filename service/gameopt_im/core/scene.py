"""The scene of a control cycle: all vehicles as arrays for those who grant clearances, with every exit way driven."""

from __future__ import annotations

import numpy as np

from gameopt_im.core.conflicts import Ground
from gameopt_im.core.diverging import spans
from gameopt_im.core.interlock import EXITING, UNCLEARED, Limits
from gameopt_im.core.kinematics import NEVER, kernel
from gameopt_im.core.leading import Scene, Ways, ahead_on_exit, room_behind, ways_of
from gameopt_im.core.parameters import Exit
from gameopt_im.core.profiles import held_back
from gameopt_im.core.reservations import Book, held_in
from gameopt_im.core.snapshot import Ints, Snapshot
from gameopt_wire import motion
from gameopt_wire.messages import STEP_S


def scene_of(snapshot: Snapshot, ground: Ground, book: Book, limits: Limits, law: Exit) -> Scene:
    """The scene of a snapshot. Exit ways are driven in the book's spare rows, from the last one down.

    Exiting vehicles are commanded from here, so in the worst case they brake as rule 2 and the exit law make them, the
    first of them for a vehicle that may stand just out of sight.
    """
    ago = np.rint(snapshot.age / STEP_S).astype(np.int64)
    book.make_room(2 * len(snapshot))  # whoever exits now, and whoever is granted a clearance after this
    row = book.rows_of(snapshot.ids)
    movement = snapshot.movement
    path = ground.length[movement]
    exiting = (limits.phase == EXITING).nonzero()[0]
    exiting = exiting[(snapshot.s[exiting] + path[exiting]).argsort(kind="stable")]  # front to back
    scene = Scene(
        cycle=snapshot.cycle,
        x=-snapshot.s,
        v=snapshot.v,
        length=snapshot.length,
        a=snapshot.a_max,
        b=snapshot.b_max,
        heard_x=-snapshot.heard_s + snapshot.heard_v * (snapshot.age - STEP_S * ago),
        heard_v=snapshot.heard_v,
        ago=ago,
        uncleared=limits.phase == UNCLEARED,
        movement=movement,
        lane=snapshot.lane,
        bound=ground.exit_lane[movement],
        path=path,
        clear=ground.clear[movement],
        span=spans(snapshot.length, path, ground.turns_back[movement], ground.tail[movement, snapshot.footprint]),
        leaders=limits.leaders,
        downstream=limits.downstream,
        stranger_x=snapshot.stranger_x,
        stranger_v=snapshot.stranger_v,
        stranger_b=snapshot.stranger_b,
        floor=motion.OPENING_FLOOR * ground.exit_mps[movement],
        sight=path + np.minimum(ground.exit_length[movement], law.sight_m),
        decel=max(law.decel_mps2, motion.OPENING_DECEL_MPS2),
        apart=ground.apart,
        way=row.copy(),  # exit ways will be entered
        exiting=np.zeros(len(snapshot), dtype=np.bool_),
        asked=held_in(row, book.rows.withdrawn),
    )
    drive_exits(exiting, scene, ways_of(book.rows))
    return scene


@kernel
def drive_exits(exiting: Ints, scene: Scene, ways: Ways) -> None:
    """Fill in the ways of the vehicles `exiting`, front to back, and say in the scene who has which."""
    for n in range(exiting.shape[0]):
        i, row = exiting[n], ways.start.shape[0] - 1 - n
        ways.start[row] = scene.cycle
        held_back(
            scene.x[i], scene.v[i], ways.v[row], 0, (scene.length[i], scene.a[i], scene.b[i]), -NEVER, law_of(i, scene),
            room_behind(ahead_on_exit(i, scene), True, scene.cycle, 0, ways), ways.late_x[row], ways.late_v[row],
        )  # fmt: skip
        scene.way[i], scene.exiting[i] = row, True


@kernel
def law_of(i: int, scene: Scene) -> tuple[float, float, float]:
    """(deceleration, lowest speed) of the exit law and the end of sight for vehicle i."""
    return scene.decel, scene.floor[i], scene.sight[i]
