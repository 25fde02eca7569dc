"""The cache on disk: its folder, trust in its files, and damage to them."""

from __future__ import annotations

import errno
import json
import os
import random
import shutil
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from pyibr.core.errors import ArgumentError
from pyibr.opencl import cache
from pyibr.opencl.cache import Entry, cache_fault, cache_folder
from pyibr.opencl.doctor import report
from tests.opencl.damage import KINDS, UNSAFE
from tests.opencl.test_memory import refusing
from tools.processes import run_within

ONE = Entry("programs", "one", "what it depends on")
TWO = Entry("programs", "two", "something else")

posix = pytest.mark.skipif(os.name != "posix", reason="files have no owners and modes on this system")


def files(folder: Path) -> list[Path]:
    return sorted(path for path in folder.rglob("*") if not path.is_dir())


# --- the folder -----------------------------------------------------------------------------------


def test_the_cache_folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    monkeypatch.setenv("PYIBR_CACHE", str(tmp_path / "own"))
    assert cache_folder() == tmp_path / "own"
    monkeypatch.delenv("PYIBR_CACHE")
    if sys.platform == "linux":
        monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
        assert cache_folder() == tmp_path / "pyibr"
        monkeypatch.setenv("XDG_CACHE_HOME", "not/absolute")
        assert cache_folder() == Path.home() / ".cache/pyibr"


def test_a_folder_that_cannot_be_meant_is_an_error_of_one_sentence(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    monkeypatch.setenv("PYIBR_CACHE", "~nosuchuser/cache")
    with pytest.raises(ArgumentError, match=r"^\$PYIBR_CACHE: expected a folder's path, got '~nosuchuser/cache': "):
        ONE.read()
    monkeypatch.setenv("PYIBR_CACHE", "relative")
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    with pytest.raises(ArgumentError, match=r"^\$PYIBR_CACHE: expected a folder's path, got 'relative': "):
        ONE.write(b"x")


@pytest.mark.skipif(sys.platform != "linux", reason="users always have names on this system")
def test_a_user_without_a_home(monkeypatch: pytest.MonkeyPatch):
    import pwd

    for name in ("PYIBR_CACHE", "XDG_CACHE_HOME", "HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(pwd, "getpwuid", refusing(KeyError()))
    assert cache_folder() == Path(f"/tmp/pyibr-{os.geteuid()}")


# --- entries --------------------------------------------------------------------------------------


def test_an_entry_is_written_read_and_forgotten(own_cache: Path):
    assert ONE.read() is None and not own_cache.exists()
    for content in (b"", b"first", bytes(range(256)) * 1000):
        ONE.write(content)
        assert ONE.read() == content and TWO.read() is None
    assert [path.parent.name for path in files(own_cache)] == ["programs"], "no part is left behind"
    for folder in (own_cache, own_cache / "programs"):
        assert os.name != "posix" or folder.stat().st_mode & 0o777 == 0o700
    ONE.forget()
    ONE.forget()
    assert ONE.read() is None


def test_names_may_be_anything(own_cache: Path):
    for name in ("x" * 300, "a\nb", "\N{SNOWMAN}" * 60, ""):
        entry = Entry("programs", name, name)
        entry.write(name.encode())
        assert entry.read() == name.encode()


def test_an_entry_stands_for_nothing_else(own_cache: Path):
    """A file that is moved to another entry's name is not read: checksums include the identity."""
    ONE.write(b"one")
    TWO.write(b"two")
    one, two = files(own_cache)
    two.replace(one)
    assert ONE.read() is None and TWO.read() is None
    device = Entry("devices", ONE.name, ONE.identity)
    device.write(b"x")
    device._path(own_cache / "devices").replace(one)
    assert ONE.read() is None


def test_every_flipped_bit_and_every_length_is_noticed(own_cache: Path):
    ONE.write(b"content")
    (path,) = files(own_cache)
    whole = path.read_bytes()
    for bit in range(8 * len(whole)):
        damaged = bytearray(whole)
        damaged[bit // 8] ^= 1 << bit % 8
        path.write_bytes(damaged)
        assert ONE.read() is None
    ends = [whole[:length] + bytes(zeros) for length in range(len(whole)) for zeros in (0, len(whole) - length)]
    for other in (*ends, whole + b"\0", b"\0" + whole, b"words" * 99, random.Random(0).randbytes(len(whole))):
        if other != whole:
            path.write_bytes(other)
            assert ONE.read() is None
    path.write_bytes(whole)
    assert ONE.read() == b"content"


def test_a_folder_that_cannot_be_written_is_no_error(own_cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    (tmp_path / "file").write_text("in the way")
    monkeypatch.setenv("PYIBR_CACHE", str(tmp_path / "file/inside"))
    ONE.write(b"x")
    assert ONE.read() is None
    ONE.forget()
    fault = cache_fault()
    assert fault is not None and "cannot be written" in fault[0]
    assert fault in [(problem.what, problem.remedy) for problem in report().problems]


def test_two_that_ask_for_faults_at_once_find_none(own_cache: Path):
    with ThreadPoolExecutor(2) as both:
        assert [*both.map(lambda _: cache_fault(), range(200))] == [None] * 200
    assert not files(own_cache)


@pytest.mark.parametrize(("owner", "step"), [(os, "fsync"), (Path, "replace")])
def test_a_full_disk_leaves_the_old_entry(own_cache: Path, monkeypatch: pytest.MonkeyPatch, owner: Any, step: str):
    ONE.write(b"old")
    before = files(own_cache)
    with monkeypatch.context() as patch:
        patch.setattr(owner, step, refusing(OSError(errno.ENOSPC, "No space left on device")))
        ONE.write(b"new")
        TWO.write(b"new")
    assert files(own_cache) == before and ONE.read() == b"old"


def test_what_a_killed_process_leaves_is_pruned(own_cache: Path):
    ONE.write(b"old")
    code = "import os; from pyibr.opencl.cache import Entry; os.fsync = lambda file: os._exit(9)\n"
    done = subprocess.run([sys.executable, "-c", f"{code}Entry('programs', 'one', {ONE.identity!r}).write(b'new')"])
    assert done.returncode == 9 and ONE.read() == b"old"
    (part,) = set(files(own_cache)) - {ONE._path(own_cache / "programs")}
    TWO.write(b"two")
    assert part.exists(), "another process may still write it"
    os.utime(part, (time.time() - 1e5,) * 2)
    TWO.write(b"two")
    assert not part.exists() and ONE.read() == b"old"


def test_entries_that_were_used_longest_ago_are_pruned(own_cache: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(cache, "_BYTES_MAX", 5000)
    entries = [Entry("programs", str(number), str(number)) for number in range(6)]
    for number, entry in enumerate(entries[:4]):
        entry.write(bytes(1000))
        os.utime(entry._path(own_cache / "programs"), (time.time() - 1e6 + number,) * 2)
    (own_cache / "programs/old-0123.bin").write_bytes(bytes(500))  # as an earlier version of pyibr named its files
    os.utime(own_cache / "programs/old-0123.bin", (1, 1))
    assert entries[0].read() is not None  # used today
    for entry in entries[4:]:
        entry.write(bytes(1000))
    assert [entry.read() is not None for entry in entries] == [True, False, False, True, True, True]
    assert len(files(own_cache)) == 4


# --- trust ----------------------------------------------------------------------------------------


@posix
@pytest.mark.parametrize("room", ["", "programs"])
@pytest.mark.parametrize("kind", UNSAFE)
def test_a_folder_that_others_can_write_is_not_used(own_cache: Path, room: str, kind: str):
    ONE.write(b"one")
    UNSAFE[kind](own_cache / room)
    before = files(own_cache.parent)
    said = f"^the cache folder {own_cache / room} is not used, .*; to mend it: [^.]*$"
    with pytest.warns(RuntimeWarning, match=said):
        assert ONE.read() is None
    TWO.write(b"two")  # without another warning
    assert TWO.read() is None and files(own_cache.parent) == before
    fault = cache_fault()
    assert fault is not None and str(own_cache / room) in fault[0]
    if fault[1].startswith("chmod"):
        subprocess.run(fault[1], shell=True, check=True)
        ONE.write(b"one")
        assert ONE.read() == b"one" and cache_fault() is None


@posix
def test_what_is_said_to_mend_a_folder_does_no_harm(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    folder = tmp_path / "it's; touch x"
    monkeypatch.setenv("PYIBR_CACHE", str(folder))
    elsewhere = "set PYIBR_CACHE to a folder of your own"
    for mode, remedy in ((0o777, None), (0o1777, elsewhere)):  # without and with the sticky bit, which /tmp has
        folder.mkdir(exist_ok=True)
        folder.chmod(mode)
        fault = cache_fault()
        assert fault is not None and remedy in (None, fault[1])
        if remedy is None:
            subprocess.run(fault[1], shell=True, check=True, cwd=tmp_path)
            assert cache_fault() is None and [path.name for path in tmp_path.iterdir()] == [folder.name]
    shutil.rmtree(folder)
    folder.write_text("somebody's notes")
    assert cache_fault() == (f"the cache folder {folder} is not used, because it is not a folder", elsewhere)


@posix
def test_a_link_to_a_safe_folder_is_used(own_cache: Path):
    elsewhere = own_cache.with_name("elsewhere")
    elsewhere.mkdir(mode=0o700)
    own_cache.symlink_to(elsewhere)
    ONE.write(b"one")
    assert ONE.read() == b"one" and len(files(elsewhere)) == 1


@posix
@pytest.mark.parametrize("kind", ["for all", "by its owner"])
def test_a_file_that_others_can_write_is_not_used(own_cache: Path, kind: str):
    ONE.write(b"one")
    UNSAFE[kind](ONE._path(own_cache / "programs"))
    assert ONE.read() is None
    ONE.write(b"one")
    assert ONE.read() == b"one"


# --- damage ---------------------------------------------------------------------------------------

DAMAGED = """
import json, random, shutil, warnings
from pyibr.opencl import cache, probe
from pyibr.opencl.device import current
from pyibr.opencl.program import keeping_binaries
from pyibr.opencl.runtimes import found_devices
from tests.opencl.damage import KINDS
from tools.everything import warped
folder, call = cache.cache_folder(), warped()

def render():
    current().kernels.clear()
    probe._tested.clear()
    assert probe.probe(found_devices()[current().device.index]).works
    with keeping_binaries():
        return [array.tobytes() for array in call()]

written = []
write = cache.Entry.write
cache.Entry.write = lambda entry, content: (written.append(entry), write(entry, content))
expected = render()
shutil.copytree(folder, folder.with_name("whole"), copy_function=shutil.copy2)
for number, (name, damage) in enumerate(KINDS.items()):
    damage(folder, random.Random(number))
    results = []
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        for _ in range(2):
            written.clear()
            results.append(render())
    print(json.dumps([name, [result == expected for result in results], len(written), len(said)]), flush=True)
    cache._warned.clear()
    for path in folder.parent.glob("*"):
        if path.name != "whole":
            path.chmod(0o700) if path.exists() else None
            shutil.rmtree(path) if path.is_dir() and not path.is_symlink() else path.unlink()
    shutil.copytree(folder.with_name("whole"), folder, copy_function=shutil.copy2)
"""


@pytest.mark.thorough
def test_no_damage_does_harm(own_cache: Path):
    """Draw two frames after each kind of damage. The first must repair the cache, if it can be used at all."""
    own_cache.mkdir(mode=0o700)
    done = run_within(1800, [sys.executable, "-c", DAMAGED])  # some compilers are slow
    told = [json.loads(line) for line in done.stdout.splitlines()]
    assert done.returncode == 0, f"{told}\n{done.stderr}"
    assert [kind for kind, *_ in told] == [*KINDS]
    for kind, right, written, said in told:
        assert right == [True, True], kind
        assert said == kind.startswith("unsafe"), kind
        assert (written == 0) == (not kind.startswith(("unsafe", "unwritable"))), kind
