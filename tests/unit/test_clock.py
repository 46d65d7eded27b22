"""The grid by itself, the wall clock on a clock made of numbers, and lock-step on messages made by hand."""

from __future__ import annotations

import asyncio
from collections.abc import Collection, Iterator, Sequence

import pytest

from gameopt_im.clock import Grid, LockStep, Tick, Upcoming, WallClock
from gameopt_im.inbox import Raw
from gameopt_wire import codec
from gameopt_wire.messages import Step

EPOCH_S = 1_700_000_000.0
EPOCH = 17_000_000_000


class Inbox:
    """A source of messages that are there already."""

    def __init__(self, *batches: list[Raw]) -> None:
        self.batches: Iterator[list[Raw]] = iter(batches)

    def drain(self) -> list[Raw]:
        return next(self.batches, [])

    async def arrival(self) -> None:
        """The next batch is always there."""

    def call_roll(self, whom: Collection[str], since_s: float) -> None:
        """Nobody answers."""

    async def all_heard(self, most_s: float) -> bool:
        raise AssertionError("nobody is waited for")


class Hands:
    """A wall clock turned by hand: sleeping moves it on, by more than asked where `oversleep` says so."""

    def __init__(self, now_s: float) -> None:
        self.now_s = now_s
        self.oversleep: list[float] = []
        self.slept: list[float] = []

    def now(self) -> float:
        return self.now_s

    async def sleep(self, seconds: float) -> None:
        self.slept.append(seconds)
        self.now_s += seconds + (self.oversleep.pop(0) if self.oversleep else 0.0)


class Speaking(Inbox):
    """A source whose vehicles have all spoken so long after the grid point; one number for each that anybody awaits."""

    def __init__(self, hands: Hands, after_s: Sequence[float], *batches: list[Raw]) -> None:
        super().__init__(*batches)
        self.whom: list[set[str]] = []
        self._hands = hands
        self._after_s = iter(after_s)
        self._at_s = 0.0

    def call_roll(self, whom: Collection[str], since_s: float) -> None:
        if whom:
            self.whom.append(set(whom))
            self._at_s = since_s + next(self._after_s)

    async def all_heard(self, most_s: float) -> bool:
        until_s = self._hands.now_s + most_s
        self._hands.now_s = max(self._hands.now_s, min(self._at_s, until_s))
        return self._at_s < until_s


def wall_clock(hands: Hands, collect_s: float = 0.02, inbox: Inbox | None = None) -> WallClock:
    return WallClock(inbox or Inbox(), collect_s, hands.now, hands.sleep)


def ticks(clock: WallClock, count: int) -> list[Tick]:
    async def run() -> list[Tick]:
        return [await clock.next_cycle() for _ in range(count)]

    return asyncio.run(run(), debug=True)


@pytest.mark.parametrize(
    ("now_s", "last", "upcoming"),
    [
        (EPOCH_S, None, Upcoming(EPOCH, 0)),  # due 20 ms after the grid point
        (EPOCH_S + 0.05, None, Upcoming(EPOCH + 1, 0)),
        (EPOCH_S + 0.03, EPOCH, Upcoming(EPOCH + 1, 0)),  # done with a control cycle in 10 ms
        (EPOCH_S + 0.11, EPOCH, Upcoming(EPOCH + 1, 0)),  # past the grid point, not yet past its moment
        (EPOCH_S + 0.13, EPOCH, Upcoming(EPOCH + 2, 1)),
        (EPOCH_S + 1.03, EPOCH, Upcoming(EPOCH + 11, 10)),
        (EPOCH_S - 0.05, EPOCH, Upcoming(EPOCH + 1, 0)),  # set back by less than a control cycle
        (EPOCH_S - 3600.0, EPOCH, Upcoming(EPOCH - 36_000, 0)),  # set back by an hour
    ],
)
def test_the_next_control_cycle_on_the_grid(now_s: float, last: int | None, upcoming: Upcoming) -> None:
    assert Grid(0.02).after(now_s, last) == upcoming


def test_a_grid_point_is_the_nearest_float_to_its_time() -> None:
    grid = Grid()
    assert [grid.time_s(EPOCH + k) for k in range(4)] == [
        EPOCH_S,
        EPOCH_S + 0.1,
        EPOCH_S + 0.2,
        EPOCH_S + 0.3,
    ]


def test_every_cycle_comes_once_when_each_is_quick() -> None:
    clock = wall_clock(Hands(EPOCH_S + 0.5))
    cycles = [tick.cycle for tick in ticks(clock, 50)]
    assert cycles == list(range(EPOCH + 5, EPOCH + 55))
    assert clock.missed == 0


def test_late_wake_ups_do_not_add_up() -> None:
    hands = Hands(EPOCH_S)
    hands.oversleep = [0.004] * 1000
    clock = wall_clock(hands)
    assert ticks(clock, 1000)[-1].cycle == EPOCH + 999
    assert hands.now_s == pytest.approx(EPOCH_S + 99.9 + 0.02 + 0.004, abs=1e-5)
    assert clock.missed == 0


def test_a_stall_is_counted_and_not_caught_up() -> None:
    hands = Hands(EPOCH_S)
    clock = wall_clock(hands)

    async def run() -> list[int]:
        first = await clock.next_cycle()
        hands.now_s += 0.55  # the control cycle takes more than half a second
        second, third = await clock.next_cycle(), await clock.next_cycle()
        return [tick.cycle - EPOCH for tick in (first, second, third)]

    assert asyncio.run(run(), debug=True) == [0, 6, 7]
    assert clock.missed == 5


def test_sleeping_through_cycles_misses_each_of_them_once() -> None:
    hands = Hands(EPOCH_S)
    hands.oversleep = [0.0, 1.05]
    clock = wall_clock(hands)
    assert [tick.cycle - EPOCH for tick in ticks(clock, 3)] == [0, 12, 13]
    assert clock.missed == 11


def test_a_clock_set_back_does_not_stand_still() -> None:
    hands = Hands(EPOCH_S)
    hands.oversleep = [0.0, -3600.0]
    clock = wall_clock(hands)
    last = ticks(clock, 3)[-1]
    assert last.time_s == pytest.approx(EPOCH_S - 3600.0, abs=1.0)
    assert max(hands.slept) <= 0.2 + 1e-6
    assert clock.missed == 0


def test_a_control_cycle_begins_once_everybody_heard_before_is_heard_again() -> None:
    hands = Hands(EPOCH_S)
    batches = [[state("a"), state("b"), Raw("bid", b"b", "c")], [state("a")], [], []]
    inbox = Speaking(hands, [0.006, 1.0], *batches)
    clock = wall_clock(hands, 0.02, inbox)
    began_s, late_s = [], []
    for tick in (ticks(clock, 1)[0] for _ in range(4)):
        began_s.append(hands.now_s - tick.time_s)
        late_s.append(clock.late_s)
    # Nobody known yet; all of two; one that stays silent; again nobody.
    assert began_s == pytest.approx([0.02, 0.006, 0.02, 0.02], abs=1e-5)
    assert inbox.whom == [{"a", "b"}, {"a"}]
    assert late_s == pytest.approx([0.0] * 4, abs=1e-5)
    assert clock.missed == 0


def test_who_spoke_while_the_last_cycle_overran_has_been_heard() -> None:
    hands = Hands(EPOCH_S)
    inbox = Speaking(hands, [0.005, 0.005], [state("a")], [state("a")])
    clock = wall_clock(hands, 0.02, inbox)
    ticks(clock, 1)
    hands.now_s += 0.09  # 10 ms into the next one
    (tick,) = ticks(clock, 1)
    assert (tick.cycle, hands.now_s) == (EPOCH + 1, pytest.approx(EPOCH_S + 0.11, abs=1e-5))


def test_when_everybody_has_left_the_next_cycle_begins_at_its_grid_point() -> None:
    hands = Hands(EPOCH_S)
    inbox = Speaking(hands, [-0.05, 1.0], [state("a")], [])
    clock = wall_clock(hands, 0.02, inbox)
    ticks(clock, 1)
    (tick,) = ticks(clock, 1)
    assert (tick.cycle, hands.now_s) == (EPOCH + 1, pytest.approx(EPOCH_S + 0.1, abs=1e-5))


def test_after_a_stall_the_states_of_the_cycle_that_is_still_to_come_are_waited_for() -> None:
    hands = Hands(EPOCH_S)
    inbox = Speaking(hands, [0.005, 0.005, 0.005], [state("a")], [state("a")])
    clock = wall_clock(hands, 0.02, inbox)
    ticks(clock, 1)
    hands.now_s += 0.5
    (tick,) = ticks(clock, 1)
    assert (tick.cycle, hands.now_s) == (EPOCH + 6, pytest.approx(EPOCH_S + 0.605, abs=1e-5))


def test_what_comes_is_read_while_others_are_waited_for() -> None:
    hands = Hands(EPOCH_S)
    first, early, last = [state("a"), state("b")], [state("a"), Raw("step", b"", "k")], [state("b")]
    newcomer = [Raw("bid", b"b", "c")]
    inbox = Speaking(hands, [0.0015, 1.0], first, early, last, newcomer)
    read: list[tuple[float, list[Raw], float]] = []

    def reader(messages: list[Raw], time_s: float) -> int:
        read.append((hands.now_s, messages, time_s))
        return len(messages)

    alone, together = ticks(WallClock(inbox, 0.02, hands.now, hands.sleep, reader), 2)
    assert (alone.messages, alone.ahead) == (first, 0)  # nobody was waited for
    assert together.messages == [state("a"), *last, *newcomer]
    assert together.ahead == 2
    assert [(messages, time_s) for _, messages, time_s in read] == [
        ([state("a")], together.time_s),
        (last, together.time_s),
    ]
    assert [at_s - together.time_s for at_s, _, _ in read] == pytest.approx([0.001, 0.0015], abs=1e-5)


def test_what_was_read_for_a_control_cycle_that_was_slept_through_is_in_the_next() -> None:
    hands = Hands(EPOCH_S)
    inbox = Speaking(hands, [1.0] * 4, [state("a")], [state("b")])
    read: list[Raw] = []

    def suspended(messages: list[Raw], time_s: float) -> int:
        read.extend(messages)
        hands.now_s += 0.5 if messages else 0.0
        return len(messages)

    clock = WallClock(inbox, 0.02, hands.now, hands.sleep, suspended)
    _, later = ticks(clock, 2)
    assert clock.missed > 0
    assert (read, later.messages) == ([state("b")], [state("b")])
    assert later.ahead == 1


def test_what_its_reader_leaves_in_a_flood_comes_with_the_control_cycle_unread() -> None:
    hands = Hands(EPOCH_S)
    first, early, last = [state("a"), state("b")], [state("a"), state("x")], [state("y"), state("b")]
    inbox = Speaking(hands, [0.0015, 1.0], first, early, last)
    _, flooded = ticks(WallClock(inbox, 0.02, hands.now, hands.sleep, lambda them, _: 2 if them == early else 0), 2)
    assert flooded.messages == early + last
    assert flooded.ahead == 2


def state(vehicle: str) -> Raw:
    return Raw("state", b"s", vehicle)


def test_a_tick_brings_the_messages_of_vehicles_and_no_steps() -> None:
    (tick,) = ticks(wall_clock(Hands(EPOCH_S), inbox=Inbox([state("k"), Raw("step", b"", "k")])), 1)
    assert tick.messages == [state("k")]


def step(cycle: int, messages: int) -> Raw:
    return Raw("step", codec.STEP.encode(Step(cycle=cycle, time_s=cycle / 10, messages=messages)), "k")


STATE, BID, GONE = Raw("state", b"s", "k"), Raw("bid", b"b", "k"), Raw("gone", b"", "k")


def test_lock_step_waits_for_the_step_and_all_its_messages() -> None:
    clock = LockStep(Inbox())
    assert clock.take([STATE]) is None
    assert clock.take([step(7, 2)]) is None
    assert clock.take([BID]) == Tick(7, 0.7, [STATE, BID], restarted=False)
    assert clock.take([STATE, BID]) is None


def test_lock_step_does_not_count_liveliness_as_a_message() -> None:
    clock = LockStep(Inbox())
    assert clock.take([step(1, 1), GONE]) is None
    tick = clock.take([STATE])
    assert tick is not None
    assert tick.messages == [GONE, STATE]


def test_lock_step_goes_on_with_an_empty_road() -> None:
    assert LockStep(Inbox()).take([step(1, 0)]) == Tick(1, 0.1, [])


def test_lock_step_says_when_time_begins_anew() -> None:
    clock = LockStep(Inbox())
    restarted = [tick.restarted for cycle in (1, 2, 1) if (tick := clock.take([step(cycle, 0)]))]
    assert restarted == [False, False, True]


def test_a_broken_step_is_counted_and_the_next_one_holds() -> None:
    clock = LockStep(Inbox())
    assert clock.take([Raw("step", b"\xc1", "k")]) is None
    assert clock.take([step(3, 1), step(4, 0)]) == Tick(4, 0.4, [])
    assert clock.rejected == {"malformed": 1}


def test_lock_step_reads_on_until_the_cycle_is_complete() -> None:
    clock = LockStep(Inbox([], [STATE], [step(1, 2)], [BID]))
    assert asyncio.run(clock.next_cycle(), debug=True) == Tick(1, 0.1, [STATE, BID])


def test_messages_that_no_step_comes_for_are_held_only_so_many(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gameopt_im.clock.MAX_HELD", 3)
    clock = LockStep(Inbox())
    strays = [Raw("state", b"", f"stray {k}", -1) for k in range(10)]
    for stray in strays:
        assert clock.take([stray]) is None
    assert clock.rejected == {"overflow": 7}
    assert clock.take([step(1, 0)]) == Tick(1, 0.1, strays[-3:])


def test_a_tick_says_how_long_it_is_to_the_next_grid_point() -> None:
    hands = Hands(EPOCH_S + 0.001)
    hands.oversleep = [0.0, 0.03]
    in_time, late = ticks(wall_clock(hands), 2)
    assert in_time.left_s == pytest.approx(0.08, abs=1e-3)
    assert late.left_s == pytest.approx(0.05, abs=1e-3)
