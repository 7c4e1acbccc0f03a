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
from tests.fuzzing.trial import kind_of, work, write_spoilt

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

    while number < first + count:
        ours, theirs = get_context("spawn").Pipe(duplex=False)
        worker = get_context("spawn").Process(target=work, args=(theirs, number, first + count, seed, given["kind"]))
        worker.start()
        theirs.close()
        with contextlib.suppress(EOFError):
            while ours.poll(PATIENCE_S):
                number, outcome, problem = ours.recv()
                note(number, outcome, problem)
                number += 1
                if time.monotonic() - told > 60:
                    told = time.monotonic()
                    print(f"... {number - first:,} of {count:,} in {told - begin:.0f} s", flush=True)
        ended = not worker.is_alive() or (worker.join(5) is None and worker.exitcode is not None)
        worker.kill()
        worker.join()
        if number < first + count:
            why = f"ended its process ({worker.exitcode})" if ended else f"did not end within {PATIENCE_S:g} s"
            note(number, "failed", f"{kind_of(number, kinds)}: {why}")
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
