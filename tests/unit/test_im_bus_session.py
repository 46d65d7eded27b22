"""The session of the manager's bus: which configuration it has, and why it cannot be opened."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from meeting import CHARTER, HERE, free_endpoint, hub, run

from gameopt_im.bus import Bus, BusError, configuration, endpoints


def test_a_taken_port_is_one_line() -> None:
    async def work() -> None:
        endpoint = free_endpoint()
        async with hub(endpoint):
            with pytest.raises(BusError) as caught:
                await Bus.open(HERE, configuration(listen=[endpoint]), CHARTER)
        assert str(caught.value) == f"{endpoint}: Address already in use"

    run(work())


def test_nobody_at_the_other_end_is_one_line() -> None:
    async def work() -> None:
        endpoint = free_endpoint()
        with pytest.raises(BusError) as caught:
            await Bus.open(HERE, configuration(connect=[endpoint]), CHARTER)
        assert str(caught.value) == f"{endpoint}: nobody listens there"

    run(work())


def test_a_second_manager_of_the_same_intersection_is_refused() -> None:
    async def work() -> None:
        endpoint = free_endpoint()
        async with hub(endpoint):
            with pytest.raises(BusError, match="a manager is already running"):
                await Bus.open(HERE, configuration(connect=[endpoint]), CHARTER)
            async with await Bus.open("elsewhere", configuration(connect=[endpoint]), CHARTER):
                pass

    run(work())


@pytest.mark.parametrize("endpoint", ["tcp/127.0.0.1", "carrier-pigeon/127.0.0.1:7447", "7447", ""])
def test_an_endpoint_that_is_none_is_one_line_that_names_it(endpoint: str) -> None:
    async def work() -> None:
        with pytest.raises(BusError) as caught:
            await Bus.open(HERE, configuration(listen=[endpoint]), CHARTER)
        message = str(caught.value)
        assert message.startswith(f"{endpoint}: ")
        assert "\n" not in message
        assert ".rs" not in message

    run(work())


def test_without_a_file_nobody_is_looked_for_and_the_mode_follows_the_endpoints() -> None:
    for listen, connect, mode in ((["tcp/127.0.0.1:1"], [], "router"), ([], ["tcp/127.0.0.1:1"], "client")):
        config = configuration(listen=listen, connect=connect)
        assert json.loads(config.get_json("mode")) == mode
        assert json.loads(config.get_json("scouting/multicast/enabled")) is False
        assert json.loads(config.get_json("scouting/gossip/enabled")) is False


def test_a_users_own_file_is_taken_and_endpoints_given_replace_its_own(tmp_path: Path) -> None:
    file = tmp_path / "zenoh.json5"
    file.write_text('{ mode: "peer", listen: { endpoints: ["tcp/127.0.0.1:1"] } }')
    config = configuration(zenoh_config=file)
    assert json.loads(config.get_json("mode")) == "peer"
    assert "127.0.0.1:1" in config.get_json("listen/endpoints")
    config = configuration(listen=["tcp/127.0.0.1:2"], zenoh_config=file)
    assert "127.0.0.1:2" in config.get_json("listen/endpoints")
    assert "127.0.0.1:1" not in config.get_json("listen/endpoints")


@pytest.mark.parametrize("text", ['{ mode: "rou', '{ mode: "banana" }', None])
def test_a_broken_file_is_one_line_that_names_it(tmp_path: Path, text: str | None) -> None:
    file = tmp_path / "zenoh.json5"
    if text is not None:
        file.write_text(text)
    with pytest.raises(BusError) as caught:
        configuration(zenoh_config=file)
    message = str(caught.value)
    assert message.startswith(f"{file}: ")
    assert "\n" not in message
    assert ".rs" not in message


def test_where_the_session_is_found_is_told(tmp_path: Path) -> None:
    assert endpoints(configuration(listen=["tcp/127.0.0.1:1", "tcp/127.0.0.1:2"])) == [
        "tcp/127.0.0.1:1",
        "tcp/127.0.0.1:2",
    ]
    assert endpoints(configuration(connect=["tcp/127.0.0.1:1"])) == ["tcp/127.0.0.1:1"]
    file = tmp_path / "zenoh.json5"
    file.write_text('{ mode: "router", listen: { endpoints: ["tls/0.0.0.0:7447"] } }')
    assert endpoints(configuration(zenoh_config=file)) == ["tls/0.0.0.0:7447"]
    file.write_text("{}")  # Zenoh's own mode and endpoint
    assert len(endpoints(configuration(zenoh_config=file))) == 1
