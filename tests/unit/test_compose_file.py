"""The compose file and what it mounts: nothing here runs a container, docs/containers.md says what was tried."""

from __future__ import annotations

import re
import shlex
from pathlib import Path
from typing import Any

import pytest
import yaml

from gameopt_im.cli import commands
from gameopt_vehicles.cli import command

DEPLOY = Path(__file__).parents[2] / "deploy"
COMPOSE = yaml.safe_load((DEPLOY / "compose.yaml").read_text())
SERVICES: dict[str, Any] = COMPOSE["services"]


@pytest.mark.parametrize("name", SERVICES)
def test_every_container_is_locked_down_and_watched(name: str) -> None:
    service = SERVICES[name]
    assert service["read_only"] is True
    assert service["cap_drop"] == ["ALL"]
    assert all(port.startswith("127.0.0.1:") for port in service.get("ports", ()))
    if name != "vehicles":  # they end; whoever waits for them looks at their exit code
        assert service["healthcheck"]["test"]


@pytest.mark.parametrize("name", SERVICES)
def test_what_is_mounted_is_there(name: str) -> None:
    for volume in SERVICES[name]["volumes"]:
        source = volume.split(":")[0]
        assert (DEPLOY / source).is_dir() if source.startswith(".") else source in COMPOSE["volumes"]


def test_images_are_pinned() -> None:
    foreign = [service["image"] for service in SERVICES.values() if service["image"] != "gameopt"]
    base = re.findall(r"^FROM (\S+)", (DEPLOY / "Dockerfile").read_text(), re.MULTILINE)
    assert len(foreign) == len(base) == 2
    assert all(re.search(r":v?\d+\.\d+\.\d+", image) for image in (*foreign, *base))


def test_the_commands_are_understood(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "four-arm.net.xml").touch()
    (tmp_path / "four-arm.sumocfg").touch()
    serve = re.search(r"exec gameopt-im serve (.*)", SERVICES["manager"]["command"][2])
    assert serve is not None
    commands.commands["serve"].make_context("serve", shlex.split(serve[1]))
    drive = re.sub(r"\$\{\w+:-(\w+)\}", r"\1", SERVICES["vehicles"]["command"])
    command.make_context("gameopt-vehicles", shlex.split(drive)[1:])


def test_prometheus_asks_the_manager_where_it_answers() -> None:
    (scrape,) = yaml.safe_load((DEPLOY / "prometheus/prometheus.yml").read_text())["scrape_configs"]
    ((target,),) = [static["targets"] for static in scrape["static_configs"]]
    host, port = target.split(":")
    assert f"--http 0.0.0.0:{port}" in SERVICES[host]["command"][2]
