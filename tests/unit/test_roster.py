"""The roster: who is there, by id and in the order of zone entry."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from gameopt_im.core.bids import Priority
from gameopt_im.core.parameters import VehicleClass
from gameopt_im.roster import Roster
from gameopt_im.tracked import Body, Tracked

BODY = Body("0-1", 5.0, 1.8, "passenger")


def vehicle(name: str, entered_s: float) -> Tracked:
    return Tracked(name, BODY, entered_s, 0, 0, VehicleClass(), Priority(1.0, 1.0, 1.0))


COMERS = st.dictionaries(st.text("abc", min_size=1, max_size=2), st.floats(0.0, 2.0), max_size=8)


@given(COMERS, st.data())
def test_whoever_comes_and_goes_the_order_is_that_of_entry_then_id(
    comers: dict[str, float], data: st.DataObject
) -> None:
    roster = Roster()
    for name, entered_s in comers.items():
        roster.add(vehicle(name, entered_s))
    going = data.draw(st.sets(st.sampled_from(sorted(comers)))) if comers else set()
    roster.remove(going)
    left = sorted(comers.keys() - going, key=lambda name: (comers[name], name))
    assert [each.name for each in roster.ordered] == left == list(roster.ids)
    assert roster.by_id.keys() == set(left)
    assert len(roster) == len(left)


def test_its_ids_are_one_tuple_for_as_long_as_nobody_comes_or_goes() -> None:
    roster = Roster()
    roster.add(vehicle("a", 0.0))
    ids = roster.ids
    roster.remove([])
    assert roster.ids is ids
    roster.add(vehicle("b", 0.0))
    assert roster.ids == ("a", "b")


def test_nobody_is_there_once_it_is_cleared() -> None:
    roster = Roster()
    roster.add(vehicle("a", 0.0))
    assert roster.ids == ("a",)
    roster.clear()
    assert (len(roster), roster.ids, roster.ordered) == (0, (), [])
