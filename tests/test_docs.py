"""The manual's Python code and commands run, and its links lead to pages that exist."""

from __future__ import annotations

import doctest
import importlib
import inspect
import pkgutil
import re
import shlex
from contextlib import suppress
from functools import cache
from pathlib import Path
from types import ModuleType

import pytest
from typer.testing import CliRunner

import pyibr
from pyibr.app.cli import app

ROOT = Path(__file__).resolve().parents[1]
PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md")])
BLOCK = re.compile(r"^```(python|sh)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
CODE = re.compile(r"^```.*?^```$|`[^`\n]*`", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"\]\(([^)\s]+)\)")
TOCTREE = re.compile(r"^```\{toctree\}\n(.*?)^```$", re.MULTILINE | re.DOTALL)
MODULES = sorted(m.name for m in pkgutil.walk_packages(pyibr.__path__, "pyibr."))


def name_of(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


def blocks_of(page: Path) -> list[tuple[int, str]]:
    """(line, source) of each block of Python on a page."""
    return [(line, source) for line, kind, source in all_blocks_of(page) if kind == "python"]


def all_blocks_of(page: Path) -> list[tuple[int, str, str]]:
    """(line, kind, source) of each block that is run: Python, and shell blocks after the first Python block.

    Shell lines that need other files are in blocks of the kind `console`, or above the first Python block.
    """
    text = page.read_text(encoding="utf-8")
    found = [(text.count("\n", 0, m.start(2)), m.group(1), m.group(2)) for m in BLOCK.finditer(text)]
    first = next((place for place, (_, kind, _) in enumerate(found) if kind == "python"), len(found))
    return found[first:]


def run_lines(source: str) -> None:
    """Run those lines of a shell block that call pyibr."""
    for line in source.replace("\\\n", " ").splitlines():
        program, *words = shlex.split(line, comments=True) or [""]
        if program == "pyibr":
            result = CliRunner().invoke(app, words)
            assert result.exit_code == 0, f"{line}\n{result.output}"


def entries_of(text: str) -> list[str]:
    """List the pages in a page's tables of contents."""
    lines = [line.strip() for listing in TOCTREE.findall(text) for line in listing.splitlines()]
    return [line for line in lines if line and not line.startswith(":")]


@pytest.mark.thorough
@pytest.mark.parametrize("page", [p for p in PAGES if blocks_of(p)], ids=name_of)
def test_blocks_of_page_run(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {"__name__": "__main__"}
    for line, kind, source in all_blocks_of(page):
        if kind == "sh":
            run_lines(source)
            continue
        # With blank lines before the source, a traceback names the line of the page.
        exec(compile("\n" * line + source, str(page), "exec"), names)


def test_pages_with_python_are_found() -> None:
    with_python = {name_of(page) for page in PAGES if blocks_of(page)}
    names = ("index", "conventions", "howto/own-images", "howto/objects", "howto/own-system")
    assert {"README.md", *(f"docs/{name}.md" for name in names)} <= with_python


def test_readme_example_is_as_short_as_it_says() -> None:
    ((_, source),) = blocks_of(ROOT / "README.md")
    assert sum(bool(line.strip()) for line in source.splitlines()) <= 10


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_links_lead_to_files(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    links = LINK.findall(CODE.sub("", text))
    local = [link.split("#")[0] for link in links if not re.match(r"[a-z]+:|#", link)]
    local += [f"{entry}.md" for entry in entries_of(text)]
    missing = [link for link in local if not (page.parent / link).exists()]
    assert not missing


def test_every_page_is_in_a_table_of_contents() -> None:
    listed = set(entries_of((ROOT / "docs/index.md").read_text(encoding="utf-8")))
    pages = {p.relative_to(ROOT / "docs").with_suffix("").as_posix() for p in ROOT.glob("docs/**/*.md")}
    assert pages - listed == {"index"}


def test_reference_names_all_that_is_public() -> None:
    text = (ROOT / "docs/reference.md").read_text(encoding="utf-8")
    documented = set(re.findall(r"^\.\. auto\w+:: pyibr\.(\w+)$", text, re.MULTILINE))
    assert set(pyibr.__all__) - {"__version__"} <= documented


@pytest.mark.parametrize("name", ["pyibr", *MODULES])
def test_examples_of_docstrings(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    module: ModuleType = importlib.import_module(name)
    assert doctest.testmod(module).failed == 0


def test_public_functions_have_examples() -> None:
    modules = (pyibr, pyibr.io, pyibr.slicing)
    functions = {f for m in modules for f in map(m.__dict__.get, m.__all__) if inspect.isfunction(f)}
    assert not sorted(f.__name__ for f in functions if ">>>" not in (f.__doc__ or ""))


@cache
def parameters_by_name() -> dict[str, set[str]]:
    """Parameters of all public functions, classes and methods, by their names without a module or class."""
    found: dict[str, set[str]] = {}
    modules = [pyibr, pyibr.io, *map(importlib.import_module, ("pyibr.capture", "pyibr.slicing", "pyibr.drawing"))]
    public = [getattr(module, name) for module in modules for name in module.__all__]
    methods = [one for kind in public if inspect.isclass(kind) for _, one in inspect.getmembers(kind, callable)]
    for one in (*public, *methods):
        with suppress(AttributeError, TypeError, ValueError):  # types such as unions, and built-in methods
            found.setdefault(one.__name__, set()).update(inspect.signature(one).parameters)
    return found


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_keywords_in_prose_are_those_of_the_callables_on_the_page(page: Path) -> None:
    """A keyword such as `fill="smooth"` is a parameter of something that the page names, of its system, or `warp`."""
    known, text = parameters_by_name(), page.read_text(encoding="utf-8")
    room = ROOT / "pyibr" / page.stem / "__init__.py"
    named = {
        *re.findall(r"\w+", " ".join(CODE.findall(text))),
        "warp",
        *(re.findall(r"\w+", room.read_text()) if room.exists() else ()),
    }
    parameters = set().union(*(known[name] for name in named & known.keys()))
    prose = re.sub(r"^```.*?^```$", "", text, flags=re.MULTILINE | re.DOTALL)
    keywords = {word for word in re.findall(r"`(\w+)=[^`\n]*`", prose) if not word.isupper()}  # no variables
    assert not keywords - parameters
