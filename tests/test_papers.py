"""The manual's pages on the four papers name only code that exists, and list all figures."""

from __future__ import annotations

import importlib
import inspect
import re
from enum import Enum
from pathlib import Path

import pytest

import pyibr

ROOT = Path(__file__).resolve().parents[1]
PAGES = {p.stem: p for p in sorted(ROOT.glob("docs/papers/*.md"))}
FIGURES = {"warp": (13, 2), "slicing": (18, 0), "relief": (18, 0), "depthmesh": (13, 2)}
"""Numbers of figures and tables in each paper."""
NONE = "-"
ROW = re.compile(r"^\|(.+)\|$", re.MULTILINE)
CODE = re.compile(r"`([^`]+)`")
LINK = re.compile(r"\[[^\]]*\]\(([^)\s]+)\)")
NAME = re.compile(r"pyibr(\.\w+)+")
OPTION = re.compile(r'(\w+)="(\w+)"')
PATHS = ("kernels/", "pyibr/", "tests/", "benchmarks/", "docs/")

Row = dict[str, str]


def tables_of(page: Path) -> list[list[Row]]:
    """Read a page's tables, first techniques, then figures: for each, its rows, with cells by heading."""
    tables: list[list[Row]] = []
    for section in page.read_text(encoding="utf-8").split("\n## ")[1:]:
        cells = [[cell.strip() for cell in row.split("|")] for row in ROW.findall(section)]
        head, _, *rows = cells
        assert all(len(row) == len(head) for row in rows), f"{page.name}: a row has other columns than its table"
        tables.append([dict(zip(head, row, strict=True)) for row in rows])
    return tables


def anchors_of(page: Path) -> set[str]:
    """Anchors of a page's headings, by which links name them."""
    headings = re.findall(r"^#+ (.+)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def missing_of(cell: str) -> list[str]:
    """Names and links in a cell for which nothing exists."""
    missing: list[str] = []
    for link in LINK.findall(cell):
        path, _, anchor = link.partition("#")
        target = (ROOT / "docs/papers" / path).resolve()
        if not target.exists() or (anchor and anchor not in anchors_of(target)):
            missing.append(link)
    for code in CODE.findall(cell):
        if code.startswith(PATHS):
            path, _, function = code.partition("::")
            there = (ROOT / path).exists()
            if not there or (function and f"def {function}(" not in (ROOT / path).read_text(encoding="utf-8")):
                missing.append(code)
        elif (NAME.fullmatch(code) and not is_there(code)) or (OPTION.fullmatch(code) and not is_option(code)):
            missing.append(code)
    return missing


def is_there(name: str) -> bool:
    """Tell whether a dotted name is a module, or an attribute in one."""
    parts = name.split(".")
    for split in range(len(parts), 0, -1):
        try:
            found: object = importlib.import_module(".".join(parts[:split]))
        except ModuleNotFoundError:
            continue
        for part in parts[split:]:
            if not hasattr(found, part):
                return part in getattr(found, "__annotations__", {}) or part in getattr(found, "__slots__", ())
            found = getattr(found, part)
        return True
    return False


def is_option(code: str) -> bool:
    """Tell whether a public function or class takes an option and documents its value."""
    match = OPTION.fullmatch(code)
    assert match
    public = (getattr(pyibr, name) for name in pyibr.__all__)
    return any(
        match[1] in inspect.signature(thing).parameters and f'"{match[2]}"' in inspect.getdoc(thing)
        for thing in public
        if callable(thing) and not (inspect.isclass(thing) and issubclass(thing, Enum | Exception))
    )


def names_something(cell: str) -> bool:
    codes = CODE.findall(cell)
    named = any(c.startswith(PATHS) or NAME.fullmatch(c) or OPTION.fullmatch(c) for c in codes)
    return named or bool(LINK.findall(cell))


def test_there_is_a_page_for_each_paper() -> None:
    assert set(PAGES) == set(FIGURES)


@pytest.mark.parametrize("name", FIGURES)
def test_rows_name_what_exists(name: str) -> None:
    rows = [row for table in tables_of(PAGES[name])[:2] for row in table]
    assert [missing for row in rows for cell in row.values() for missing in missing_of(cell)] == []


@pytest.mark.parametrize("name", FIGURES)
def test_techniques_are_somewhere_and_held_by_something(name: str) -> None:
    techniques, _, *_ = tables_of(PAGES[name])
    for row in techniques:
        if row["here"] == NONE:
            assert row["where it differs, and why"] != NONE, f"{row['in the paper']}: missing without a reason"
        else:
            assert names_something(row["here"]), f"{row['in the paper']}: the column 'here' names nothing"
            assert names_something(row["held by"]), f"{row['in the paper']}: the column 'held by' names nothing"


@pytest.mark.parametrize("name", FIGURES)
def test_every_figure_has_a_row_and_a_picture(name: str) -> None:
    count, tables = FIGURES[name]
    _, rows, *_ = tables_of(PAGES[name])
    numbers = [number.strip() for row in rows for number in row["figure"].split(",")]
    expected = [str(i) for i in range(1, count + 1)] + [f"table {i}" for i in range(1, tables + 1)]
    assert sorted(numbers) == sorted(expected)
    for row in rows:
        if row["picture"] == NONE:
            assert row["where it differs, and why"] != NONE, f"figure {row['figure']}: no picture, and no reason"
        else:
            assert names_something(row["picture"])


def test_pictures_are_made_by_scripts() -> None:
    scripts = "".join(p.read_text(encoding="utf-8") for p in ROOT.glob("docs/gallery/*.py"))
    pictures = {link for p in PAGES.values() for link in re.findall(r"images/([\w.-]+)", p.read_text(encoding="utf-8"))}
    assert sorted(picture for picture in pictures if f'"{picture}"' not in scripts) == []


def test_what_is_missing_is_found() -> None:
    wrong = (
        "`kernels/warp/nothing.cl` `pyibr.nothing` `tests/test_papers.py::test_nothing` [page](../theory/warp.md#no)",
        '`method="nothing"` `nothing="search"`',
    )
    assert [len(missing_of(cell)) for cell in wrong] == [4, 2]
    assert missing_of('`kernels/warp/search.cl` `pyibr.DepthImage.valid` `fill="smooth"`') == []
    assert missing_of("[page](../theory/warp.md#holes)") == []
