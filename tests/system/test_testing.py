"""The pytest plugin, in test runs of its own."""

import subprocess
import sys
from importlib.metadata import entry_points
from pathlib import Path

import numpy as np
import pytest

import wrinklecli.review.diff.diff  # noqa: F401  # a run within this one forgets what it imports, and cannot again
from kit.asset import Asset, attribute
from kit.limb import limb_asset
from kit.variants import PICTURE, rich

pytest_plugins = ["pytester"]

TEST = """
def test_limb(wrinkle_golden):
    wrinkle_golden({obtained!r}, "goldens/limb.glb"{options})
"""


@pytest.fixture
def folder(pytester: pytest.Pytester) -> Path:
    """Where a test file lies, in a folder of its own below the one that pytest runs in."""
    pytester.makeini("[pytest]\nfilterwarnings = error\n")
    made = pytester.path / "tests"
    made.mkdir()
    return made


def run(pytester: pytest.Pytester, obtained: Path, *arguments: str, options: str = "") -> pytest.RunResult:
    text = TEST.format(obtained=str(obtained), options=options)
    (pytester.path / "tests" / "test_limb.py").write_text(text)
    return pytester.runpytest_inprocess(*arguments)


def limb(path: Path, *, off: float = 0.0) -> Path:
    asset = limb_asset(rings=7, sides=6)
    attribute(asset, 0, "POSITION")[5, 2] += np.float32(off)
    return asset.write(path)


def golden(folder: Path) -> Path:
    (folder / "goldens").mkdir()
    return limb(folder / "goldens" / "limb.glb")


def names(folder: Path) -> list[str]:
    return sorted(each.name for each in (folder / "goldens").iterdir())


def test_the_same_file_passes(pytester: pytest.Pytester, folder: Path, tmp_path: Path) -> None:
    kept = golden(folder)
    # What an earlier failure left goes.
    (folder / "goldens" / "limb.obtained.glb").write_bytes(b"old")
    run(pytester, limb(tmp_path / "out.glb")).assert_outcomes(passed=1)
    assert names(folder) == [kept.name]


def test_another_file_fails_and_is_left_beside_the_golden(
    pytester: pytest.Pytester, folder: Path, tmp_path: Path
) -> None:
    kept = golden(folder)
    before = kept.read_bytes()
    obtained = limb(tmp_path / "out.glb", off=0.01)
    result = run(pytester, obtained)
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(
        [
            f"{obtained} (B) differs from {kept} (A):",
            "/meshes/0/primitives/0/attributes/POSITION*: vertex 5 is 0.01 off",
            "different: at most 0.01 apart*",
            "*limb.obtained.glb; pytest --wrinkle-update makes it the golden",
        ]
    )
    # The message says it all: no traceback through the plugin.
    result.stdout.no_fnmatch_line("*testing.py*")
    assert kept.read_bytes() == before
    assert (folder / "goldens" / "limb.obtained.glb").read_bytes() == obtained.read_bytes()
    assert names(folder) == ["limb.glb", "limb.obtained.glb"]


@pytest.mark.slow
def test_update_replaces_the_golden_and_still_fails(pytester: pytest.Pytester, folder: Path, tmp_path: Path) -> None:
    kept = golden(folder)
    obtained = limb(tmp_path / "out.glb", off=0.01)
    run(pytester, obtained).assert_outcomes(failed=1)
    result = run(pytester, obtained, "--wrinkle-update")
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(["*vertex 5 is 0.01 off", "the golden has been replaced*"])
    assert kept.read_bytes() == obtained.read_bytes()
    assert names(folder) == ["limb.glb"]
    run(pytester, obtained).assert_outcomes(passed=1)


def test_update_leaves_a_golden_that_is_the_same(pytester: pytest.Pytester, folder: Path, tmp_path: Path) -> None:
    kept = golden(folder)
    before = kept.read_bytes()
    # Other bytes, within the tolerance.
    obtained = limb(tmp_path / "out.glb", off=1e-7)
    assert obtained.read_bytes() != before
    run(pytester, obtained, "--wrinkle-update").assert_outcomes(passed=1)
    assert kept.read_bytes() == before


@pytest.mark.slow
def test_a_missing_golden_fails_until_update_writes_it(pytester: pytest.Pytester, folder: Path, tmp_path: Path) -> None:
    obtained = limb(tmp_path / "out.glb")
    result = run(pytester, obtained)
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(["there is no golden *limb.glb"])
    assert names(folder) == ["limb.obtained.glb"]
    run(pytester, obtained, "--wrinkle-update").assert_outcomes(failed=1)
    assert names(folder) == ["limb.glb"]
    run(pytester, obtained).assert_outcomes(passed=1)


@pytest.mark.quick(1)
@pytest.mark.parametrize(
    ("options", "passes"),
    [
        ("", False),
        (", tolerance=0.02", True),
        (", tolerance='1%'", True),
        (", tolerance='0.1%'", False),
        (", posed=True, clips=['fold'], fps=5, tolerance=0.02", True),
        (", posed=True, tolerance=0.005", False),
    ],
)
def test_options_are_those_of_the_comparison(
    pytester: pytest.Pytester, folder: Path, tmp_path: Path, options: str, passes: bool
) -> None:
    golden(folder)
    result = run(pytester, limb(tmp_path / "out.glb", off=0.01), options=options)
    result.assert_outcomes(passed=int(passes), failed=int(not passes))


@pytest.mark.quick(1)
@pytest.mark.parametrize("tolerance", ["'wide'", "0", "'-1%'", "float('nan')"])
def test_a_tolerance_that_is_none_is_an_error_of_the_test(
    pytester: pytest.Pytester, folder: Path, tmp_path: Path, tolerance: str
) -> None:
    golden(folder)
    result = run(pytester, limb(tmp_path / "out.glb"), options=f", tolerance={tolerance}")
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(["*ValueError: the tolerance * is neither a length above 0 nor a percentage*"])


def test_a_gltf_with_files_is_kept_as_one(pytester: pytest.Pytester, folder: Path, tmp_path: Path) -> None:
    asset: Asset = rich()
    (tmp_path / "felt.png").write_bytes(PICTURE)
    asset.gltf["images"][0] = {"name": "felt", "uri": "felt.png"}
    obtained = asset.write(tmp_path / "out.gltf")
    run(pytester, obtained, "--wrinkle-update").assert_outcomes(failed=1)
    assert names(folder) == ["limb.glb"]
    run(pytester, obtained).assert_outcomes(passed=1)


def test_a_damaged_or_missing_file_fails_in_a_line(pytester: pytest.Pytester, folder: Path, tmp_path: Path) -> None:
    kept = golden(folder)
    before = kept.read_bytes()
    obtained = tmp_path / "out.glb"
    for arguments in ((), ("--wrinkle-update",)):
        result = run(pytester, obtained, *arguments)
        result.assert_outcomes(failed=1)
        result.stdout.fnmatch_lines([f"{obtained}: cannot be read*"])
    obtained.write_bytes(before[:100])
    result = run(pytester, obtained, "--wrinkle-update")
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines([f"{obtained}: truncated*"])
    assert kept.read_bytes() == before
    assert names(folder) == ["limb.glb"]


def test_the_golden_is_a_glb(pytester: pytest.Pytester, folder: Path, tmp_path: Path) -> None:
    obtained = limb(tmp_path / "out.glb")
    (folder / "test_limb.py").write_text(
        TEST.format(obtained=str(obtained), options="").replace('limb.glb"', 'limb.gltf"')
    )
    result = pytester.runpytest_inprocess()
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(["*ValueError: a golden is one file, a .glb, not 'goldens/limb.gltf'*"])


@pytest.mark.slow
@pytest.mark.long
def test_installing_registers_the_plugin(pytester: pytest.Pytester) -> None:
    (found,) = (each for each in entry_points(group="pytest11") if each.value == "wrinklecli.testing")
    assert found.name == "wrinkle"
    result = pytester.runpytest_subprocess("--help")
    result.stdout.fnmatch_lines(["golden tests of glTF files (wrinklecli):", "  --wrinkle-update *"])
    result = pytester.runpytest_subprocess("--fixtures")
    result.stdout.fnmatch_lines(["wrinkle_golden*"])


@pytest.mark.slow
def test_the_plugin_imports_nothing_until_it_is_used() -> None:
    program = (
        "import sys, pytest\n"
        "before = set(sys.modules)\n"
        "import wrinklecli.testing\n"
        "print(sorted(set(sys.modules) - before))\n"
    )
    result = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert result.stdout.strip() == "['wrinklecli', 'wrinklecli.testing']"
