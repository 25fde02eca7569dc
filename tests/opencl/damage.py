"""Ways to damage a cache. Each gets the cache's folder and a random generator; pyibr warns if the name has "unsafe"."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from functools import partial
from pathlib import Path
from random import Random


def _any(folder: Path, random: Random) -> Path:
    return random.choice(sorted(path for path in folder.rglob("*") if path.is_file()))


def _removed(folder: Path, random: Random) -> Path:
    path = _any(folder, random)
    path.unlink()
    return path


def _two(folder: Path, random: Random) -> list[Path]:
    return random.sample(sorted((folder / "programs").iterdir()), 2)


def _with_a_flipped_bit(data: bytes, random: Random) -> bytes:
    bit = 1 << random.randrange(8 * len(data))
    return (int.from_bytes(data, "big") ^ bit).to_bytes(len(data), "big")


BYTES: dict[str, Callable[[bytes, Random], bytes]] = {
    "a flipped bit": _with_a_flipped_bit,
    "emptied": lambda old, rng: b"",
    "garbage": lambda old, rng: rng.randbytes(len(old)),
    "another version": lambda old, rng: old.replace(b"cache 1", b"cache 0", 1),
}
"""Changes of a file's bytes."""


def _change(change: Callable[[bytes, Random], bytes], folder: Path, random: Random) -> None:
    path = _any(folder, random)
    path.write_bytes(change(path.read_bytes(), random))


def _exchange(folder: Path, random: Random) -> None:
    one, two = _two(folder, random)
    other = one.read_bytes()
    one.write_bytes(two.read_bytes())
    two.write_bytes(other)


def _write_as_earlier_versions(folder: Path, random: Random) -> None:
    """Store a binary and its description in separate files."""
    path = _two(folder, random)[0]
    head, binary = path.read_bytes().split(b"\n", 2)[1:]
    path.with_suffix(".json").write_bytes(head[32:])
    path.write_bytes(binary)


def _link(make: Callable[[Path, Path], None], folder: Path, random: Random) -> None:
    one, two = _two(folder, random)
    one.unlink()
    make(one, two)


def _link_to_itself(folder: Path, random: Random) -> None:
    path = _removed(folder, random)
    path.symlink_to(path)


def _link_to_a_copy(folder: Path, random: Random) -> None:
    path = _any(folder, random)
    path.replace(folder.with_name("copy"))
    path.symlink_to(folder.with_name("copy"))


def _let_nobody_read(folder: Path, random: Random) -> None:
    path = _any(folder, random)
    path.chmod(0)
    if not os.geteuid():  # root can read it anyway
        os.chown(path, 12345, -1)


def _replace_by_a_link(where: str, target: str, folder: Path, random: Random) -> None:
    shutil.rmtree(folder / where)
    (folder / where).symlink_to(folder / target)


def _open(folder: Path) -> None:
    folder.chmod(0o777)


def _give_away(folder: Path) -> None:
    if os.geteuid():  # only root can
        _open(folder)
    else:
        os.chown(folder, 12345, -1)


def _link_to_an_open_one(folder: Path) -> None:
    elsewhere = folder.with_name("elsewhere")
    folder.rename(elsewhere)
    _open(elsewhere)
    folder.symlink_to(elsewhere)


def _give_a_link_away(folder: Path) -> None:
    _link_to_an_open_one(folder)
    if not os.geteuid():
        folder.resolve().chmod(0o700)
        os.chown(folder, 12345, -1, follow_symlinks=False)


def _replace_by_a_file(folder: Path) -> None:
    shutil.rmtree(folder)
    folder.write_bytes(b"no folder")


UNSAFE: dict[str, Callable[[Path], None]] = {
    "for all": _open,
    "for its group": lambda folder: folder.chmod(0o770),
    "by its owner": _give_away,
    "by a link": _link_to_an_open_one,
    "by a link's owner": _give_a_link_away,
    "as a file": _replace_by_a_file,
}
"""Ways to make a folder one that pyibr does not use."""
KINDS: dict[str, Callable[[Path, Random], object]] = {
    **{name: partial(_change, change) for name, change in BYTES.items()},
    "exchanged": _exchange,
    "as earlier versions wrote": _write_as_earlier_versions,
    "a folder in place of a file": lambda folder, random: (_removed(folder, random) / "inside/folder").mkdir(
        parents=True
    ),
    "a link to another": partial(_link, Path.symlink_to),
    "a link to itself": _link_to_itself,
    "a link to a copy": _link_to_a_copy,
    "one file for two": partial(_link, Path.hardlink_to),
    "a pipe": lambda folder, random: os.mkfifo(_removed(folder, random)),
    "a device": lambda folder, random: _removed(folder, random).symlink_to("/dev/zero"),
    "a huge file": lambda folder, random: os.truncate(_any(folder, random), 1 << 40),
    "writable by all": lambda folder, random: _any(folder, random).chmod(0o666),
    "readable by none": _let_nobody_read,
    "removed": lambda folder, random: shutil.rmtree(folder),
    "a room removed": lambda folder, random: shutil.rmtree(folder / random.choice(["devices", "programs"])),
    "unwritable as it leads nowhere": partial(_replace_by_a_link, "", "../gone"),
    "unwritable in a loop": partial(_replace_by_a_link, "programs", "programs"),
    **{f"unsafe {name}": lambda folder, _, spoil=spoil: spoil(folder / "programs") for name, spoil in UNSAFE.items()},
}
