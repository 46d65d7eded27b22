"""Each mutant is caught by the test that is named for it; without mutants, all of these tests pass."""

from __future__ import annotations

import multiprocessing
import os
import shutil
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NoReturn

import numba
import pytest
from mutants import MUTANTS, Mutant

REPOSITORY = Path(__file__).parents[2]
PACKAGES = ("service", "vehicle_agents", "sumo_gateway")
FORKS = multiprocessing.get_context("forkserver")
"""Each run has a process of its own that finds the libraries imported: they take longer than the tests."""
FORKS.set_forkserver_preload(["hypothesis", "numba", "numpy", "pytest", "scipy.sparse", "shapely", "structlog"])
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
    conftest = (REPOSITORY / "tests/conftest.py").read_text(encoding="utf-8")
    (copy / "conftest.py").write_text(conftest + UNSHRUNK, encoding="utf-8")
    return copy


@pytest.fixture
def fresh(tree: Path, tmp_path: Path) -> Iterator[Path]:
    """A copy of the tree to change."""
    copy = tmp_path / "tree"
    shutil.copytree(tree, copy)
    yield copy
    shutil.rmtree(copy)


def run(copy: Path, *tests: str) -> tuple[int, str]:
    """(exit code, output) of tests in a copy, of its own code and not of the installed one."""
    said = copy / "said.txt"
    process = FORKS.Process(target=_tested, args=(copy, tests, said))
    process.start()
    process.join(TIMEOUT_S)
    process.kill()  # a mutant may well run for ever
    process.join()
    assert process.exitcode is not None
    return process.exitcode, said.read_text(encoding="utf-8")


def _tested(copy: Path, tests: Sequence[str], said: Path) -> NoReturn:
    """A process of `run`."""
    file = os.open(said, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    for output in (1, 2):
        os.dup2(file, output)
    os.chdir(copy)
    sys.path[:0] = [str(copy / each) for each in PACKAGES]
    numba.config.DISABLE_JIT = 1  # compiling takes longer than the tests
    os.environ["NUMBA_DISABLE_JIT"] = "1"
    imported = "ignore:Module already imported:pytest.PytestAssertRewriteWarning"
    sys.exit(pytest.main(["-q", "-x", "-p", "no:cacheprovider", "-W", imported, "--hypothesis-seed=0", *tests]))


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
def test_the_named_test_catches_the_mutant(mutant: Mutant, fresh: Path) -> None:
    mutate(fresh, mutant)
    code, output = run(fresh, mutant.test)
    assert code == FAILED, f"{mutant.name} survives {mutant.test}\n{output}"
    assert "1 failed" in output, output
