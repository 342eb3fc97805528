"""Every command attacked, many thousand times: `python tests/hostile.py FIRST COUNT [--only COMMAND] [--keep]`.

A case is a number, and always the same attack. Most cases damage an asset or its tools; others damage or forge
manifests and caches, plant links and pipes, serve URLs that stop or swell, send messages to the page of `edit`,
change files that `preview --watch` watches, let the disk fail, run a command beside itself, or kill it in the middle.
All options of the commands take part.

Prints each way of failing once, with the number of its first case, and ends with 1 where there is any. Cases run in
processes of their own kind, with little memory, so that one which takes the process down is found too. `--keep` adds
what failed, shortened, to tests/data/hostile.jsonl, whose cases are tests. 20,000 cases take half an hour of a
processor.
"""

import argparse
import json
import re
import resource
import shutil
import subprocess
import sys
import traceback
import warnings
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from tempfile import mkdtemp

sys.path[0] = str(Path(__file__).resolve().parent)

from kit.attack import attack  # noqa: E402
from kit.cases import Case, make_case  # noqa: E402
from kit.places import ROOT  # noqa: E402

_MEMORY = 5 * 2**30 // 2  # bytes of address space of a process
_BATCH = 250  # cases of a process, for it to show that it goes on


def outcome(case: Case) -> str:
    """How a case ended: its exit code, or `FAILED` and the way of it."""
    # A way of failing names no folder and no port, which are others each time.
    return re.sub(r"hostile-\w+|(?<=127\.0\.0\.1:)\d+|(?<=kept/)\w+/\w+/\w+", "…", _outcome(case))


def _outcome(case: Case) -> str:
    folder = Path(mkdtemp(prefix="hostile-"))
    try:
        return str(attack(case, folder))
    except BaseException as error:
        if isinstance(error, KeyboardInterrupt):
            raise
        own = [each for each in traceback.extract_tb(error.__traceback__) if "wrinklecli" in each.filename]
        text = [line for line in str(error).splitlines() if line]
        if '  File "' in str(error):
            places = [line.strip() for line in text if line.startswith('  File "') and "wrinklecli" in line]
            last = next((line for line in reversed(text) if line[:1].isalpha() and "Error" in line), text[-1])
            return f"FAILED {last[:150]} @ {places[-1].rpartition('/')[2] if places else ''}"
        at = (
            f" @ {Path(own[-1].filename).name}:{own[-1].lineno}"
            if own and not isinstance(error, AssertionError)
            else ""
        )
        return f"FAILED {case.arguments[0]}: {type(error).__name__}: {' '.join(text)[:170]}{at}"
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def work(first: int, count: int, only: str | None) -> None:
    """Run cases and print how each ended, as a worker."""
    resource.setrlimit(resource.RLIMIT_AS, (_MEMORY, _MEMORY))
    warnings.simplefilter("error")
    for number in range(first, first + count):
        case = make_case(number)
        print(json.dumps([number, outcome(case) if only in (None, case.arguments[0]) else "-"]), flush=True)


def outcomes(first: int, count: int, only: str | None) -> Iterator[tuple[int, str]]:
    """Run cases in workers; one that dies takes its case with it."""
    number = first
    while number < first + count:
        batch = min(_BATCH, first + count - number)
        worker = [sys.executable, __file__, str(number), str(batch), "--worker", *(["--only", only] if only else [])]
        ended = subprocess.run(worker, stdout=subprocess.PIPE, text=True, check=False)
        for line in ended.stdout.splitlines():
            done, text = json.loads(line)
            yield done, text
            number = done + 1
            batch -= 1
        if batch:
            if ended.returncode == 1:
                raise SystemExit("a fault of the attack's own")
            yield number, f"FAILED the process died: {ended.returncode}"
            number += 1


def shortened(case: Case, way: str) -> Case:
    """A case with as few edits as fail in the same way."""
    edits = list(case.edits)
    for edit in list(edits):
        fewer = replace(case, edits=[each for each in edits if each is not edit])
        if outcome(fewer) == way:
            edits = list(fewer.edits)
    return replace(case, edits=edits)


def main() -> int:
    """Run cases; 1 where any failed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("first", type=int)
    parser.add_argument("count", type=int)
    parser.add_argument("--keep", action="store_true")
    parser.add_argument("--only", metavar="COMMAND", help="leave out the cases of other commands")
    parser.add_argument("--worker", action="store_true")
    given = parser.parse_args()
    if given.worker:
        work(given.first, given.count, given.only)
        return 0
    tally, ways = Counter[str](), dict[str, list[int]]()
    for number, text in outcomes(given.first, given.count, given.only):
        tally[text.partition(" ")[0]] += 1
        if text.startswith("FAILED"):
            if text not in ways:
                print(number, text, flush=True)
            ways.setdefault(text, []).append(number)
        if (number + 1 - given.first) % _BATCH == 0:
            print(f"{number + 1 - given.first} cases:", dict(tally), flush=True)
    for way, numbers in ways.items():
        print(len(numbers), numbers[:5], way)
        if given.keep:
            with (ROOT / "tests" / "data" / "hostile.jsonl").open("a") as kept:
                kept.write(shortened(make_case(numbers[0]), way).dumped() + "\n")
    print(f"{given.count} cases, {tally['FAILED']} failed")
    return int(bool(ways))


if __name__ == "__main__":
    sys.exit(main())
