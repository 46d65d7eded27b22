"""The dashboard, the alerts and the page about metrics, against what the manager exposes."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest
import yaml

from gameopt_im.vitals import WHOLE, Vitals
from gameopt_im.web import reference
from gameopt_im.web.metrics import ABOUT, PROCESS, Everything, ManagerCollector

ROOT = Path(__file__).parents[2]
DEPLOY = ROOT / "deploy"
PAGE = ROOT / "docs" / "metrics.md"
OF_PROMETHEUS = {"job", "instance", "le"}
"""Labels that the scraper adds, or that every histogram has."""


def read(path: str) -> Any:
    text = (DEPLOY / path).read_text(encoding="utf-8")
    return json.loads(text) if path.endswith(".json") else yaml.safe_load(text)


DASHBOARD = read("grafana/dashboards/gameopt.json")
ALERTS = [rule for group in read("prometheus/alerts.yml")["groups"] for rule in group["rules"]]
EXPRESSIONS = {rule["alert"]: rule["expr"] for rule in ALERTS} | {
    f"{panel['title']} {target['refId']}": target["expr"]
    for panel in DASHBOARD["panels"]
    for target in panel["targets"]
}


def exposed() -> dict[str, set[str]]:
    """The labels of every name that can be asked for."""
    vitals = Vitals("wall")
    for stage in (WHOLE, "ingest"):
        vitals.stages.observe(stage, 0.01)
    everything = Everything(ManagerCollector(vitals, dict.fromkeys(ABOUT, "")), PROCESS.collect())
    return {sample.name: set(sample.labels) for metric in everything.collect() for sample in metric.samples}


@pytest.mark.parametrize("expression", EXPRESSIONS.values(), ids=EXPRESSIONS.keys())
def test_what_is_asked_for_is_exposed(expression: str) -> None:
    known = exposed() | {"up": set()}
    names = set(re.findall(r"\b(?:gameopt_\w+|up)\b(?!\")", expression))
    assert names
    assert names <= set(known)
    matched = re.findall(r"(\w+)\s*(?:=~|!~|!=|=)\s*\"", expression)
    grouped = [label.strip() for by in re.findall(r"\bby\s*\(([^)]*)\)", expression) for label in by.split(",")]
    assert {*matched, *grouped} <= set.union(OF_PROMETHEUS, *(known[name] for name in names))


def test_every_metric_of_ours_is_asked_for_somewhere() -> None:
    def base(name: str) -> str:
        return re.sub(r"_(bucket|count|sum)$", "", name)

    asked = {base(name) for expression in EXPRESSIONS.values() for name in re.findall(r"\bgameopt_\w+", expression)}
    ours = {base(name) for name in exposed() if not name.startswith("gameopt_process_")}
    assert ours - {"gameopt_manager_info"} <= asked


def test_an_unknown_metric_would_be_noticed() -> None:
    with pytest.raises(AssertionError):
        test_what_is_asked_for_is_exposed("rate(gameopt_vehicles_flying_total[1m]) > 0")
    with pytest.raises(AssertionError):
        test_what_is_asked_for_is_exposed('gameopt_vehicles{colour="red"} > 0')


def test_every_alert_says_what_it_is_and_what_to_do() -> None:
    assert len({rule["alert"] for rule in ALERTS}) == len(ALERTS) >= 6
    for rule in ALERTS:
        assert set(rule) <= {"alert", "expr", "for", "labels", "annotations"}
        assert rule["labels"]["severity"] in ("warning", "critical")
        assert set(rule["annotations"]) == {"summary", "description"}
        assert re.fullmatch(r"\d+[sm]", rule.get("for", "0s"))


def test_prometheus_scrapes_the_job_that_the_alerts_are_about_and_loads_them() -> None:
    prometheus = read("prometheus/prometheus.yml")
    (job,) = prometheus["scrape_configs"]
    assert {name for rule in ALERTS for name in re.findall(r'job="(\w+)"', rule["expr"])} == {job["job_name"]}
    assert [DEPLOY / "prometheus" / name for name in prometheus["rule_files"]] == [DEPLOY / "prometheus" / "alerts.yml"]


def test_the_dashboard_is_whole() -> None:
    panels = DASHBOARD["panels"]
    assert len({panel["id"] for panel in panels}) == len(panels)
    cells = [
        (x, y)
        for place in (panel["gridPos"] for panel in panels)
        for x in range(place["x"], place["x"] + place["w"])
        for y in range(place["y"], place["y"] + place["h"])
    ]
    assert len(set(cells)) == len(cells)
    assert max(x for x, _ in cells) < 24
    variables = {variable["name"] for variable in DASHBOARD["templating"]["list"]}
    used = set(re.findall(r"\$\{?(\w+)", json.dumps(panels))) - {"__rate_interval"}
    assert used == variables == {"datasource", "instance"}


def test_grafana_finds_its_data_source_and_the_dashboard() -> None:
    (source,) = read("grafana/provisioning/datasources/prometheus.yml")["datasources"]
    assert source["type"] == DASHBOARD["templating"]["list"][0]["query"] == "prometheus"
    (provider,) = read("grafana/provisioning/dashboards/gameopt.yml")["providers"]
    assert Path(provider["options"]["path"]).name == (DEPLOY / "grafana" / "dashboards").name


def test_the_page_is_what_the_code_says() -> None:
    text = PAGE.read_text(encoding="utf-8")
    assert text == reference.reference(), "run: python -m gameopt_im.web.reference > docs/metrics.md"
    assert set(re.findall(r"^\| `(Gameopt\w+)`", text, re.M)) == {rule["alert"] for rule in ALERTS}
