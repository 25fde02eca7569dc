"""Tests are quick or thorough; the quick ones cover every folder and every kernel."""

from __future__ import annotations

import re
from itertools import combinations, product
from pathlib import Path

import pytest

from tests.opencl import test_in_flight as flight
from tests.tiers import COLLECTED, covering

ROOT = Path(__file__).parents[1]


def command_of(target: str) -> str:
    """The command that a target of the Makefile runs."""
    text = (ROOT / "Makefile").read_text()
    (line,) = re.findall(rf"^{target}:.*\n\t@(.*TESTS.*)$", text, re.MULTILINE)
    return line.replace("$(TESTS)", re.findall(r"^TESTS := (.*)$", text, re.MULTILINE)[0])


def test_the_tiers_are_all_tests():
    quick, thorough, rest = (command_of(target) for target in ("test", "test-all", "fuzz"))
    plain = quick.replace(' -m "not thorough"', "")
    assert thorough == plain.replace("$(ARGS)", '-m "not product" $(ARGS)')
    assert rest == plain.replace("$(ARGS)", "-m product")
    assert not re.search(r'-m "| -k | --deselect| --ignore|tests/', plain)
    assert "\nmake test-all\n" in (ROOT / ".ci/run").read_text()


def test_every_folder_has_quick_tests(pytestconfig: pytest.Config):
    """Each folder with collected tests has some that are not left out of the quick run."""
    folders = {Path(name.split("::")[0]).parent: False for name in pytestconfig.stash[COLLECTED]}
    for name, left in pytestconfig.stash[COLLECTED].items():
        folders[Path(name.split("::")[0]).parent] |= not left
    assert all(folders.values()), folders


def test_every_kernel_runs_in_the_quick_tier():
    """The test that launches all kernels has no mark but `parametrize`, so it is quick."""
    test = flight.test_all_kernels_give_the_same_in_pieces_and_in_padded_launches
    marks = [*getattr(flight, "pytestmark", []), *test.pytestmark]
    assert {mark.name for mark in marks} == {"parametrize"}


def test_few_places_of_a_product_hold_every_value():
    places = [set(zip("abc", values, strict=True)) for values in product(range(4), range(3), range(2))]
    chosen = [places[number] for number in covering(places)]
    assert len(chosen) == 4
    assert set().union(*chosen) == set().union(*places)


def test_more_hold_every_pair():
    pairs = [set(combinations(zip("abc", values, strict=True), 2)) for values in product(range(4), range(3), range(2))]
    chosen = covering(pairs, {5})
    assert 5 in chosen and len(chosen) <= 13
    assert set[object]().union(*(pairs[number] for number in chosen)) == set[object]().union(*pairs)


def test_of_a_product_few_tests_are_quick(pytestconfig: pytest.Config):
    collected = pytestconfig.stash[COLLECTED]
    found = {name.split("[")[1][:-1]: left for name, left in collected.items() if "::test_a_product[" in name}
    assert len(found) == 24
    quick = [name for name, left in found.items() if not left]
    assert len(quick) == 3
    assert sum("product" not in left for left in found.values()) == 12  # as many as d has with b and c
    for value in ("-0.5-", "-0-", "-1-1-", "-2-1-", "-3-2-", "---", "-a-b-", "-b-"):
        assert any(value in f"-{name}-" for name in quick), value


@pytest.mark.parametrize("a", [0, 0.5])
@pytest.mark.parametrize(("b", "c"), [(1, 1), (2, 1), (3, 2)])
@pytest.mark.parametrize("d", [pytest.param("thorough", marks=pytest.mark.thorough), "-", "a-b", "b"])
def test_a_product(a: float, b: int, c: int, d: str):
    """A test whose parameters multiply, which the test above looks at."""
