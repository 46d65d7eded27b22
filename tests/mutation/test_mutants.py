"""Each mutant is caught by the test that is named for it; without mutants, all of these tests pass."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

import pytest
from mutants import MUTANTS, Mutant

REPOSITORY = Path(__file__).parents[2]
PACKAGES = ("service", "vehicle_agents", "sumo_gateway")
LEFT_OUT = shutil.ignore_patterns("__pycache__", ".hypothesis", "*.pyc", "*.nbc", "*.nbi")
PASSED, FAILED = 0, 1
TIMEOUT_S = 60.0
UNSHRUNK = """
from hypothesis import Phase, settings

settings.register_profile("unshrunk", phases=[Phase.explicit, Phase.generate], database=None)
settings.load_profile("unshrunk")
"""
"""The first example that fails is enough."""


@pytest.fixture(scope="module")
def tree(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The programs, their tests and the settings, untouched."""
    copy = tmp_path_factory.mktemp("mutation") / "tree"
    for each in (*PACKAGES, "tests/unit", "tests/maps"):
        shutil.copytree(REPOSITORY / each, copy / each, ignore=LEFT_OUT)
    shutil.copy(REPOSITORY / "pyproject.toml", copy)
    (copy / "conftest.py").write_text(UNSHRUNK, encoding="utf-8")
    return copy


@pytest.fixture(scope="module")
def ended(
    tree: Path, tmp_path_factory: pytest.TempPathFactory, request: pytest.FixtureRequest
) -> Iterator[dict[str, Future[tuple[int, str]]]]:
    """How the named test of each mutant that is asked for ends, by its name; one at a time on each processor."""
    parameters = [item.callspec.params for item in request.session.items if hasattr(item, "callspec")]
    asked = [each["mutant"] for each in parameters if isinstance(each.get("mutant"), Mutant)]
    place = tmp_path_factory.mktemp("mutants")
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        yield {mutant.name: pool.submit(run_mutated, mutant, tree, place / str(k)) for k, mutant in enumerate(asked)}
        pool.shutdown(cancel_futures=True)


def run_mutated(mutant: Mutant, tree: Path, copy: Path) -> tuple[int, str]:
    """(exit code, output) of the mutant's test in a copy of the tree with the mutant in it."""
    shutil.copytree(tree, copy)
    try:
        mutate(copy, mutant)
        return run(copy, mutant.test)
    finally:
        shutil.rmtree(copy)


def run(copy: Path, *tests: str) -> tuple[int, str]:
    """(exit code, output) of tests in a copy, of its own code and not of the installed one."""
    path = os.pathsep.join(str(copy / each) for each in PACKAGES)
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", "--hypothesis-seed=0", *tests],
        cwd=copy,
        env=os.environ | {"PYTHONPATH": path, "PYTHONDONTWRITEBYTECODE": "1", "NUMBA_DISABLE_JIT": "1"},
        capture_output=True,
        text=True,
        timeout=TIMEOUT_S,
        check=False,
    )
    return done.returncode, done.stdout + done.stderr


def mutate(copy: Path, mutant: Mutant) -> None:
    """Make the wrong edit; the place has to be the only one of its kind."""
    file = copy / mutant.file
    text = file.read_text(encoding="utf-8")
    found = text.count(mutant.old)
    assert found == 1, f"{mutant.old!r} occurs {found} times in {mutant.file}: bring mutants.py up to date"
    file.write_text(text.replace(mutant.old, mutant.new), encoding="utf-8")


def test_without_a_mutant_every_named_test_passes(tree: Path) -> None:
    code, output = run(tree, *sorted({mutant.test for mutant in MUTANTS}))
    assert code == PASSED, output


def test_names_are_distinct() -> None:
    assert len({mutant.name for mutant in MUTANTS}) == len(MUTANTS)


@pytest.mark.parametrize("mutant", MUTANTS, ids=[mutant.name for mutant in MUTANTS])
def test_the_named_test_catches_the_mutant(mutant: Mutant, ended: dict[str, Future[tuple[int, str]]]) -> None:
    code, output = ended[mutant.name].result()
    assert code == FAILED, f"{mutant.name} survives {mutant.test}\n{output}"
    assert "1 failed" in output, output
