"""Measures which faults the tests notice: changes random places of the package, one at a time, and tests each change.

    python tests/benchmarks/mutants.py DIR --count 100 --seed 28          a sample, with the quick tests
    python tests/benchmarks/mutants.py DIR --count 100 --seed 28 --slow   what survives meets the room's slow tests too
    python tests/benchmarks/mutants.py DIR --only surface/path.py: --tests tests/surface/test_path.py
                                                                          one module, with some tests alone

A change flips a sign, a comparison, a condition or a flag, moves a constant or the end of a slice, swaps min and max,
or makes a predicate constant. Annotations, messages of errors and decorators of dataclasses stay as they are.

A change meets the quick tests that run its line, the nearest first, and tests that look at much at once, as these may
look at what another test has made. Near are files that import its module or are named like it, those of its folder
within a room, files that import a module that imports it, and the other files of its room. They stop after 40 s of
processor, half of what all quick tests take, so that the figure is a lower bound. Which tests run a line is measured
once for DIR by the package `coverage`, in 6 minutes of processor. DIR keeps copies of the tree; nothing is written to
the real tree. A person must judge which of the survivors change no behaviour.
"""

import argparse
import ast
import copy
import json
import multiprocessing
import os
import queue
import random
import re
import shutil
import subprocess
import sys
from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]
MOST = 40.0  # seconds of processor of the quick tests that a change meets
FAR = 8  # files of tests that run a change, but are not near it: all would take as long to read as the time they have
# Files with tests that look at much at once.
NETS = ("test_goldens.py", "test_pictures.py")
PATIENCE = 1200.0  # seconds that tests may take on a busy machine: a change may make a loop endless
# Processes have imported what pytest would rewrite.
OPTIONS = ("-q", "-p", "no:cacheprovider", "-W", "ignore::pytest.PytestAssertRewriteWarning")
UNTOUCHED = ("annotation", "returns", "exc", "msg", "op", "ops", "ctx")  # fields of nodes

# Processes fork from one that has imported what tests need, but nothing of the package: an import takes a second.
FORKS = multiprocessing.get_context("forkserver")
FORKS.set_forkserver_preload(["hypothesis.strategies", "pytest", "scipy.sparse.linalg", "scipy.spatial", "yaml", "igl"])

Json = dict[str, Any]
OPERATORS: dict[type, type] = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.FloorDiv: ast.Mult,
    ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.Lt, ast.GtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In, ast.And: ast.Or, ast.Or: ast.And,
}  # fmt: skip
NAMES = {"min": "max", "minimum": "maximum", "any": "all", "argmin": "argmax"}
NAMES |= {new: old for old, new in NAMES.items()}


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


def nodes_of(node: ast.AST, line: int = 1, run: range = range(0)) -> Iterator[tuple[ast.AST, int, range]]:
    """All nodes below a node at a line that may change, each with its line, and the lines of its statement.

    A statement that an import runs has none. Those of one with a body end before it.
    """
    for field, value in ast.iter_fields(node):
        if field in UNTOUCHED or (field == "decorator_list" and "dataclass" in " ".join(map(ast.unparse, value))):
            continue
        for each in value if isinstance(value, list) else [value]:
            if not isinstance(each, ast.AST) or isinstance(each, ast.JoinedStr):
                continue
            if isinstance(each, ast.keyword) and each.arg == "strict":  # an assertion of zip
                continue
            here = getattr(each, "lineno", line)
            inside = run or (isinstance(node, ast.FunctionDef) and field == "body")
            own = _lines_of(each) if inside and isinstance(each, ast.stmt) else run
            if next(variants(each), None) is not None:
                yield each, here, _lines_of(each.body[0]) if isinstance(each, ast.FunctionDef) else own
            yield from nodes_of(each, here, own)


def _lines_of(statement: ast.stmt) -> range:
    """The lines of a statement without those of its body."""
    body = getattr(statement, "body", None)
    last = body[0].lineno - 1 if body else statement.end_lineno or 0
    return range(statement.lineno, max(last, statement.lineno) + 1)


class Replacement(ast.NodeTransformer):
    """Puts one node in the place of another."""

    def __init__(self, old: ast.AST, new: ast.AST) -> None:
        self._old, self._new = old, new

    def visit(self, node: ast.AST) -> ast.AST:
        return self._new if node is self._old else self.generic_visit(node)


@dataclass(frozen=True)
class Mutant:
    """A changed module: path below the tree, line of the place, lines of its statement, what changes, new text."""

    path: str
    line: int
    lines: range
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


class Budget:
    """A plugin of pytest that begins with some tests, and skips what is left once the processor has worked long enough.

    Of other tests those that look at much at once are left. What tests start counts too.
    """

    def __init__(self, first: Collection[str]) -> None:
        self._first = frozenset(first)

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        if self._first:
            items[:] = [item for item in items if item.nodeid in self._first or looks_at_much(item.nodeid)]
            items.sort(key=lambda item: item.nodeid not in self._first)

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtest_setup(self) -> None:
        if sum(os.times()[:4]) > MOST:
            pytest.skip("near tests have had their time")


def looks_at_much(test: str) -> bool:
    """True for tests, or a file with tests, that look at much at once."""
    return test.partition("::")[0].endswith(NETS)


class Lines:
    """A plugin of pytest that notes which lines of the package each test runs."""

    def __init__(self, tree: Path) -> None:
        from coverage import Coverage

        self._coverage = Coverage(data_file=None, source=[str(tree / "wrinklecli")], config_file=False)
        self._coverage.start()

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtest_logstart(self, nodeid: str) -> None:
        self._coverage.switch_context(nodeid)

    @pytest.hookimpl(trylast=True)
    def pytest_runtest_logfinish(self) -> None:
        self._coverage.switch_context("")

    def found(self, tree: Path) -> Json:
        """The names of the tests, and the numbers of those that run each line, by path and line."""
        self._coverage.stop()
        data = self._coverage.get_data()
        names = sorted(filter(None, data.measured_contexts()))
        numbers = {name: number for number, name in enumerate(names)}
        lines = {
            str(Path(path).relative_to(tree)): {
                line: sorted(numbers[name] for name in own if name)
                for line, own in data.contexts_by_lineno(path).items()
            }
            for path in data.measured_files()
        }
        return {"tests": names, "lines": lines}


def measure_lines(tree: Path, out: Path) -> None:
    """Run all quick tests in a tree, in a process of its own, and write which lines each of them runs."""
    enter(tree, out.with_suffix(".txt"))
    plugin = Lines(tree)
    pytest.main([*OPTIONS], plugins=[plugin])
    out.write_text(json.dumps(plugin.found(tree)))


def run_tests(tree: Path, run: "Run", said: Path) -> None:
    """Run pytest in a tree, in a process of its own, until a test fails; what it says goes to a file."""
    enter(tree, said)
    code = pytest.main(["-x", *OPTIONS, *run.arguments], plugins=[] if "-m" in run.arguments else [Budget(run.first)])
    sys.stdout.flush()
    sys.exit(code)


def enter(tree: Path, said: Path) -> None:
    """Let this process run in a tree, and say into a file what it says."""
    os.chdir(tree)
    os.environ["PYTHONPATH"] = str(tree)
    sys.path.insert(0, str(tree))
    with said.open("w") as file:
        for stream in (1, 2):
            os.dup2(file.fileno(), stream)


@cache
def imports(tree: Path, folder: str, pattern: str) -> dict[str, frozenset[str]]:
    """The files of a folder that fit a pattern, and the modules and names that each imports."""
    files = {}
    for path in sorted((tree / folder).rglob(pattern)):
        nodes = [node for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.ImportFrom)]
        names = {f"{node.module}.{alias.name}" for node in nodes for alias in node.names}
        files[str(path.relative_to(tree))] = frozenset({f"{node.module}" for node in nodes} | names)
    return files


def near_tests(tree: Path, path: str) -> list[str]:
    """The test files that a change of a module meets, in their order."""
    parts = Path(path).with_suffix("").parts
    files = imports(tree, "tests", "test_*.py")

    def words(name: str) -> set[str]:
        return {word.removesuffix("s") for word in re.findall(r"[a-z0-9]+", name)}

    def importing(module: str) -> list[str]:
        return [name for name in files if module in files[name]]

    importers = importing(".".join(parts))
    own = [name for name in files if name.startswith(f"tests/{parts[1]}")]
    namesakes = [name for name in own if words(parts[-1]) & words(Path(name).stem)]
    readers = [name for name, found in imports(tree, "wrinklecli", "*.py").items() if ".".join(parts) in found]
    of_readers = [name for each in readers for name in importing(".".join(Path(each).with_suffix("").parts))]
    folder = [name for name in own if Path(name).parts[1:-1] == parts[1:-1]]
    nets = sorted(filter(looks_at_much, files), key=lambda name: name not in own)
    inner, outer = (folder, []) if len(parts) > 3 else ([], folder)  # those of an effect are few
    own_importers = [name for name in importers if name in own]
    order = [*own_importers, *namesakes, *importers, *inner, *nets, *of_readers, *outer, *own]
    return list(dict.fromkeys(order))


@dataclass(frozen=True)
class Run:
    """A run of pytest: its kind, its arguments, and the tests that it begins with."""

    kind: str
    arguments: Sequence[str]
    first: Collection[str] = ()


def quick_run(tree: Path, measured: Json, mutant: Mutant) -> Run:
    """The run of the quick tests that a change meets, as `measure_lines` has found them; all near ones if none runs it.

    What an import runs is met by the tests that run any line of its module.
    """
    of_module = measured["lines"].get(mutant.path, {})
    rows = [of_module.get(str(line), []) for line in mutant.lines] if mutant.lines else of_module.values()
    running = {measured["tests"][number] for row in rows for number in row}
    near = near_tests(tree, mutant.path)
    far = Counter(file for name in running if (file := name.partition("::")[0]) not in near)
    files = {name.partition("::")[0] for name in running}
    near = [name for name in near if name in files or looks_at_much(name) or not files]
    return Run("quick", [*near, *(file for file, _ in far.most_common(FAR))], running)


class Bench:
    """Copies of the tree in which changes are tested."""

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

    @property
    def lines(self) -> Json:
        """The quick tests that run each line, measured where that has not been done."""
        out = self.work / "lines.json"
        if not out.exists():
            process = FORKS.Process(target=measure_lines, args=(self.work / "tree-0", out))
            process.start()
            process.join()
        return json.loads(out.read_text())

    @contextmanager
    def tree(self) -> Iterator[Path]:
        """A copy that nobody else uses meanwhile."""
        tree = self._idle.get()
        yield tree
        self._idle.put(tree)

    def failing(self, tree: Path, run: Run) -> str:
        """The first test that fails in a run; empty where all pass."""
        said = self.work / f"{tree.name}.txt"
        process = FORKS.Process(target=run_tests, args=(tree, run, said))
        process.start()
        process.join(PATIENCE)
        if process.exitcode is None:
            process.kill()
            return "time limit"
        failed = re.search(r"^(?:FAILED|ERROR) (.+?)(?: - |$)", said.read_text(), re.MULTILINE)
        return failed[1] if failed else "" if process.exitcode in (0, 5) else f"exit code {process.exitcode}"

    def judge(self, mutant: Mutant, runs: Sequence[Run]) -> str:
        """The kind of the run that notices a change, and the test."""
        with self.tree() as tree:
            place = tree / mutant.path
            original = place.read_text()
            for run in runs:
                place.write_text(mutant.text)
                try:
                    test = self.failing(tree, run)
                finally:
                    place.write_text(original)
                # A file that cannot be read is named in place of a test. Names of cases may hold what ends a summary's.
                whole = test.partition("[")[0]
                again = ["-m", "slow or not slow", whole] if "::" in test else ["-m", "slow", "--collect-only", test]
                if test.startswith("tests/") and self.failing(tree, Run("", again)):
                    return f"FAILS WITHOUT THE CHANGE {test}"
                if test:
                    return f"{run.kind} {test}"
            return "SURVIVED"


def main() -> None:
    """Measure a sample, and print each change and how many were noticed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("work", type=Path, help="a folder for copies of the tree")
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--seed", type=int, default=28)
    parser.add_argument("--only", default="")
    parser.add_argument("--tests", nargs="*", help="in place of those near a change")
    parser.add_argument("--slow", action="store_true")
    parser.add_argument("--jobs", type=int, default=1)
    chosen = parser.parse_args()
    bench = Bench(chosen.work.resolve(), chosen.jobs)
    first = bench.work / "tree-0"
    picked = list(mutants(first, chosen.count, chosen.seed, chosen.only))

    measured = bench.lines if chosen.tests is None else {}

    def judge(mutant: Mutant) -> str:
        runs = [quick_run(first, measured, mutant) if chosen.tests is None else Run("quick", chosen.tests)]
        folder = f"tests/{Path(mutant.path).parts[1]}"
        if chosen.slow and (first / folder).is_dir():
            runs.append(Run("slow", ["-m", "slow", folder]))
        verdict = bench.judge(mutant, runs)
        print(f"{mutant.path}:{mutant.line}: {mutant.change}: {verdict}", flush=True)
        return verdict.partition(" ")[0]

    with ThreadPoolExecutor(bench.jobs) as pool:
        print(Counter(pool.map(judge, picked)))


if __name__ == "__main__":
    main()
