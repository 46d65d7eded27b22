"""Each mutant is caught by the test that is named for it; without mutants, all of these tests pass."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
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
def test_the_named_test_catches_the_mutant(mutant: Mutant, fresh: Path) -> None:
    mutate(fresh, mutant)
    code, output = run(fresh, mutant.test)
    assert code == FAILED, f"{mutant.name} survives {mutant.test}\n{output}"
    assert "1 failed" in output, output
