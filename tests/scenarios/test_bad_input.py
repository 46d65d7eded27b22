"""Bad input to a command: one line on stderr that says what and where, and its exit code."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import msgspec
import pytest
from processes import Ended, command, driving, free_endpoint, manager, run

from gameopt_sumo.network import packaged_map
from gameopt_sumo.scenarios import FourArm, sumo_binary, write_four_arm

pytestmark = pytest.mark.slow

BAD_INPUT, NO_MANAGER = 2, 3
NETCONVERT_TWO = {
    "nod": "".join(
        f'<node id="{name}" x="{x}" y="{y}"/>'
        for name, x, y in [
            *(("west", 0, 0), ("one", 300, 0), ("two", 600, 0), ("east", 900, 0)),
            *(("one_n", 300, 300), ("one_s", 300, -300), ("two_n", 600, 300), ("two_s", 600, -300)),
        ]
    ),
    "edg": "".join(
        f'<edge id="{a}-{b}" from="{a}" to="{b}" numLanes="1" speed="13.9"/>'
        for pair in ("west one", "one two", "two east", "one_n one", "one one_s", "two_n two", "two two_s")
        for a, b in (pair.split(), pair.split()[::-1])
    ),
}


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A sound scenario, and files that are broken, each in its own way."""
    base = tmp_path_factory.mktemp("files")
    write_four_arm(FourArm(duration_s=10.0), base)
    options = []
    for kind, root in (("nod", "nodes"), ("edg", "edges")):
        (base / f"two.{kind}.xml").write_text(f"<{root}>{NETCONVERT_TWO[kind]}</{root}>")
    options += ["-n", str(base / "two.nod.xml"), "-e", str(base / "two.edg.xml")]
    two = base / "two.net.xml"
    subprocess.run([sumo_binary("netconvert"), *options, "-o", str(two)], check=True, capture_output=True)
    for name, net in (("two", "two.net.xml"), ("no-net", "gone.net.xml"), ("broken-net", "broken.net.xml")):
        (base / f"{name}.sumocfg").write_text(f'<configuration><net-file value="{net}"/></configuration>')
    for name, content in {
        "broken.net.xml": "<net><edge",
        "empty.net.xml": "<net/>",
        "broken.sumocfg": "<configuration",
        "broken.json": '{"lanes": [',
        "other.json": "[1, 2]",
        "broken.toml": "[auction\n",
        "unknown.toml": "[planner]\nmarginn_s = 0.3\n",
        "range.toml": "[interlock]\nmargin_s = 0.01\n",
        "type.toml": '[interlock]\nretries = "many"\n',
        "section.toml": "[interlok]\nretries = 3\n",
        "taken": "a file, no directory",
        "broken.mcap": "no recording",
    }.items():
        (base / name).write_text(content)
    return base


def ended(*words: object) -> Ended:
    """How a command line ended."""
    done: list[Ended] = []

    async def scenario() -> None:
        done.append(await command(*map(str, words)))

    run(scenario)
    return done[0]


def check(code: int, refused: Ended, *words: str) -> None:
    """It ended with this code, and with one line on stderr that has these words; stdout stays empty."""
    lines = refused.err.splitlines()
    assert (refused.code, len(lines)) == (code, 1), refused.err
    assert refused.out == ""
    assert lines[0].startswith("gameopt-")
    assert "Traceback" not in lines[0]
    for word in words:
        assert word in lines[0]


CASES = [
    ("gameopt_im serve --map {files}/gone.net.xml", ("gone.net.xml", "no such file")),
    ("gameopt_im serve --map {files}/broken.net.xml", ("broken.net.xml",)),
    ("gameopt_im serve --map {files}/empty.net.xml", ("empty.net.xml",)),
    ("gameopt_im serve --map {files}/two.net.xml", ("two.net.xml", "one", "two", "--junction")),
    ("gameopt_im serve --map {files}/four-arm.net.xml --junction main", ("'main'", "junction")),
    ("gameopt_im serve --map {files}/gone.json", ("gone.json",)),
    ("gameopt_im serve --map {files}/broken.json", ("broken.json", "not an intersection map")),
    ("gameopt_im serve --map {files}/other.json", ("other.json", "not an intersection map")),
    ("gameopt_im serve --config {files}/gone.toml", ("gone.toml",)),
    ("gameopt_im serve --config {files}/broken.toml", ("broken.toml",)),
    ("gameopt_im serve --config {files}/unknown.toml", ("unknown.toml", "marginn_s")),
    ("gameopt_im serve --config {files}/section.toml", ("section.toml", "interlok")),
    ("gameopt_im serve --config {files}/range.toml", ("range.toml", "interlock.margin_s", "0.05")),
    ("gameopt_im serve --config {files}/type.toml", ("type.toml", "interlock.retries")),
    ("gameopt_im serve --listen nowhere", ("nowhere",)),
    ("gameopt_im serve --connect tcp/127.0.0.1:1", ("tcp/127.0.0.1:1",)),
    ("gameopt_im serve --zenoh-config {files}/broken.json", ("broken.json",)),
    ("gameopt_im serve --record {files}/taken/run.mcap --listen tcp/127.0.0.1:0", ("taken/run.mcap",)),
    ("gameopt_vehicles --sumo {files}/gone.sumocfg", ("gone.sumocfg",)),
    ("gameopt_vehicles --sumo {files}/broken.sumocfg", ("broken.sumocfg",)),
    ("gameopt_vehicles --sumo {files}/no-net.sumocfg", ("gone.net.xml",)),
    ("gameopt_vehicles --sumo {files}/broken-net.sumocfg", ("broken.net.xml",)),
    ("gameopt_vehicles --sumo {files}/two.sumocfg", ("two.net.xml", "one", "two", "--junction")),
    ("gameopt_vehicles --sumo {files}/four-arm.sumocfg --junction main", ("'main'", "junction")),
    ("gameopt_vehicles --sumo {files}/four-arm.sumocfg --seed -1", ("--seed", "0<=x<=2147483647")),
    ("gameopt_vehicles --sumo {files}/four-arm.sumocfg --seed x", ("--seed", "'x'")),
    ("gameopt_vehicles --sumo {files}/four-arm.sumocfg --duration 0", ("--duration", "0.1")),
    ("gameopt_vehicles --sumo {files}/four-arm.sumocfg --duration nan", ("--duration", "nan")),
    (
        "gameopt_vehicles --sumo {files}/four-arm.sumocfg --duration 10 --warmup 20",
        ("--warmup", "--duration"),
    ),
    ("gameopt_vehicles --sumo {files}/four-arm.sumocfg --report {files}", ("--report", "directory")),
    (
        "gameopt_vehicles --sumo {files}/four-arm.sumocfg --report {files}/taken/report.json",
        ("--report", "taken"),
    ),
    (
        f"gameopt_vehicles --sumo {{files}}/four-arm.sumocfg --report {{files}}/{'x' * 300}.json",
        ("--report", "too long"),
    ),
    ("gameopt_vehicles --sumo {files}/four-arm.sumocfg -- --step-length 1", ("--step-length",)),
    ("gameopt_im replay {files}/gone.mcap", ("gone.mcap",)),
    ("gameopt_im replay {files}/broken.mcap", ("broken.mcap", "MCAP")),
    ("gameopt_sumo map {files}/two.net.xml", ("two.net.xml", "one", "two", "--junction")),
    ("gameopt_sumo map {files}/broken.net.xml", ("broken.net.xml",)),
    ("gameopt_sumo scenario four-arm --flow 0 --out {files}/x", ("0 veh/h", "40000")),
    ("gameopt_sumo scenario four-arm --out {files}/taken", ("taken",)),
]


@pytest.mark.parametrize(("line", "words"), CASES)
def test_bad_input_is_one_line(files: Path, line: str, words: tuple[str, ...]) -> None:
    check(BAD_INPUT, ended(*line.replace("{files}", str(files)).split()), *words)


def test_a_machine_that_lacks_what_sumo_needs_is_told_so(files: Path) -> None:
    """A broken library of that name is found first, and cannot be imported."""
    broken = files / "libraries"
    broken.mkdir()
    (broken / "libsumo.py").write_text("raise ImportError('libGL.so.1: cannot open shared object file')")
    code = "from gameopt_vehicles.cli import main; main()"
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code, "--sumo", str(files / "four-arm.sumocfg")],
        env=os.environ | {"PYTHONPATH": str(broken)},
        capture_output=True,
        text=True,
        check=False,
    )
    check(BAD_INPUT, Ended(done.returncode, done.stdout, done.stderr), "libGL.so.1", "README")


def test_a_refused_report_is_left_as_it_was(files: Path, tmp_path: Path) -> None:
    """Nothing is driven here, so a report of an earlier run has to be there still."""
    earlier, new = tmp_path / "earlier.json", tmp_path / "new.json"
    earlier.write_text("precious")
    drive = ("gameopt_vehicles", "--sumo", files / "four-arm.sumocfg", "--connect", free_endpoint())
    for report in (earlier, new):
        check(NO_MANAGER, ended(*drive, "--report", report), "no manager listens")
    assert earlier.read_text() == "precious"
    assert not new.exists()


def test_what_manager_and_vehicles_do_not_agree_on(files: Path, tmp_path: Path) -> None:
    """A clock, a map, turning speeds: exit 3. A second manager on the same port: exit 2, unwarmed."""
    whole = packaged_map()
    fewer = tmp_path / "fewer.json"
    fewer.write_bytes(msgspec.json.encode(msgspec.structs.replace(whole, areas=whole.areas[1:])))
    sumocfg = files / "four-arm.sumocfg"

    async def scenario() -> None:
        endpoint = free_endpoint()
        async with manager("--map", fewer, "--workers", 0, endpoint=endpoint):
            for arguments, clock, words in (
                ((), "lockstep", ("map", "'junction'")),
                ((), "wall", ("--clock lockstep", "--clock wall")),
                (("--ignore-turn-speed",), "lockstep", ("--ignore-turn-speed",)),
                (("--articulated",), "lockstep", ("map", "up to 12 m and 18.75 m", "--articulated")),
            ):
                refused = await command("gameopt_vehicles", *driving(sumocfg, endpoint, *arguments, clock=clock))
                check(NO_MANAGER, refused, *words)
            second = await command("gameopt_im", "serve", "--listen", endpoint)
            check(BAD_INPUT, second, endpoint, "Address already in use")

    run(scenario)
