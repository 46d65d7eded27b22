"""Every metric with its type, labels and meaning, read off what `/metrics` serves."""

from __future__ import annotations

import sys

from prometheus_client import Metric

from gameopt_im.vitals import Vitals
from gameopt_im.web import metrics

_HEAD = """# Metrics, health, logs

`gameopt-im serve` has a web server of its own. It listens on 127.0.0.1:8080, for this machine alone; `--http
HOST:PORT` puts it somewhere else, `--http off` nowhere. Whoever reaches it can read it: there is no password, so
give it an address that only those reach who may, or a proxy that asks. Nothing can be changed through it. Where
another program has port 8080, the manager warns and runs without; an address that was asked for and cannot be had
ends it with exit 2.

| path | what it answers |
| --- | --- |
| `/` | the [live page](live-page.md) for a browser, one line for anybody else |
| `/metrics` | everything below, for Prometheus; OpenMetrics for who asks for it |
| `/healthz` | 200 while the control loop runs, 503 and the reason where it does not |
| `/readyz` | 200 while it is healthy, announced on Zenoh, and its solver processes are warm; else 503 and the reason |

The control loop does not run when, at the wall clock, no control cycle has begun or ended for 1 s. In lock-step,
waiting for a simulator is healthy; a control cycle that has been under way for 10 s is not.
While the first start on a machine compiles, for about a minute, requests wait: give a liveness probe that long.
Metrics are written between control cycles: a request that comes within one waits for its end, half a second at most.

## Scrape it

```yaml
scrape_configs:
  - job_name: gameopt
    scrape_interval: 5s
    static_configs:
      - targets: ["127.0.0.1:8080"]
```

One target is one intersection; `gameopt_manager_info` says which. `deploy/` has the rest:

- `prometheus/prometheus.yml`, for a manager that a container network knows as `manager`, with `prometheus/alerts.yml`;
- `grafana/dashboards/gameopt.json`, a dashboard for one or several managers, and `grafana/provisioning/`, which puts
  it and the data source in place.

## Alerts

| alert | when |
| --- | --- |
| `GameoptDown` | no answer for 15 s |
| `GameoptNotReady` | still starting after two minutes |
| `GameoptMissedControlCycles` | a control cycle was missed in the last minute |
| `GameoptControlCycleOverBudget` | p99 above 50 ms, half of what there is, over five minutes |
| `GameoptSolverFailures` | more than one program in twenty failed or late |
| `GameoptLostWorkers` | a solver process ended on its own in the last five minutes |
| `GameoptVehiclesOnFallback` | vehicles drove on their own for more than a vehicle second in the last minute |
| `GameoptNoVehiclesHeard` | messages arrive, and no vehicle is present for 30 s |

## Logs

On stderr, with `--log-format json` as one JSON object a line. Each has `time` (ISO 8601, UTC), `level` and `event`;
what else it has depends on the event. A traceback is a string in `exception`. What libraries log is there with their
name in `logger`, Python's warnings too. The one line with which a manager refuses to start (exit 2) is plain text.

## Metrics

Base units. Counters run from the start of the manager, gauges are those of the last control cycle, and no label is a
vehicle's id.

"""
_FOOT = """
The bounds of the histograms, s: {bounds}.

This page is generated: `python -m gameopt_im.web.reference > docs/metrics.md`.
"""


def reference() -> str:
    """The whole page, Markdown."""
    vitals = Vitals("wall")
    vitals.stages.observe("a stage", 0.0)  # so that the labels show
    manager = metrics.ManagerCollector(vitals, dict.fromkeys(metrics.ABOUT, ""))
    rows = [_row(metric) for metric in metrics.Everything(manager, metrics.PROCESS.collect()).collect()]
    head = ["| metric | type | labels | meaning |", "| --- | --- | --- | --- |"]
    bounds = vitals.stages.snapshot()["a stage"].bounds
    return _HEAD + "\n".join([*head, *rows, ""]) + _FOOT.format(bounds=", ".join(f"{bound:g}" for bound in bounds))


def _row(metric: Metric) -> str:
    name = metric.name + {"counter": "_total", "info": "_info"}.get(metric.type, "")
    labels = sorted({label for sample in metric.samples for label in sample.labels} - {"le"})
    told = metric.documentation.rstrip(".")
    return f"| `{name}` | {metric.type} | {', '.join(f'`{label}`' for label in labels)} | {told} |"


if __name__ == "__main__":
    sys.stdout.write(reference())
