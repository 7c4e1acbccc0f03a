"""`python -m tests.faults [only=run] [every=1] [first=1]`: see the package."""

from __future__ import annotations

import sys
import time

from tests.faults.harness import faults, in_force, start
from tests.faults.scenarios import SCENARIOS


def main(arguments: list[str]) -> int:
    """Go through the faults, and say how many there were and what was wrong."""
    given = {"only": ",".join(SCENARIOS), "every": "1", "first": "1"}
    given |= dict(argument.split("=", 1) for argument in arguments)
    wrong = 0
    for name in given["only"].split(","):
        begin, count = time.monotonic(), {"stopped": 0, "failed": 0}
        for tried in faults(name, every=int(given["every"]), first=int(given["first"])):
            count[tried.how] += 1
            if tried.problem:
                wrong += 1
                print(f"{name}, call {tried.call}, {tried.how}: {tried.problem}", flush=True)
        took = time.monotonic() - begin
        print(f"{name}: {count['stopped']} calls stopped at, {count['failed']} failed, in {took:.0f} s", flush=True)
    print(f"{wrong} left something between old and new, or were not told in a line")
    return 1 if wrong else 0


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]) if in_force() else start(sys.argv[1:]))
