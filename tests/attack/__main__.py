"""Makes random calls and checks the law for all calls: `python -m tests.attack warp --first 0 --count 1000`."""

from __future__ import annotations

import argparse
import sys
import time
import traceback

from tests.attack.arguments import MAKERS
from tests.attack.law import judge, reproduced_by
from tests.attack.rays import judge_rays


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.attack", description="Random calls against the law.")
    parser.add_argument("kind", choices=sorted([*MAKERS, "rays"]))
    parser.add_argument("--first", type=int, default=0, help="the first seed")
    parser.add_argument("--count", type=int, default=1000, help="number of seeds")
    given = parser.parse_args()
    broken, sound, start = 0, 0, time.monotonic()
    for seed in range(given.first, given.first + given.count):
        print(f"seed {seed}", end="\r", file=sys.stderr, flush=True)
        try:
            told = judge_rays(seed) if given.kind == "rays" else judge(given.kind, seed)
        except Exception as error:
            broken += 1
            where = traceback.extract_tb(error.__traceback__)[-1]
            words = " ".join(f"{type(error).__name__} {error}".split())[:200]
            print(f"{reproduced_by(given.kind, seed)}: {words} ({where.filename}:{where.lineno})", flush=True)
            continue
        sound += told == "sound"
        if given.count == 1:
            print(f"{reproduced_by(given.kind, seed)}: {told}")
    took = time.monotonic() - start
    print(f"{given.count} calls of {given.kind}: {sound} sound, {broken} broken, {took:.0f} s")
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
