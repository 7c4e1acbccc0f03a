"""`python -m tests.fuzzing [count=100000] [seed=0] [kind=] [first=0] [out=fuzz-failures]`: see the package."""

from __future__ import annotations

import contextlib
import json
import shutil
import sys
import time
from collections import Counter
from multiprocessing import get_context
from pathlib import Path

from tests.fuzzing.readers import readers
from tests.fuzzing.trial import MEMORY, kind_of, work, write_spoilt

PATIENCE_S = 90.0


def main(arguments: list[str]) -> int:
    """Fuzz, and say what failed."""
    given = {"count": "100000", "seed": "0", "kind": "", "first": "0", "out": "fuzz-failures"}
    given |= dict(argument.split("=", 1) for argument in arguments)
    count, seed, first = int(given["count"]), int(given["seed"]), int(given["first"])
    kinds, out = readers(given["kind"]), Path(given["out"])
    outcomes: Counter[str] = Counter()
    problems: dict[str, list[int]] = {}
    begin, number, told = time.monotonic(), first, time.monotonic()

    def note(at: int, outcome: str, problem: str) -> None:
        outcomes[outcome] += 1
        outcomes[f"{kind_of(at, kinds)} {outcome}"] += 1
        if outcome == "failed":
            numbers = problems.setdefault(problem, [])
            numbers.append(at)
            if len(numbers) == 1:
                print(f"{at}: {problem}", flush=True)
                write_spoilt(kinds, seed, at, out / str(at))

    def go_on(last: int, *, memory: int = MEMORY) -> str:
        """Do trials in a process of their own up to one that ends it, and return how it ended."""
        nonlocal number, told
        ours, theirs = get_context("spawn").Pipe(duplex=False)
        arguments = (theirs, number, last, seed, given["kind"], memory)
        worker = get_context("spawn").Process(target=work, args=arguments)
        worker.start()
        theirs.close()
        waited = True
        with contextlib.suppress(EOFError):
            while waited := ours.poll(PATIENCE_S):
                number, outcome, problem = ours.recv()
                note(number, outcome, problem)
                number += 1
                if time.monotonic() - told > 60:
                    told = time.monotonic()
                    print(f"... {number - first:,} of {count:,} in {told - begin:.0f} s", flush=True)
        if not waited:
            worker.kill()
        worker.join()
        return f"ended its process ({worker.exitcode})" if waited else f"did not end within {PATIENCE_S:g} s"

    while number < first + count:
        go_on(first + count)
        # once more alone, and with all the memory there is: a library that lacks memory may end its process
        at = number
        if at < first + count:
            ended = go_on(number + 1, memory=0)
            if number == at:
                note(number, "failed", f"{kind_of(number, kinds)}: {ended}")
                number += 1
    total = {k: outcomes[k] for k in ("read", "refused", "failed")}
    print(json.dumps({**total, "kinds": len(kinds), "seconds": round(time.monotonic() - begin)}))
    for kind in sorted(kinds):
        print(f"  {kind}: " + ", ".join(f"{outcomes[f'{kind} {k}']:,} {k}" for k in total))
    if problems:
        (out / "problems.json").write_text(json.dumps(problems, indent=1))
        print(f"{len(problems)} kinds of failure, one input of each in {out}", file=sys.stderr)
    elif out.is_dir() and not any(out.iterdir()):
        shutil.rmtree(out)
    return 1 if problems else 0


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
