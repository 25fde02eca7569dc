"""Damages each specimen in a hundred ways, and checks how it is read.

A damaged file must be refused or read as if whole. If its format cannot detect damage, values must at least be valid.
Some readers might crash the interpreter: for them, this module is run as a program, with a folder and names of
specimens, and prints the faults.
"""

from __future__ import annotations

import json
import random
import sys
import time
import warnings
from pathlib import Path

import pyibr as ibr
from tests.io.specimens import CHECKED, OTHERS, WRITERS, reader, same

COUNT = 100
SLOW = 2.0  # most seconds to read a file of some kilobytes


def damaged(data: bytes, rng: random.Random, number: int) -> bytes:
    """Flip bits, truncate, change digits in the first part, or append garbage."""
    content = bytearray(data)
    kind = number % 4
    if kind == 0:
        for _ in range(rng.choice((1, 1, 3))):
            content[rng.randrange(len(content))] ^= 1 << rng.randrange(8)
    elif kind == 1:
        del content[rng.randrange(len(content)) :]
    elif kind == 2:
        digits = [place for place in range(min(len(content), 400)) if chr(content[place]).isdigit()] or [0]
        for _ in range(rng.choice((1, 2))):
            place = rng.choice(digits)
            content[place : place + 1] = rng.choice((b"9", b"0", b"7", b"9" * 11, b"9" * 5000, b"-1", b"1e9"))
    else:
        content += rng.randbytes(rng.randrange(1, 40))
    return bytes(content)


def wrongs(name: str, folder: Path) -> list[str]:
    """List the faults of a specimen's reader on damaged copies of the specimen."""
    path = folder / name
    (WRITERS | OTHERS)[name](path)
    read, whole, rng = reader(name), path.read_bytes(), random.Random(name)
    original, found = read(path), list[str]()
    for number in range(COUNT):
        path.write_bytes(damaged(whole, rng, number))
        start = time.perf_counter()
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                other = read(path)
            if name in CHECKED and not same(original, other):
                found.append(f"{name} {number}: another content")
        except ibr.Error:
            pass
        except Exception as error:
            found.append(f"{name} {number}: {type(error).__name__}: {error}"[:300])
        if time.perf_counter() - start > SLOW:
            found.append(f"{name} {number}: {time.perf_counter() - start:.1f} s")
    return found


if __name__ == "__main__":
    print(json.dumps([wrong for name in sys.argv[2:] for wrong in wrongs(name, Path(sys.argv[1]))]))
