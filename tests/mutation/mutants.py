"""The mutants: one wrong edit each, and the test that has to notice it."""

from __future__ import annotations

from typing import NamedTuple


class Mutant(NamedTuple):
    """`old` occurs once in `file` and becomes `new`; `test` fails then."""

    name: str
    file: str
    old: str
    new: str
    test: str


MOTION = "service/gameopt_wire/motion.py"
CORE = "service/gameopt_im/core"
UNIT = "tests/unit"

MUTANTS = (
    Mutant(
        "rule 1 without its offset",
        MOTION,
        "brake_speed(s_m - STOP_OFFSET_M, v_mps",
        "brake_speed(s_m, v_mps",
        f"{UNIT}/test_motion.py::test_an_uncleared_vehicle_stops_before_the_line",
    ),
    Mutant(
        "the way of the coming step counted twice over",
        MOTION,
        "(room_m - 0.5 * v_mps * dt_s)",
        "(room_m + 0.5 * v_mps * dt_s)",
        f"{UNIT}/test_motion.py::test_a_follower_stops_behind_a_braking_leader",
    ),
    Mutant(
        "rule 3 past the line",
        MOTION,
        "brake_speed(s_m, v_mps, min(TURN_DECEL_MPS2, b_mps2)",
        "brake_speed(s_m + 2.0, v_mps, min(TURN_DECEL_MPS2, b_mps2)",
        f"{UNIT}/test_motion.py::test_the_turning_speed_is_reached_at_the_line",
    ),
    Mutant(
        "rule 2 with the stronger brake",
        MOTION,
        "b = min(b_mps2, lead_b_mps2)",
        "b = max(b_mps2, lead_b_mps2)",
        f"{UNIT}/test_motion.py::test_the_weaker_brake_counts",
    ),
    Mutant(
        "no margin in seconds",
        f"{CORE}/windows.py",
        "after = max(margin_s, margin_m / mine[2]",
        "after = max(0.0, margin_m / mine[2]",
        f"{UNIT}/test_granting.py::test_the_margin_in_seconds_counts_before_and_after",
    ),
    Mutant(
        "no margin in metres",
        f"{CORE}/windows.py",
        "before = max(margin_s, margin_m / other[2], margin_m / mine[3])",
        "before = margin_s",
        f"{UNIT}/test_granting.py::test_the_margin_in_metres_counts_at_the_slower_speed",
    ),
    Mutant(
        "a worst case without leaders",
        f"{CORE}/profiles.py",
        "u = max(0.0, late_v[k] - b * STEP_S, min(u, rule))",
        "u = max(0.0, late_v[k] - b * STEP_S, u)",
        f"{UNIT}/test_granting.py::test_the_worst_case_is_slower_behind_a_braking_leader",
    ),
    Mutant(
        "rule 2 always possible",
        f"{CORE}/profiles.py",
        "possible = False",
        "possible = True",
        f"{UNIT}/test_granting.py::test_a_drive_that_cannot_keep_rule_2_is_refused",
    ),
    Mutant(
        "clashes overlooked",
        f"{CORE}/reservations.py",
        "worst = max(worst, overlap(me, other, margin_s, margin_m))",
        "worst = min(worst, overlap(me, other, margin_s, margin_m))",
        f"{UNIT}/test_granting.py::test_who_would_clash_without_a_slot_is_refused",
    ),
    Mutant(
        "a follower cleared before its leader",
        f"{CORE}/granting.py",
        "if limits.unheard[i] or not _leader_cleared(snapshot, book, limits, i):",
        "if limits.unheard[i]:",
        f"{UNIT}/test_granting.py::test_a_follower_is_cleared_only_after_its_leader_has_accepted",
    ),
    Mutant(
        "a worst case behind leaders at their best",
        f"{CORE}/granting.py",
        "worst = room_behind(ahead, True, scene.cycle, HORIZON, ways)",
        "worst = room_behind(ahead, False, scene.cycle, HORIZON, ways)",
        f"{UNIT}/test_granting.py::test_a_follower_reserves_for_its_leaders_worst_case",
    ),
    Mutant(
        "worst cases brought up to date behind leaders at their best",
        f"{CORE}/worst_cases.py",
        "room_behind(ahead_of(i, scene), True,",
        "room_behind(ahead_of(i, scene), False,",
        f"{UNIT}/test_worst_cases.py::test_on_a_clearance",
    ),
    Mutant(
        "exit ways behind leaders at their best",
        f"{CORE}/scene.py",
        "room_behind(ahead_on_exit(i, scene), True,",
        "room_behind(ahead_on_exit(i, scene), False,",
        f"{UNIT}/test_worst_cases.py::test_on_the_exit",
    ),
    Mutant(
        "late vehicles that nobody gives way to",
        f"{CORE}/withdrawal.py",
        "near[a, b] = overlap(one, other, margin_s, margin_m) > 0.0",
        "near[a, b] = False",
        f"{UNIT}/test_withdrawal.py::test_the_later_of_two_that_come_too_near_gives_way",
    ),
    Mutant(
        "ground freed on the asking",
        f"{CORE}/decision.py",
        "elif accepted and says[i] == NONE and may_drop:",
        "elif accepted and may_drop:",
        f"{UNIT}/test_decision.py::test_a_clearance_asked_back_is_free_once_its_vehicle_says_so",
    ),
    Mutant(
        "clearances dropped by who cannot stop",
        "vehicle_agents/gameopt_vehicles/agent.py",
        "if driving.can_stop(seen, self._setback_m):",
        "if True:",
        f"{UNIT}/test_vehicles_offers.py::test_who_cannot_stop_any_more_keeps_it",
    ),
    Mutant(
        "a slip that is never made good",
        f"{CORE}/decision.py",
        "planned[i] = motion.tracking_speed(ahead, rows.x[r, k] + s[i])",
        "planned[i] = ahead",
        f"{UNIT}/test_decision.py::test_who_is_behind_its_profile_may_catch_up",
    ),
    Mutant(
        "offers of silent vehicles lapse",
        f"{CORE}/decision.py",
        "expired = time_s - age[i] > rows.expires_s[r] + 1e-6",
        "expired = time_s > rows.expires_s[r] + 1e-6",
        f"{UNIT}/test_decision.py::test_a_silent_vehicle_keeps_its_ground",
    ),
    Mutant(
        "ground freed on a prediction",
        f"{CORE}/decision.py",
        "snapshot.accepted, snapshot.heard_s,",
        "snapshot.accepted, snapshot.s,",
        f"{UNIT}/test_decision.py::test_the_ground_is_free_once_the_rear_has_left_it",
    ),
    Mutant(
        "phases by prediction",
        f"{CORE}/interlock.py",
        "snapshot.heard_s, snapshot.length, snapshot.accepted, snapshot.movement, accepted,",
        "snapshot.s, snapshot.length, snapshot.accepted, snapshot.movement, accepted,",
        f"{UNIT}/test_silence.py::test_a_phase_follows_from_what_was_heard",
    ),
    Mutant(
        "silent leaders taken to go on",
        f"{CORE}/leaders.py",
        "gap = worst_x[j] + offset[j]",
        "gap = x[j] + offset[j]",
        f"{UNIT}/test_silence.py::test_a_follower_keeps_rule_2_behind_where_its_leader_may_be",
    ),
    Mutant(
        "a follower cleared behind a vehicle never heard",
        f"{CORE}/granting.py",
        "if limits.unheard[i] or not",
        "if not",
        f"{UNIT}/test_silence.py::test_nobody_is_cleared_behind_a_vehicle_that_was_never_heard",
    ),
    Mutant(
        "worst cases improved without news",
        f"{CORE}/worst_cases.py",
        "if not scene.fresh[i] or scene.exiting[i] or k",
        "if scene.exiting[i] or k",
        f"{UNIT}/test_silence.py::test_a_worst_case_is_brought_up_to_date_only_from_fresh_states",
    ),
    Mutant(
        "those who come after held up",
        f"{CORE}/followers.py",
        "if not _keeps_behind(book.row[vehicle], held.b, clear, *lead, cycle, ways_of(book.rows)):",
        "if False:",
        f"{UNIT}/test_followers.py::test_a_new_clearance_may_not_slow_down_who_comes_after_on_the_exit",
    ),
    Mutant(
        "who has turned off still leads",
        f"{CORE}/leaders.py",
        "parted = worst_x[j] - length[j] >= apart[movement[i], movement[j]]",
        "parted = False",
        f"{UNIT}/test_diverging.py::test_who_has_turned_off_leads_no_more",
    ),
    Mutant(
        "tails that swing out",
        f"{CORE}/diverging.py",
        "np.where(turns_back, np.maximum(0.0, length - path_m), tail_m)",
        "np.where(turns_back, np.maximum(0.0, length - path_m), 0.0)",
        f"{UNIT}/test_diverging.py::test_a_body_too_long_for_the_turn_is_longer_to_those_behind",
    ),
    Mutant(
        "one who turns off hides whom he follows",
        f"{CORE}/leaders.py",
        "r = rank[movement[j]]",
        "r = 0",
        f"{UNIT}/test_diverging.py::test_one_who_is_about_to_turn_off_hides_nobody",
    ),
    Mutant(
        "strangers are trusted to go on",
        f"{CORE}/leading.py",
        "x = x + v * moving - 0.5 * number[B] * (moving * moving)",
        "x = x + v * time",
        f"{UNIT}/test_granting.py::test_nobody_is_cleared_into_a_queue_of_strangers",
    ),
    Mutant(
        "silent vehicles overtake",
        f"{CORE}/interlock.py",
        "lane_leaders(snapshot.lane, movement, x, worst_x, span, ground.apart, ground.rank)",
        "lane_leaders(snapshot.lane, movement, x, x, span, ground.apart, ground.rank)",
        f"{UNIT}/test_silence.py::test_who_is_silent_is_not_taken_to_have_overtaken",
    ),
    Mutant(
        "a platoon on the exit stops itself",
        "vehicle_agents/gameopt_vehicles/driving.py",
        "slowest = max(seen.speed_mps - motion.OPENING_DECEL_MPS2 * STEP_S, motion.OPENING_FLOOR * exit_speed_mps)",
        "slowest = seen.speed_mps - motion.OPENING_DECEL_MPS2 * STEP_S",
        f"{UNIT}/test_vehicles_agent.py::test_on_the_exit_lane_the_radar_overrules_the_manager_and_gaps_open_gently",
    ),
    Mutant(
        "a silent vehicle predicted past its setback",
        f"{CORE}/tracking.py",
        "setback[i] + STOP_OFFSET_M",
        "STOP_OFFSET_M",
        f"{UNIT}/test_tracker_aging.py::test_an_uncleared_vehicle_is_predicted_to_stop_before_its_setback",
    ),
    Mutant(
        "commands past the point of no return",
        "vehicle_agents/gameopt_vehicles/driving.py",
        "if seen.distance_m > 0.0 and not may_cross:",
        "if False:",
        f"{UNIT}/test_vehicles_agent.py::test_no_command_takes_an_uncleared_vehicle_past_the_point_of_no_return",
    ),
    Mutant(
        "offers taken that cannot be kept to",
        "vehicle_agents/gameopt_vehicles/driving.py",
        "widest_m = max(widest_m, abs(drift_m))",
        "pass",
        f"{UNIT}/test_vehicles_offers.py::test_an_offer_is_taken_only_at_a_speed_that_the_vehicle_soon_has",
    ),
    Mutant(
        "rule 1's tolerance the wrong way",
        f"{CORE}/interlock.py",
        "motion.STOP_OFFSET_M + 0.05",
        "motion.STOP_OFFSET_M - 0.05",
        f"{UNIT}/test_granting.py::test_rule_1s_curve_parts_the_uncleared_from_the_intruding",
    ),
    Mutant(
        "rule 3 left out of the interlock",
        f"{CORE}/interlock.py",
        "np.minimum(limits_.turn, limits_.top)",
        "limits_.top",
        f"{UNIT}/test_granting.py::test_the_interlock_bounds_every_speed",
    ),
    Mutant(
        "turns paid with one's own bid",
        f"{CORE}/auction.py",
        "np.append(bids[1:], 0.0)[: len(bids)]",
        "bids",
        f"{UNIT}/test_auction.py::test_payment_is_what_those_behind_lose",
    ),
    Mutant(
        "an overflow bound that costs nothing",
        f"{CORE}/auction.py",
        "(1.0 - alpha[passed[r]]) - cost[r].sum()",
        "(1.0 - alpha[passed[r]])",
        f"{UNIT}/test_auction.py::test_a_blocked_bid_passes_a_share_of_its_bound_to_the_one_ahead",
    ),
    Mutant(
        "a rear-end row without the leader's length",
        f"{CORE}/program.py",
        "(s[lead] - s[follow] + vehicles.length[lead] + gap_m)",
        "(s[lead] - s[follow] + gap_m)",
        f"{UNIT}/test_program.py::test_rear_end_rows_hold_where_the_gap_does",
    ),
    Mutant(
        "a lateral row without the first one's length",
        f"{CORE}/program.py",
        "reach = z + vehicles.length + margin_m",
        "reach = z + margin_m",
        f"{UNIT}/test_program.py::test_lateral_rows_hold_where_the_first_is_through_in_time",
    ),
    Mutant(
        "a box that may be empty",
        f"{CORE}/program.py",
        "return lower, np.maximum(upper, lower)",
        "return lower, upper",
        f"{UNIT}/test_program.py::test_boxes_are_the_tighter_of_limit_and_reach",
    ),
    Mutant(
        "a reduction that drops nothing",
        f"{CORE}/program.py",
        "seen |= reached[j] | (1 << j)",
        "seen |= 1 << j",
        f"{UNIT}/test_program.py::test_the_reduction_drops_what_a_chain_implies",
    ),
    Mutant(
        "a corridor without the start-up",
        f"{CORE}/corridor.py",
        "return least, s - (line * run - 0.5 * a * run**2)",
        "return least, s - line * run",
        f"{UNIT}/test_horizon.py::test_the_corridor_by_hand",
    ),
    Mutant(
        "more acceleration than there is",
        f"{CORE}/corridor.py",
        "max(a[i] * blocks[k], speed - before)",
        "max(b[i] * blocks[k], speed - before)",
        f"{UNIT}/test_horizon.py::test_the_boxes_are_limits_and_reach",
    ),
    Mutant(
        "a rear-end bound that ignores the leader's length",
        f"{CORE}/corridor.py",
        "gap = s[i] - s[i - 1] - length[i - 1] - rear_gap",
        "gap = s[i] - s[i - 1] - rear_gap",
        f"{UNIT}/test_horizon.py::test_a_follower_keeps_its_distance",
    ),
    Mutant(
        "dispatch blind to how long ground is kept",
        f"{CORE}/dispatch.py",
        "- rules.hold_weight * hold(car, course.exit_m[i], line[i])",
        "",
        f"{UNIT}/test_slots.py::test_a_turn_that_would_part_a_platoon_waits_for_what_it_costs",
    ),
    Mutant(
        "a stop sign that later ones pass",
        f"{CORE}/standing.py",
        "if np.isnan(met).all():",
        "if True:",
        f"{UNIT}/test_standing.py::test_nobody_asks_whom_somebody_before_it_is_in_the_way_of",
    ),
    Mutant(
        "an optimum whose rows bind in the other order",
        "service/gameopt_im/solver/joint_order.py",
        "model.addCons(left - most * (1 - active) <= slack)",
        "model.addCons(left - most * active <= slack)",
        f"{UNIT}/test_joint.py::test_the_answer_is_the_best_of_all_orders_that_keep_the_lanes[4-3]",
    ),
)
