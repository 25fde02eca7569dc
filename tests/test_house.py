"""Rules that keep code easy to find: imports, and the size of folders and functions."""

from __future__ import annotations

import ast
import pkgutil
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

import pyibr
from pyibr.opencl.headers import kernels_folder
from tools.processes import run_python

PACKAGE = Path(pyibr.__file__).parent
MODULES = sorted(PACKAGE.rglob("*.py"))
COMMANDS = tuple(  # modules that may import typer
    f"pyibr.{name}" for name in ("__main__", "app.batch", "app.cli", "app.commands", "app.live_commands", "app.options")
)
ROOT = Path(__file__).parents[1]
SOURCES = sorted(
    path for room in ("pyibr", "tests", "benchmarks", "docs", "tools") for path in (ROOT / room).rglob("*.py")
)
HEAVY = ("pyopencl", "cv2", "open3d", "OpenEXR", "matplotlib", "PIL", "rich", "typer", "viser", "yaml")


@cache
def tree_of(path: Path) -> ast.Module:
    return ast.parse(path.read_text())


def statements_in(node: ast.AST) -> Iterator[ast.AST]:
    """All nodes below this one, except expressions."""
    for child in ast.iter_child_nodes(node):
        if not isinstance(child, ast.expr):
            yield child
            yield from statements_in(child)


def test_importing_all_modules_loads_nothing_heavy():
    names = [name for _, name, _ in pkgutil.walk_packages([str(PACKAGE)], "pyibr.") if not name.startswith(COMMANDS)]
    code = f"import importlib, sys\nfor name in {names}: importlib.import_module(name)\nprint(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert not set(HEAVY) & set(loaded)


def test_a_room_that_no_layer_names_does_not_pass(tmp_path):
    shutil.copytree(PACKAGE, tmp_path / "pyibr", ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "pyproject.toml", tmp_path)

    def checked() -> str:
        code = f"import sys; sys.path.insert(0, {str(tmp_path)!r}); from importlinter.cli import lint_imports_command; "
        command = [sys.executable, "-c", code + "lint_imports_command(['--no-cache'])"]
        return subprocess.run(command, cwd=tmp_path, capture_output=True, text=True).stdout

    assert "2 kept, 0 broken" in checked()
    (tmp_path / "pyibr/splats").mkdir()
    (tmp_path / "pyibr/splats/__init__.py").write_text("import pyibr.warp.warp\n")
    said = checked()
    assert "splats" in said and "2 kept" not in said


def test_systems_are_loaded_when_they_are_first_used():
    code = """
import sys
import numpy as np, pyibr as ibr
later = {"depthmesh", "relief", "slicing"}
print(*(name for name in later if f"pyibr.{name}" in sys.modules))
triangle = ibr.Mesh(np.array([[-1, -1, 2], [1, -1, 2], [0, 1, 2]], np.float32), np.array([[0, 1, 2]]))
print(ibr.render([triangle], ibr.Camera([[9, 0, 6], [0, 9, 5], [0, 0, 1]], (13, 11))).valid.any())
print(later <= {*dir(ibr)}, all(hasattr(ibr, name) for name in {*ibr.__all__, *later}))
"""
    done = run_python("-c", code)
    assert done.stdout == "\nTrue\nTrue True\n", done.stdout + done.stderr
    with pytest.raises(AttributeError, match="module 'pyibr' has no attribute 'nothing'"):
        pyibr.nothing  # noqa: B018


def test_own_modules_are_imported_at_the_top():
    for path in MODULES:
        for outer in tree_of(path).body:
            if isinstance(outer, ast.If) and ast.unparse(outer.test) == "TYPE_CHECKING":
                continue
            below = [node.module or "" for node in statements_in(outer) if isinstance(node, ast.ImportFrom)]
            assert not [name for name in below if name.startswith("pyibr")], path


def test_functions_are_short():
    for path in MODULES:
        for node in statements_in(tree_of(path)):
            if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
                text = ast.get_docstring(node, clean=False)
                lines = node.end_lineno - node.lineno + 1 - (text.count("\n") + 1 if text else 0)
                assert lines <= 60, f"{path}, {node.name}: {lines} lines without its docstring"


def test_docstrings_open_with_what_a_thing_is_or_does():
    """Docstrings open with a noun or a verb, not with a question word."""
    questions = {"What", "How", "Where", "Which", "Whether", "Who"}
    for file in SOURCES:
        for node in (tree_of(file), *statements_in(tree_of(file))):
            if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)):
                text = ast.get_docstring(node) or ""
                assert text.split(maxsplit=1)[:1] not in [[word] for word in questions], f"{file}: {text}"


def test_rooms_use_kernels_of_their_own_and_of_all():
    used = re.compile(r'(?:kernel|constant|struct)\(\s*"(\w+)/')
    for path in MODULES:
        room = path.relative_to(PACKAGE).parts[0]
        assert set(used.findall(path.read_text())) <= {room, "lib"}, path


def test_kernels_include_their_own_rooms_headers_and_all_systems():
    for path in kernels_folder().glob("*/*.*"):
        included = set(re.findall(r'#include "(\w+)/', path.read_text()))
        room = path.parent.name
        system = room not in ("lib", "picture")
        assert included <= {room, "lib"} | ({"raster"} if system else set()), path


def test_the_shared_room_holds_headers():
    assert [path.name for path in sorted(kernels_folder().glob("lib/*")) if path.suffix != ".h"] == ["clear.cl"]


def test_few_things_lie_at_the_top_beside_the_systems():
    systems = {folder.name for folder in kernels_folder().iterdir() if folder.is_dir()}
    entries = {entry.name for entry in PACKAGE.iterdir()} - {"__pycache__", "kernels", "py.typed"}
    files = {entry for entry in entries if entry.endswith(".py")}
    assert files == {"__init__.py", "__main__.py", "drawing.py", "torch.py"}  # what users import or run
    assert len(entries - systems - files) <= 7, sorted(entries - systems)
    assert systems - {"lib"} <= entries  # each system has a folder in the package, too


def test_only_tests_import_tests():
    """Benchmarks, tools and the manual's scripts run without pytest."""
    for path in SOURCES:
        if path.relative_to(ROOT).parts[0] == "tests":
            continue
        for node in ast.walk(ast.parse(path.read_text())):
            named = [one.name for one in node.names] if isinstance(node, ast.Import) else []
            named += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            assert {name.split(".")[0] for name in named}.isdisjoint(("tests", "pytest", "conftest")), path
