"""Damaged files and failing writes cause no crash, no hang and no loss, only pyibr's own errors."""

from __future__ import annotations

import errno
import json
import os
import random
import resource
import sys
from pathlib import Path

import pytest

import pyibr as ibr
from tests.io.damages import COUNT, wrongs
from tests.io.specimens import DECODED_ELSEWHERE, OTHERS, WRITERS, reader
from tools.processes import run_within

OWN = [name for name in (*WRITERS, *OTHERS) if name not in DECODED_ELSEWHERE]


@pytest.mark.parametrize("name", OWN)
def test_damaged_files(folder: Path, name):
    assert wrongs(name, folder) == []


def test_damaged_files_of_other_libraries(folder: Path):
    pytest.importorskip("OpenEXR")
    done = run_within(120, [sys.executable, "-m", "tests.io.damages", str(folder), *DECODED_ELSEWHERE])
    assert done.returncode == 0, done.stderr[-2000:]
    assert json.loads(done.stdout.splitlines()[-1]) == []


# ---- writes that fail


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.mark.usefixtures("openexr_if_asked")
@pytest.mark.parametrize("name", WRITERS)
def test_writes_that_fail_leave_what_was_there(folder: Path, monkeypatch: pytest.MonkeyPatch, name):
    write, rng = WRITERS[name], random.Random(name)
    write(folder / name)
    size = (folder / name).stat().st_size
    old = b"what was there"
    (folder / name).write_bytes(old)
    for path in set(folder.iterdir()) - {folder / name}:
        path.unlink()  # the old file shall have no materials and textures
    unlimited = resource.getrlimit(resource.RLIMIT_FSIZE)

    def full(*arguments: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    for number in range(COUNT):
        with monkeypatch.context() as patch:
            kind = number % 20
            if kind == 0:
                patch.setattr(os, "fsync", full)
            elif kind == 1:
                patch.setattr(Path, "replace", full)
            else:
                resource.setrlimit(resource.RLIMIT_FSIZE, (rng.randrange(size), unlimited[1]))
            try:
                with pytest.raises(ibr.FileFormatError, match=rf"{name}|{Path(name).stem}-.*: cannot be written"):
                    write(folder / name)
            finally:
                resource.setrlimit(resource.RLIMIT_FSIZE, unlimited)
        left = contents(folder)
        assert left.pop(name) == old and not [other for other in left if other.startswith(".")]
    write(folder / name)
    reader(name)(folder / name)


KILLED = """
import os, random, signal, sys, time
from pathlib import Path
import pyibr as ibr
from tests.io.specimens import TEXTURED, VERTICES, FACES, COLOR, COLORED, same

folder, rng = Path(sys.argv[1]), random.Random(0)
other = ibr.Mesh(VERTICES + 1, FACES, uv=TEXTURED.uv, normals=TEXTURED.normals, texture=255 - COLOR)
things = {"m.obj": (TEXTURED, other), "m.glb": (TEXTURED, other), "m.ply": (COLORED, ibr.Mesh(VERTICES, FACES))}
for number in range(30):
    name = list(things)[number % 3]
    things[name][0].save(folder / name)
    child = os.fork()
    if not child:
        while True:
            for thing in things[name]:
                thing.save(folder / name)
    time.sleep(rng.uniform(0, 0.05))
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    read = ibr.Mesh.load(folder / name)
    assert any(same(read, thing) for thing in things[name]), name
print("done")
"""


def test_killed_writers_leave_whole_files(folder: Path):
    done = run_within(60, [sys.executable, "-c", KILLED, str(folder)])
    assert done.stdout == "done\n", done.stderr
    names = {path.name for path in folder.iterdir()}
    remains = {name for name in names if name.startswith(".")}
    assert all(name.startswith(".pyibr-") for name in remains)
    assert len(names - remains) <= 3 + 4  # 4: the OBJ file's two textures and their two files of materials
