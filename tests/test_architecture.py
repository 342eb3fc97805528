"""The layout is the data flow: a module imports only from those above it, and each library has one door."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

from wrinklecli.cli import cli

PACKAGE = Path(__file__).parents[1] / "wrinklecli"
ORDER = (
    "errors",
    "yamltree",
    "schema",
    "config",
    "meshopt",
    "draco",
    "document",
    "restore",
    "draft",
    "pose",
    "skin",
    "surface",
    "scene",
    "render",
    "images",
    "curve",
    "patch",
    "subdivide",
    "refine",
    "deform",
    "tracks",
    "table",
    "plan",
    "placement",
    "budget",
    "encode",
    "frames",
    "proof",
    "report",
    "timings",
    "pipeline",
    "check",
    "plot",
    "inspect",
    "track",
    "strain",
    "folds",
    "suggest",
    "subject",
    "viewpoint",
    "preview",
    "distance",
    "meaning",
    "compare",
    "testing",
    "cli",
)
# Who may import a library; any module may import those that are not here.
DOORS = {
    "yaml": {"yamltree"},
    "jsonschema_rs": {"config"},
    "pygltflib": {"draft"},
    "DracoPy": {"draco"},
    "zstandard": {"restore"},
    "trimesh": {"frames"},
    "embreex": {"preview", "render"},
    "PIL": {"preview", "images"},
    "matplotlib": {"plot"},
    "click": {"cli"},
    "pytest": {"testing"},
}
HEAVY = ("numpy", "scipy", "jsonschema_rs", "pygltflib", "trimesh", "yaml", "zstandard", "matplotlib")


def stage_of(path: Path) -> str:
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


SOURCES = sorted(path for path in PACKAGE.rglob("*.py") if path != PACKAGE / "__init__.py")


def imports_of(path: Path) -> set[str]:
    """Full names of the modules that a file imports, anywhere in it."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}:{node.lineno}: imports are absolute"
            assert node.module is not None
            # `from wrinklecli import pose` imports a module, `from wrinklecli.pose import skin` a name.
            inner = node.module == "wrinklecli"
            found |= {f"{node.module}.{alias.name}" for alias in node.names} if inner else {node.module}
    return found


def test_every_module_has_its_place() -> None:
    stages = {stage_of(path) for path in SOURCES}
    assert stages <= set(ORDER), f"without a place in the order: {sorted(stages - set(ORDER))}"
    assert stages == set(ORDER)


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_module_imports_only_from_those_above_it(path: Path) -> None:
    own = ORDER.index(stage_of(path))
    for name in imports_of(path):
        if name.split(".")[0] != "wrinklecli":
            continue
        stage = name.split(".")[1]
        if stage == "bake":
            assert stage_of(path) == "cli", "the package's front door is for its users"
        elif stage != stage_of(path) or stage != "cli":
            assert ORDER.index(stage) < own, f"{path.name} imports {stage}, which is not above it"


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_each_library_has_one_door(path: Path) -> None:
    libraries = {name.split(".")[0] for name in imports_of(path)} & set(DOORS)
    wrong = {library for library in libraries if stage_of(path) not in DOORS[library]}
    assert not wrong


@pytest.mark.parametrize("arguments", [[], ["--help"], ["--version"], *([name, "--help"] for name in cli.commands)])
def test_help_imports_nothing_heavy(arguments: list[str]) -> None:
    program = (
        "import sys\n"
        "from wrinklecli.cli import main\n"
        f"sys.argv = ['wrinkle', *{arguments!r}]\n"
        "try:\n"
        "    main()\n"
        "except SystemExit:\n"
        "    pass\n"
        f"print('loaded:', *(name for name in {HEAVY!r} if name in sys.modules))\n"
    )
    result = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert result.stdout.splitlines()[-1] == "loaded:"


def test_importing_the_package_imports_nothing_heavy() -> None:
    program = f"import sys, wrinklecli; print(*(name for name in {HEAVY!r} if name in sys.modules))"
    result = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert result.stdout.strip() == ""


def test_core_never_prints_and_never_exits() -> None:
    for path in SOURCES:
        if stage_of(path) == "cli":
            continue
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Call):
                called = ast.unparse(node.func)
                assert called not in ("print", "exit", "sys.exit", "os._exit", "quit", "input"), f"{path}:{node.lineno}"
