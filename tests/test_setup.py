"""Set-up behind `make`: the demo installs no more than it needs."""

from __future__ import annotations

import ast
import re
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SETUP = (ROOT / "tools/setup.py").read_text()


def commands(folder: Path, target: str) -> str:
    """List the commands that `make` would run in a folder for a target."""
    return subprocess.run(["make", "-n", target], cwd=folder, capture_output=True, text=True, check=True).stdout


@pytest.fixture
def clone(tmp_path: Path) -> Path:
    """A new clone, which is not set up yet."""
    (tmp_path / "tools").mkdir()
    for name in ("Makefile", "pyproject.toml", "tools/setup.py"):
        shutil.copy(ROOT / name, tmp_path / name)
    (tmp_path / ".venv").mkdir()
    return tmp_path


def test_the_demo_has_a_lighter_set_up_than_the_tests(clone: Path):
    assert "setup.py --demo" in commands(clone, "demo")
    assert re.search(r"setup\.py *$", commands(clone, "check"), re.MULTILINE)
    (clone / ".venv/.demo").touch()
    assert "setup.py" not in commands(clone, "demo")
    assert "setup.py" in commands(clone, "test")
    (clone / ".venv/.ready").touch()
    assert "setup.py" not in commands(clone, "demo") + commands(clone, "test")


def test_the_demo_needs_no_other_extra():
    """The demo's scripts import only packages that come with pyibr or with the extra `plot`."""
    assert 'DEMO, EVERYTHING = "plot", ' in SETUP
    paths = [ROOT / f"docs/gallery/{name}.py" for name in ("demo", "objects", "terrain")]
    trees = [node for path in paths for node in ast.walk(ast.parse(path.read_text()))]
    names = {alias.name for node in trees if isinstance(node, ast.Import) for alias in node.names}
    names |= {node.module or "" for node in trees if isinstance(node, ast.ImportFrom)}
    heavy = {"cv2", "open3d", "OpenEXR", "viser", "scipy"}
    assert not heavy & {name.split(".")[0] for name in names}
