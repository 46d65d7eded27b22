"""The whole way of a control cycle, from the last state that it waited for to the last command handed to Zenoh."""

from __future__ import annotations

from dataclasses import replace

from msgspec import structs

from gameopt_im.manager import Outcome

PUBLISH = "publish"


def measured(outcome: Outcome, closed_s: float, late_s: float | None) -> Outcome:
    """The outcome once its commands are with Zenoh, its report with the whole way and all its stages.

    The way begins at `closed_s` (`time.perf_counter`), when the last vehicle waited for was heard, or the wait ended
    without it. The wait itself (`service.collect_s`) is not work, and not part of it, though states are read in it;
    `late_s`, from the time due to the wake-up, is reported beside it. `ingest` then begins there, and `publish` where
    the commands stand, so that the stages add up to the whole way. The report is published after the commands, in the
    same control cycle.
    """
    report = outcome.report
    began_s = outcome.decided_s - 1e-3 * report.elapsed_ms
    stages_ms = dict(report.stages_ms)
    stages_ms["ingest"] += 1e3 * (began_s - closed_s)
    stages_ms[PUBLISH] = 1e3 * (outcome.published_s - outcome.decided_s)
    complete = structs.replace(
        report,
        stages_ms=stages_ms,
        whole_ms=1e3 * (outcome.published_s - closed_s),
        late_ms=None if late_s is None else 1e3 * late_s,
    )
    return replace(outcome, report=complete)
