"""Measures which faults the tests notice: changes random places of the package, one at a time, and tests each change.

    python tests/benchmarks/mutants.py DIR --count 100 --seed 28          a sample, with the quick tests
    python tests/benchmarks/mutants.py DIR --count 100 --seed 28 --slow   what survives meets the room's slow tests too
    python tests/benchmarks/mutants.py DIR --only surface/path.py: --tests tests/surface/test_path.py
                                                                          one module, with some tests alone

A change flips a sign, a comparison, a condition or a flag, moves a constant or the end of a slice, swaps min and max,
or makes a predicate constant. Annotations, messages of errors and decorators of dataclasses stay as they are.

First the quick tests run once under coverage (`pip install coverage`), each file in a process of its own, because files
share bakes. The folder DIR keeps this map and copies of the tree; nothing is written to the real tree. A change meets
the tests that run its line, those of its own room first and fast ones before others, and then the rest of the tests
of these files, which may look at the same bakes. A person must judge which of the survivors change no behaviour.
"""

import argparse
import ast
import copy
import json
import os
import queue
import random
import re
import shutil
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import accumulate
from pathlib import Path
from typing import Any

import pytest
from coverage import Coverage, CoverageData

ROOT = Path(__file__).resolve().parents[2]
MOST = 70.0  # seconds under coverage of the quick tests that a change meets
NETS = ("tests/system/test_goldens.py", "tests/review/preview/test_pictures.py")  # tests that look at much at once
PATIENCE = 90.0  # seconds that tests may take beyond four times their usual time: a change may make a loop endless
SLOW_PATIENCE = 1200.0  # seconds that the slow tests of a room may take
UNTOUCHED = ("annotation", "returns", "exc", "msg", "op", "ops", "ctx")  # fields of nodes
COVERAGE = """
[run]
data_file = {work}/coverage
parallel = true
source = wrinklecli
relative_files = true
context = ${{MUTANTS_TEST-}}
disable_warnings = no-data-collected, module-not-imported, module-not-measured
"""

OPERATORS: dict[type, type] = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.FloorDiv: ast.Mult,
    ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.Lt, ast.GtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In, ast.And: ast.Or, ast.Or: ast.And,
}  # fmt: skip
NAMES = {"min": "max", "minimum": "maximum", "any": "all", "argmin": "argmax"}
NAMES |= {new: old for old, new in NAMES.items()}
Lines = tuple[int, int] | None


def variants(node: ast.AST) -> Iterator[ast.AST]:
    """All changes of a node, each as a new node."""

    def with_(**fields: Any) -> ast.AST:
        twin = copy.copy(node)
        for name, value in fields.items():
            setattr(twin, name, value)
        return twin

    match node:
        case ast.BinOp(left=ast.Constant(value=str()) | ast.JoinedStr()) | ast.BinOp(right=ast.JoinedStr()):
            return
        case ast.BinOp(op=op) | ast.AugAssign(op=op) | ast.BoolOp(op=op) if type(op) in OPERATORS:
            yield with_(op=OPERATORS[type(op)]())
        case ast.Compare(ops=ops):
            for i, op in enumerate(ops):
                yield with_(ops=[*ops[:i], OPERATORS[type(op)](), *ops[i + 1 :]])
        case ast.UnaryOp(op=ast.Not() | ast.USub(), operand=operand):
            yield operand
        case ast.Constant(value=bool() as value):
            yield with_(value=not value)
        case ast.Constant(value=int() as value):
            yield from (with_(value=other) for other in (value + 1, value - 1))
        case ast.Constant(value=float() as value):
            yield from (with_(value=other) for other in (-value, 0.0) if other != value)
        case ast.Call(func=ast.Name(id=name)) if name in NAMES:
            yield with_(func=ast.Name(NAMES[name]))
        case ast.Call(func=ast.Attribute(attr=name, value=value)) if name in NAMES:
            yield with_(func=ast.Attribute(value, NAMES[name]))
        case ast.Slice(upper=ast.expr() as upper) if not isinstance(upper, ast.Constant | ast.UnaryOp):
            yield with_(upper=ast.BinOp(upper, ast.Sub(), ast.Constant(1)))
        case ast.FunctionDef(returns=ast.Name(id="bool")):
            yield from (with_(body=[ast.Return(ast.Constant(value))]) for value in (True, False))


def nodes_of(node: ast.AST, lines: Lines = None, *, late: bool = False) -> Iterator[tuple[ast.AST, int, Lines]]:
    """All nodes below a node that may change, each with its line and the lines of its statement.

    Args:
        node: A module, or a node in it.
        lines: First and last line of the statement around the node.
        late: The node is in the body of a function. Lines of other statements are None: they run when the module is
            imported, before any test.
    """
    for field, value in ast.iter_fields(node):
        if field in UNTOUCHED or (field == "decorator_list" and "dataclass" in " ".join(map(ast.unparse, value))):
            continue
        for each in value if isinstance(value, list) else [value]:
            if not isinstance(each, ast.AST) or isinstance(each, ast.JoinedStr):
                continue
            if isinstance(each, ast.keyword) and each.arg == "strict":  # an assertion of zip
                continue
            span = lines
            if isinstance(each, ast.FunctionDef):
                span = (each.body[0].lineno, each.end_lineno or each.lineno)
            elif isinstance(each, ast.stmt):  # a compound statement is its head alone
                body = getattr(each, "body", None)
                span = (each.lineno, max(each.lineno, body[0].lineno - 1) if body else each.end_lineno or each.lineno)
            late_here = late or (isinstance(node, ast.FunctionDef) and field == "body")
            if next(variants(each), None) is not None:
                line = getattr(each, "lineno", span[0] if span else 1)
                yield each, line, span if late_here or isinstance(each, ast.FunctionDef) else None
            yield from nodes_of(each, span, late=late_here)


class Replacement(ast.NodeTransformer):
    """Puts one node in the place of another."""

    def __init__(self, old: ast.AST, new: ast.AST) -> None:
        self._old, self._new = old, new

    def visit(self, node: ast.AST) -> ast.AST:
        return self._new if node is self._old else self.generic_visit(node)


@dataclass(frozen=True)
class Mutant:
    """A changed module: path below the tree, line and statement of the place, old and new expression, new text."""

    path: str
    line: int
    lines: Lines
    change: str
    text: str


def mutants(tree: Path, count: int, seed: int, only: str) -> Iterator[Mutant]:
    """A random change at each of `count` random places whose `path:line:` contains `only`."""
    paths = sorted(str(path.relative_to(tree)) for path in (tree / "wrinklecli").rglob("*.py"))
    known = [
        (path, k)
        for path in paths
        for k, (_, line, _) in enumerate(nodes_of(ast.parse((tree / path).read_text())))
        if only in f"{path}:{line}:"
    ]
    chance = random.Random(seed)
    for path, k in chance.sample(known, min(count, len(known))):
        module = ast.parse((tree / path).read_text())
        old, line, lines = list(nodes_of(module))[k]
        new = chance.choice(list(variants(old)))
        change = " → ".join(ast.unparse(ast.fix_missing_locations(each)) for each in (old, new))
        if isinstance(new, ast.FunctionDef):
            change = f"{new.name}(): {ast.unparse(new.body[0])}"
        changed = Replacement(old, new).visit(module)
        yield Mutant(path, line, lines, change, ast.unparse(ast.fix_missing_locations(changed)))


class Recorder:
    """A plugin of pytest that tells coverage which test runs, also in processes that a test starts."""

    def __init__(self) -> None:
        self.seconds: Counter[str] = Counter()

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtest_setup(self, item: pytest.Item) -> None:
        os.environ["MUTANTS_TEST"] = item.nodeid
        current = Coverage.current()
        assert current is not None
        current.switch_context(item.nodeid)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        self.seconds[report.nodeid] += report.duration

    def pytest_sessionfinish(self) -> None:
        Path(os.environ["MUTANTS_SECONDS"]).write_text(json.dumps(self.seconds))


class Bench:
    """Copies of the tree, and a map of the quick tests: how long each takes, and which lines it runs."""

    def __init__(self, work: Path, jobs: int) -> None:
        """Copy the tree `jobs` times into the folder `work`, where this has not been done."""
        self.work, self.jobs = work, jobs
        self._idle: queue.Queue[Path] = queue.Queue()
        named = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
        for job in range(jobs):
            tree = work / f"tree-{job}"
            for name in [] if tree.exists() else named.split():
                (tree / name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(ROOT / name, tree / name)
            modules = "tests/clients/node_modules"
            if (ROOT / modules).exists() and not (tree / modules).exists():
                (tree / modules).symlink_to(ROOT / modules)
            self._idle.put(tree)

    @contextmanager
    def tree(self) -> Iterator[Path]:
        """A copy that nobody else uses meanwhile."""
        tree = self._idle.get()
        yield tree
        self._idle.put(tree)

    def _run(self, tree: Path, *command: str, limit: float | None = None, **more: str) -> tuple[int, str]:
        where: dict[str, Any] = {"cwd": tree, "env": os.environ | {"PYTHONPATH": str(tree)} | more}
        ran = subprocess.run(
            [sys.executable, *command], capture_output=True, text=True, timeout=limit, check=False, **where
        )
        return ran.returncode, ran.stdout

    def measure(self) -> None:
        """Make the map."""
        settings = self.work / "coveragerc"
        settings.write_text(COVERAGE.format(work=self.work))

        def record(path: str) -> None:
            seconds = self.work / f"seconds-{path.replace('/', '-')}.json"
            with self.tree() as tree:
                more = {"COVERAGE_PROCESS_START": str(settings), "MUTANTS_SECONDS": str(seconds)}
                self._run(tree, __file__, path, "--record", **more)

        tree = self.work / "tree-0"
        with ThreadPoolExecutor(self.jobs) as pool:
            list(pool.map(record, sorted(str(path.relative_to(tree)) for path in tree.rglob("tests/**/test_*.py"))))
        self._run(tree, "-m", "coverage", "combine", "-q", f"--rcfile={settings}")

    def tests_of(self, mutant: Mutant) -> list[str]:
        """The quick tests that a change meets, in their order."""
        seconds, data = self.seconds(), CoverageData(str(self.work / "coverage"))
        data.read()
        first, last = mutant.lines or (0, sys.maxsize)
        lines = data.contexts_by_lineno(mutant.path)
        own = {name.strip("|") for line, names in lines.items() if first <= line <= last for name in names}
        own &= seconds.keys()
        room = f"tests/{Path(mutant.path).parts[1]}/"
        files = {test.partition("::")[0] for test in own}
        every = [test for test in seconds if test.partition("::")[0] in files or (not own and test.startswith(room))]
        every.sort(key=lambda test: (test not in own, not test.startswith((room, *NETS)), seconds[test]))
        return [
            test for test, past in zip(every, accumulate(seconds[test] for test in every), strict=True) if past <= MOST
        ]

    def seconds(self) -> dict[str, float]:
        """The time of each quick test under coverage."""
        found = (json.loads(path.read_text()) for path in self.work.glob("seconds-*.json"))
        return {test: time for each in found for test, time in each.items()}

    def failing(self, tree: Path, arguments: list[str], limit: float = SLOW_PATIENCE) -> str:
        """The first test that fails, as pytest is run with some arguments; empty where all pass."""
        try:
            code, said = self._run(tree, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", *arguments, limit=limit)
        except subprocess.TimeoutExpired:
            return "time limit"
        failed = re.search(r"^(?:FAILED|ERROR) (.+?)(?: - |$)", said, re.MULTILINE)
        return failed[1] if failed else "" if code in (0, 5) else f"exit code {code}"

    def judge(self, mutant: Mutant, runs: list[tuple[str, list[str], float]]) -> str:
        """The kind of the run that notices a change, and the test; a run has a kind, arguments and a time limit."""
        with self.tree() as tree:
            place, listed = tree / mutant.path, self.work / f"{tree.name}.txt"
            original = place.read_text()
            for kind, arguments, limit in runs:
                listed.write_text("\n".join(arguments))
                place.write_text(mutant.text)
                try:
                    test = self.failing(tree, [f"@{listed}"], limit)
                finally:
                    place.write_text(original)
                if "::" in test and self.failing(tree, ["-m", "slow or not slow", test]):
                    return f"FAILS WITHOUT THE CHANGE {test}"
                if test:
                    return f"{kind} {test}"
            return "SURVIVED"


def main() -> None:
    """Measure a sample, and print each change and how many were noticed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("work", type=Path, help="a folder for the map and for copies of the tree")
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--seed", type=int, default=28)
    parser.add_argument("--only", default="")
    parser.add_argument("--tests", nargs="*", help="in place of those that the map gives")
    parser.add_argument("--slow", action="store_true")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--record", action="store_true", help=argparse.SUPPRESS)
    chosen = parser.parse_args()
    if chosen.record:
        raise SystemExit(pytest.main(["-q", "-p", "no:cacheprovider", str(chosen.work)], plugins=[Recorder()]))
    bench = Bench(chosen.work.resolve(), chosen.jobs)
    if chosen.tests is None and not (bench.work / "coverage").exists():
        bench.measure()
    picked = list(mutants(bench.work / "tree-0", chosen.count, chosen.seed, chosen.only))
    seconds = bench.seconds()

    def runs(mutant: Mutant) -> Iterator[tuple[str, list[str], float]]:
        quick = bench.tests_of(mutant) if chosen.tests is None else chosen.tests
        if quick:
            yield "quick", quick, PATIENCE + 4.0 * sum(seconds.get(test, PATIENCE) for test in quick)
        folder = f"tests/{Path(mutant.path).parts[1]}"
        if chosen.slow and (bench.work / "tree-0" / folder).is_dir():
            yield "slow", ["-m", "slow", folder], SLOW_PATIENCE

    def judge(mutant: Mutant) -> str:
        verdict = bench.judge(mutant, list(runs(mutant)))
        print(f"{mutant.path}:{mutant.line}: {mutant.change}: {verdict}", flush=True)
        return verdict.partition(" ")[0]

    with ThreadPoolExecutor(bench.jobs) as pool:
        print(Counter(pool.map(judge, picked)))


if __name__ == "__main__":
    main()
