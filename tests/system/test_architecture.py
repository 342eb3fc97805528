"""The layout is the data flow: rooms import only from those above them, and each library has one door."""

import ast
import re
import subprocess
import sys
from collections.abc import Iterator, Sequence
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

from wrinklecli.choices import EFFECTS
from wrinklecli.cli import cli

TESTS = Path(__file__).parents[1]
PACKAGE = TESTS.parent / "wrinklecli"
# The rooms, folders and modules beside them, in the order in which the page of the program lists them.
ROOMS = re.findall(r"^\| \[(\w+)\]\(\1(?:\.py)?\) \|", (PACKAGE / "README.md").read_text(), re.MULTILINE)
# Who may import a library: modules, or all of a folder. Any module may import those that are not here.
DOORS = {
    "yaml": {"tools/yaml_edit", "tools/yaml_tree"},
    "jsonschema_rs": {"tools/checked"},
    "pygltflib": {"editor/page/painted_mesh"},
    "DracoPy": {"gltf/draco"},
    "zstandard": {"baking/original"},
    "threadpoolctl": {"numeric/guard"},
    "trimesh": {"baking/frame_files"},
    "igl": {"numeric/closest", "review/preview/rays"},
    "ipctk": {"effects/contact/tissue"},
    "embreex": {"review/preview/preview", "review/preview/rays"},
    "PIL": {"gltf/pixels", "review/preview/cards", "review/preview/preview", "review/preview/sheet_layout"},
    "matplotlib": {"review/plot"},
    "dask": {"batching/cluster"},
    "distributed": {"batching/cluster"},
    "aiohttp": {"batching/stores"},
    "fsspec": {"batching/stores"},
    "viser": {"editor/page"},
    "rich": {"editor/page/server"},
    "websockets": {"editor/page/server"},
    "click": {"cli"},
    "pytest": {"testing"},
}
HEAVY = (
    "numpy",
    "scipy",
    "igl",
    "jsonschema_rs",
    "pygltflib",
    "trimesh",
    "yaml",
    "zstandard",
    "matplotlib",
    "distributed",
)


def place_of(path: Path) -> str:
    return path.relative_to(PACKAGE).with_suffix("").as_posix()


def room_of(path: Path) -> str:
    return place_of(path).split("/")[0]


SOURCES = sorted(path for path in PACKAGE.rglob("*.py") if path != PACKAGE / "__init__.py")


def statements(body: Sequence[ast.AST]) -> Iterator[ast.AST]:
    """All statements of a body, and those in them: without expressions these are a tenth of a syntax tree."""
    for each in body:
        yield each
        for field in ("body", "orelse", "finalbody", "handlers", "cases"):
            if inside := getattr(each, field, None):
                yield from statements(inside)


@cache
def imports_in(path: Path) -> tuple[ast.Import | ast.ImportFrom, ...]:
    """The imports of a file, anywhere in it."""
    found = statements(ast.parse(path.read_text()).body)
    return tuple(node for node in found if isinstance(node, ast.Import | ast.ImportFrom))


def calls_in(path: Path, *words: str) -> list[ast.Call]:
    """All calls in a file that holds one of some words; few do, and the others are not parsed."""
    text = path.read_text()
    nodes = ast.walk(ast.parse(text)) if {*words} & {*re.findall(r"\w+", text)} else ()
    return [node for node in nodes if isinstance(node, ast.Call)]


@cache
def imports_of(path: Path) -> frozenset[str]:
    """Full names of the modules that a file imports, anywhere in it."""
    found: set[str] = set()
    for node in imports_in(path):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        else:
            assert node.level == 0, f"{path}:{node.lineno}: imports are absolute"
            assert node.module is not None
            # `from wrinklecli.gltf import draco` imports a module, `from wrinklecli.gltf.draco import decode` a name.
            if node.module.split(".")[0] == "wrinklecli":
                found |= {f"{node.module}.{alias.name}" for alias in node.names}
            found.add(node.module)
    return frozenset(found)


def test_rooms_are_the_folders() -> None:
    assert sorted({room_of(path) for path in SOURCES}) == sorted(ROOMS)


def test_an_effect_knows_only_those_that_act_before_it() -> None:
    effects = [path.parent.name for path in sorted((PACKAGE / "effects").glob("*/__init__.py"))]
    acting = [folder for folder, _ in EFFECTS.values()]
    assert sorted(acting) == sorted(effects)
    for path in (PACKAGE / "effects").glob("*/*.py"):
        known = {name.split(".")[2] for name in imports_of(path) if name.startswith("wrinklecli.effects.")}
        later = acting[acting.index(path.parent.name) + 1 :]
        assert not known & set(later), place_of(path)


# Rooms that know each kind of effect by name: those that make them, and that read their entries.
KNOWING = ("effects", "drive", "tools")
FOLDERS = "|".join(folder for folder, _ in EFFECTS.values())


def test_other_rooms_know_effects_only_as_effects() -> None:
    """They ask what may be asked of any effect, and never what kind it is."""
    for path in (path for path in SOURCES if room_of(path) not in KNOWING):
        known = {name for name in imports_of(path) if re.match(rf"wrinklecli\.effects\.({FOLDERS})\b", name)}
        assert not known, place_of(path)
        classes = {
            alias.asname or alias.name
            for node in imports_in(path)
            if isinstance(node, ast.ImportFrom)
            and (node.module or "").startswith(("wrinklecli.effects", "wrinklecli.drive"))
            for alias in node.names
        }
        if not classes:
            continue
        asked = [
            node.args[1]
            for node in calls_in(path, "isinstance")
            if isinstance(node.func, ast.Name) and node.func.id == "isinstance"
        ]
        names = {each.id for node in asked for each in ast.walk(node) if isinstance(each, ast.Name)}
        assert not names & classes, place_of(path)


def test_rooms_say_what_they_are_for() -> None:
    for path in PACKAGE.rglob("__init__.py"):
        assert ast.get_docstring(ast.parse(path.read_text())), path


def test_modules_import_only_from_rooms_above_them() -> None:
    wrong = []
    for path in SOURCES:
        allowed = {*ROOMS[: ROOMS.index(room_of(path)) + 1]}
        if room_of(path) == "cli":  # the package's front door is for its users
            allowed.add("bake")
        names = {name for name in imports_of(path) if name.startswith("wrinklecli.")}
        wrong += [
            f"{place_of(path)} imports {name}, which is not above it"
            for name in names
            if name.split(".")[1] not in allowed
        ]
    assert not wrong


def test_what_is_edited_knows_no_page() -> None:
    for path in (PACKAGE / "editor").glob("*.py"):
        assert not {name for name in imports_of(path) if name.startswith("wrinklecli.editor.page")}, place_of(path)


def test_modules_of_a_room_do_not_import_each_other_in_a_circle() -> None:
    modules = {place_of(path).replace("/", "."): imports_of(path) for path in SOURCES}
    inner = {name: {each for each in modules if f"wrinklecli.{each}" in found} for name, found in modules.items()}
    tuple(TopologicalSorter(inner).static_order())  # raises CycleError


def test_each_library_has_one_door() -> None:
    wrong = []
    for path in SOURCES:
        libraries = {name.split(".")[0] for name in imports_of(path)} & set(DOORS)
        places = {place_of(path), *(place_of(folder) for folder in path.parents if PACKAGE in folder.parents)}
        wrong += [f"{place_of(path)} imports {library}" for library in libraries if not DOORS[library] & places]
    assert not wrong


def test_help_imports_nothing_heavy() -> None:
    """One help after another, in one process: what one has loaded stays."""
    program = (
        "import sys\n"
        "from wrinklecli.cli import main\n"
        "for arguments in {arguments!r}:\n"
        "    sys.argv = ['wrinkle', *arguments]\n"
        "    try:\n"
        "        main()\n"
        "    except SystemExit:\n"
        "        pass\n"
        "    print('loaded by', arguments, [name for name in {heavy!r} if name in sys.modules])\n"
    )
    helps = [[], ["--help"], ["--version"], *([name, "--help"] for name in cli.commands)]
    program = program.format(arguments=helps, heavy=HEAVY)
    result = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    said = [line for line in result.stdout.splitlines() if line.startswith("loaded by")]
    assert said == [f"loaded by {arguments} []" for arguments in helps]
    assert result.stdout.count("Usage:") == len(helps) - 2  # not of no arguments, nor of --version


def test_importing_the_package_imports_nothing_heavy() -> None:
    program = f"import sys, wrinklecli; print(*(name for name in {HEAVY!r} if name in sys.modules))"
    result = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert result.stdout.strip() == ""


def test_core_never_prints_and_never_exits() -> None:
    for path in SOURCES:
        if room_of(path) in ("cli", "__main__"):
            continue
        for node in calls_in(path, "print", "exit", "_exit", "quit", "input"):
            called = ast.unparse(node.func)
            assert called not in ("print", "exit", "sys.exit", "os._exit", "quit", "input"), f"{path}:{node.lineno}"


def test_no_test_imports_another_test_module() -> None:
    """What several of them need is in the kit."""
    # Not all that is below: node keeps thousands of folders there.
    modules = [path for depth in ("", "*/", "*/*/") for path in TESTS.glob(f"{depth}*.py")]
    modules = [path for path in modules if "benchmarks" not in path.parts]
    tests = {path.stem for path in modules if path.stem.startswith("test_")}
    for path in modules:
        # An import has the module's name as a word: few files have one, and are parsed.
        if {*tests, "conftest"} & {*re.findall(r"\w+", path.read_text())}:
            wanted = {part for name in imports_of(path) for part in name.split(".")}
            assert not wanted & {*tests, "conftest"}, path


def test_what_bakes_are_held_to_shares_no_code_with_the_package() -> None:
    for name in ("player", "reference"):
        wanted = imports_of(TESTS / "kit" / f"{name}.py")
        assert not {each for each in wanted if each.startswith(("wrinklecli", "kit"))} - {"kit.player"}, name


def test_the_root_holds_what_the_project_says_it_does() -> None:
    """A file that a test or a trial once left there would be committed with everything else."""
    root = PACKAGE.parent
    plain = {path.name for path in root.iterdir() if path.name[0] != "." and not path.name.endswith(".egg-info")}
    made = {"build", "dist", "wrinkle-demo"}  # by a release and by README's first command
    wanted = {"CHANGELOG.md", "LICENSE", "README.md", "configs", "pyproject.toml", "samples", "tests", "wrinklecli"}
    assert plain - made == wanted
