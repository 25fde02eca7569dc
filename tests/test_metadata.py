"""The package's metadata: web addresses, and a README with absolute links."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from pyibr.core.optional import PYIBR, version_of

pytest.importorskip("hatchling")
ROOT = Path(__file__).resolve().parents[1]
REMOTES = {
    "https://git.example.org/group/name.git": "https://git.example.org/group/name",
    "https://me:secret@git.example.org/name/": "https://git.example.org/name",
    "git@git.example.org:group/name.git": "https://git.example.org/group/name",
    "ssh://git@git.example.org:2222/group/name": "https://git.example.org/group/name",
}
REMOTES |= dict.fromkeys(["", "/home/me/name", "../name.git", "file:///home/me/name", "me@nas:name"])
REMOTES |= dict.fromkeys(["https://localhost/name", "http://127.0.0.1:8000/name.git"])


def test_only_public_hosts_are_addresses():
    from tools.metadata import web_address

    assert {remote: web_address(remote) for remote in REMOTES} == REMOTES


@pytest.fixture
def clone(tmp_path: Path) -> Path:
    """Copy the files that are packaged into a new git repository."""
    made = tmp_path / "clone"
    shutil.copytree(ROOT / "pyibr", made / "pyibr", ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("kernels", "tools"):
        shutil.copytree(ROOT / name, made / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, made)
    subprocess.run(["git", "init", "-q", str(made)], check=True)
    return made


def hatchling(folder: Path, *arguments: str) -> str:
    done = subprocess.run([sys.executable, "-m", "hatchling", *arguments], cwd=folder, capture_output=True, text=True)
    assert not done.returncode, done.stderr
    return done.stdout


def test_without_an_address_links_are_words(clone):
    told = json.loads(hatchling(clone, "metadata"))
    text = told["readme"]["text"]
    assert "urls" not in told
    assert "](" not in text and "![" not in text
    assert "- docs: the manual" in text


def test_where_the_clone_came_from_is_told_by_source_packages_too(clone, tmp_path):
    address = "https://git.example.org/group/name"
    subprocess.run(["git", "-C", str(clone), "remote", "add", "origin", f"{address}.git"], check=True)
    told = json.loads(hatchling(clone, "metadata"))
    assert told["urls"]["Source"] == address
    assert f"[docs]({address}/blob/HEAD/docs/index.md)" in told["readme"]["text"]
    assert f"({address}/raw/HEAD/docs/images/room.jpg)" in told["readme"]["text"]

    hatchling(clone, "build", "-t", "sdist", "-d", str(tmp_path / "dist"))
    packed = next((tmp_path / "dist").glob("*.tar.gz"))
    subprocess.run(["tar", "-xzf", str(packed), "-C", str(tmp_path / "dist")], check=True)
    again = json.loads(hatchling(tmp_path / "dist" / packed.name.removesuffix(".tar.gz"), "metadata"))
    assert again["urls"] == told["urls"]
    assert again["readme"]["text"].strip() == told["readme"]["text"].strip()


def requirements(extras: bool) -> dict[str, str]:
    """Least versions of required packages in pyproject.toml; `extras`: of the extras for users, too."""
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    required, rest = text.split("dependencies = [", 1)[1].split("\n]", 1)
    optional = rest.split("[project.optional-dependencies]", 1)[1].split("\nbench = ", 1)[0]
    return dict(re.findall(r'"([A-Za-z][\w-]*)>=([\d.]+)', required + optional * extras))


def test_the_conda_recipe_asks_for_what_the_wheel_does():
    recipe = (ROOT / "tools/conda/recipe.yaml").read_text(encoding="utf-8")
    run = dict(re.findall(r"- ([\w-]+) >=([\d.]+)", recipe.split("  run:")[1].split("tests:")[0]))
    needed = {{"isal": "python-isal"}.get(name, name): least for name, least in requirements(extras=False).items()}
    assert run == needed | {"python": "3.10"}
    assert f"version: {version_of(PYIBR)}" in recipe
    (command,) = re.findall(r'^pyibr = "(.+)"$', (ROOT / "pyproject.toml").read_text(encoding="utf-8"), re.M)
    assert f"- pyibr = {command}" in recipe


def test_the_dockerfile_asks_for_what_is_there():
    """The Dockerfile's Python version, extras and commands exist in the project. The image is not built."""
    told, project = ((ROOT / name).read_text(encoding="utf-8") for name in ("Dockerfile", "pyproject.toml"))
    (python, extras) = re.search(r"FROM python:([\d.]+)-.*/src\[([\w,]+)\]", told, re.S).groups()
    assert f"Python :: {python}" in project
    assert all(re.search(rf"^{extra} = ", project, re.M) for extra in extras.split(","))
    assert "RUN pyibr doctor --build" in told and "--build" in (ROOT / "pyibr/app/commands/doctor.py").read_text()


def test_licences_of_all_that_is_installed_are_told():
    table = (ROOT / "docs/install.md").read_text(encoding="utf-8").split("### Licences")[1].split("## ")[0]
    told = {
        name for line in table.splitlines() for name in re.findall(r"[\w-]+", line.split("|")[1] if "|" in line else "")
    }
    assert set(requirements(extras=True)) <= told
