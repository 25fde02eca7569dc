"""Ways to damage a cache. Each gets the cache's folder and a random generator; pyibr warns if the name has "unsafe"."""

from __future__ import annotations

import os
import random
import shutil
from pathlib import Path


def _any(folder: Path, random: random.Random) -> Path:
    return random.choice(sorted(path for path in folder.rglob("*") if path.is_file()))


def _two(folder: Path, random: random.Random) -> list[Path]:
    return random.sample(sorted((folder / "programs").iterdir()), 2)


def a_flipped_bit(folder: Path, random: random.Random) -> None:
    path = _any(folder, random)
    data = bytearray(path.read_bytes())
    data[random.randrange(len(data))] ^= 1 << random.randrange(8)
    path.write_bytes(data)


def cut(folder: Path, random: random.Random) -> None:
    path = _any(folder, random)
    os.truncate(path, random.randrange(path.stat().st_size))


def emptied(folder: Path, random: random.Random) -> None:
    os.truncate(_any(folder, random), 0)


def zeroed(folder: Path, random: random.Random) -> None:
    path = _any(folder, random)
    path.write_bytes(bytes(path.stat().st_size))


def a_page_of_zeros(folder: Path, random: random.Random) -> None:
    path = _two(folder, random)[0]
    data = bytearray(path.read_bytes())
    start = random.randrange(len(data) - 4096)
    data[start : start + 4096] = bytes(4096)
    path.write_bytes(data)


def garbage(folder: Path, random: random.Random) -> None:
    path = _any(folder, random)
    path.write_bytes(random.randbytes(path.stat().st_size))


def appended(folder: Path, random: random.Random) -> None:
    with _any(folder, random).open("ab") as file:
        file.write(random.randbytes(random.randrange(1, 5000)))


def prepended(folder: Path, random: random.Random) -> None:
    path = _any(folder, random)
    path.write_bytes(random.randbytes(7) + path.read_bytes())


def exchanged(folder: Path, random: random.Random) -> None:
    one, two = _two(folder, random)
    other = one.read_bytes()
    one.write_bytes(two.read_bytes())
    two.write_bytes(other)


def another_version(folder: Path, random: random.Random) -> None:
    path = _any(folder, random)
    path.write_bytes(path.read_bytes().replace(b"cache 1", b"cache 0", 1))


def as_earlier_versions_wrote(folder: Path, random: random.Random) -> None:
    """Store a binary and its description in separate files."""
    path = _two(folder, random)[0]
    head, binary = path.read_bytes().split(b"\n", 2)[1:]
    path.with_suffix(".json").write_bytes(head[32:])
    path.write_bytes(binary)


def a_folder_in_place_of_a_file(folder: Path, random: random.Random) -> None:
    path = _any(folder, random)
    path.unlink()
    (path / "inside").mkdir(parents=True)
    (path / "inside/file").touch()


def a_link_to_another(folder: Path, random: random.Random) -> None:
    one, two = _two(folder, random)
    one.unlink()
    one.symlink_to(two)


def a_link_to_itself(folder: Path, random: random.Random) -> None:
    path = _any(folder, random)
    path.unlink()
    path.symlink_to(path)


def a_link_to_a_copy(folder: Path, random: random.Random) -> None:
    path = _any(folder, random)
    path.replace(folder.with_name("copy"))
    path.symlink_to(folder.with_name("copy"))


def one_file_for_two(folder: Path, random: random.Random) -> None:
    one, two = _two(folder, random)
    one.unlink()
    one.hardlink_to(two)


def a_pipe(folder: Path, random: random.Random) -> None:
    path = _any(folder, random)
    path.unlink()
    os.mkfifo(path)


def a_device(folder: Path, random: random.Random) -> None:
    path = _any(folder, random)
    path.unlink()
    path.symlink_to("/dev/zero")


def a_huge_file(folder: Path, random: random.Random) -> None:
    os.truncate(_any(folder, random), 1 << 40)


def writable_by_all(folder: Path, random: random.Random) -> None:
    _any(folder, random).chmod(0o666)


def readable_by_none(folder: Path, random: random.Random) -> None:
    path = _any(folder, random)
    path.chmod(0)
    if not os.geteuid():  # root can read it anyway
        os.chown(path, 12345, -1)


def removed(folder: Path, random: random.Random) -> None:
    shutil.rmtree(folder)


def a_room_removed(folder: Path, random: random.Random) -> None:
    shutil.rmtree(folder / random.choice(["devices", "programs"]))


def unsafe_for_its_group(folder: Path, random: random.Random) -> None:
    folder.chmod(0o770)


def unsafe_for_all(folder: Path, random: random.Random) -> None:
    (folder / "programs").chmod(0o707)


def unsafe_by_its_owner(folder: Path, random: random.Random) -> None:
    (folder / "programs").chmod(0o777)
    if not os.geteuid():
        (folder / "programs").chmod(0o700)
        os.chown(folder / "programs", 12345, -1)


def unsafe_by_a_link(folder: Path, random: random.Random) -> None:
    elsewhere = folder.with_name("elsewhere")
    (folder / "programs").rename(elsewhere)
    elsewhere.chmod(0o777)
    (folder / "programs").symlink_to(elsewhere)


def unsafe_as_a_file(folder: Path, random: random.Random) -> None:
    shutil.rmtree(folder)
    folder.write_bytes(b"no folder")


def unwritable_as_it_leads_nowhere(folder: Path, random: random.Random) -> None:
    shutil.rmtree(folder)
    folder.symlink_to(folder.with_name("gone"))


def unwritable_in_a_loop(folder: Path, random: random.Random) -> None:
    shutil.rmtree(folder / "programs")
    (folder / "programs").symlink_to(folder / "programs")


KINDS = [kind for name, kind in globals().items() if callable(kind) and not name.startswith("_") and name != "Path"]
