"""What Make and Ninja read from the file of `--depfile`: the files that were read, and nothing else."""

import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from kit.places import IN_CI
from wrinklecli.cli.bake import dependencies
from wrinklecli.errors import WrinkleError

MAKE = shutil.which("make")
NINJA = shutil.which("ninja", path=f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}")
# Characters that Ninja reads since 1.12.
LATER = frozenset("&'\"")
# A path that both must read, and how it looks in the rule.
CARRIED = {
    "a b": r"a\ b",
    r"a\ b": r"a\\\ b",
    " a": r"\ a",
    "a#b": r"a\#b",
    "a$b": "a$$b",
    "$(shell touch x)y": r"$$(shell\ touch\ x)y",
    "a:b": r"a\:b",
    "i%j": "i%j",
    "k=l": "k=l",
    "d/x=y": "d/x=y",
    r"a\b": r"a\b",
    r"i\%j": r"i\%j",
    "my (1).bin": r"my\ (1).bin",
    "a&": "a&",
    "the 'a\"": "the\\ 'a\"",
    "a,{b}@c!]": "a,{b}@c!]",
    ".hidden": ".hidden",
    "額é": "額é",
    "\udcff": "\udcff",
    "export": "export",
}
REFUSED = [
    *("a\nb", "a\tb", "a\x7f", "a;b", "a|b", "a*b", "a?b", "a[b]", "a<b", "a>b", "a^b", "a`b", r"a\#b", r"a\:b"),
    *(r"a\$b", r"a\=b", "a\\", "a ", "a:", "a(b)", "~a", "./~root/a", "-lm", ".SILENT", ".//.IGNORE", ".WAIT"),
    *("", "=a", "+=a", "!=a"),
]


def seen_by_make(folder: Path) -> set[str]:
    assert MAKE is not None
    ran = subprocess.run(
        [MAKE, "-rRdn", "-f", "out.d", "out.glb"], cwd=folder, capture_output=True, check=True, env={"LC_ALL": "C"}
    )
    found = re.findall(r"Considering target file '(.*)'\.", os.fsdecode(ran.stdout))
    return set(found) - {"out.d", "out.glb"}


def seen_by_ninja(folder: Path) -> set[str]:
    assert NINJA is not None
    rule = (
        "rule r\n command = cp out.d read.d && touch out.glb\n depfile = read.d\n deps = gcc\nbuild out.glb: r out.d\n"
    )
    (folder / "build.ninja").write_text(rule)
    subprocess.run([NINJA], cwd=folder, capture_output=True, check=True)
    ran = subprocess.run([NINJA, "-t", "deps", "out.glb"], cwd=folder, capture_output=True, check=True)
    return {line[4:] for line in os.fsdecode(ran.stdout).splitlines() if line.startswith("    ")}


def knows(path: str) -> bool:
    """Whether this Ninja is new enough for a path."""
    assert NINJA is not None
    version = subprocess.run([NINJA, "--version"], capture_output=True, check=True, text=True).stdout
    return not LATER & set(path) or [int(part) for part in version.split(".")[:2]] >= [1, 12]


def placed(folder: Path, paths: list[str]) -> None:
    """Make the files, and the depfile of an output that was made from them."""
    for path in paths:
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).touch()
    (folder / "out.d").write_bytes(dependencies("out.glb", paths))


def needs(program: str | None) -> None:
    if program is None and not IN_CI:
        pytest.skip("the program is not installed")


@pytest.mark.parametrize("path", CARRIED)
def test_a_path_is_escaped(path: str) -> None:
    assert dependencies("out.glb", ["a", path]).splitlines()[0] == os.fsencode(f"out.glb: a {CARRIED[path]}")


@pytest.mark.parametrize("path", REFUSED)
def test_a_path_that_make_or_ninja_cannot_read_is_refused(path: str) -> None:
    for target, inputs in (("out.glb", ["a", path]), (path, ["a"])):
        with pytest.raises(WrinkleError, match="is a name that Make or Ninja cannot read") as caught:
            dependencies(target, inputs)
        assert len(caught.value.lines) == 1


@pytest.mark.parametrize("target", ["a%.glb", "SHELL=x.glb"])
def test_an_output_that_would_be_a_pattern_or_a_variable_is_refused(target: str) -> None:
    with pytest.raises(WrinkleError, match="cannot read"):
        dependencies(target, ["a"])


@pytest.mark.parametrize("inputs", [["a=b"], ["a=b", "c=d"], ["export", "a=b"]])
def test_a_variable_is_never_set(inputs: list[str]) -> None:
    with pytest.raises(WrinkleError, match="cannot read"):
        dependencies("out.glb", inputs)
    assert dependencies("out.glb", [*inputs, "tools.yaml"]).startswith(b"out.glb: tools.yaml ")


def test_inputs_that_would_be_other_rules_have_none_of_their_own() -> None:
    paths = ["a", "SHELL=x", "i%j", "a&", ".c"]
    assert dependencies("out.glb", paths).splitlines()[1:] == [b"", b"a:"]


def test_make_and_ninja_read_all_that_is_escaped(tmp_path: Path) -> None:
    needs(MAKE)
    needs(NINJA)
    placed(tmp_path, ["a", *CARRIED])
    assert seen_by_make(tmp_path) == {"a", *CARRIED}
    placed(tmp_path, ["a", *filter(knows, CARRIED)])
    assert seen_by_ninja(tmp_path) == {"a", *filter(knows, CARRIED)}


PARTS = [*" #$%\\:=;|&'\"*(){}~!@+,-_.ab額\udcff", "./", "/", "-l", "$(", "${", ":=", "export", "\\ "]
NAMES = st.lists(st.sampled_from(PARTS), min_size=1, max_size=6).map("".join)


@given(st.lists(NAMES, min_size=1, max_size=4))
def test_make_and_ninja_read_exactly_the_files_that_were_read(names: list[str]) -> None:
    needs(MAKE)
    needs(NINJA)
    paths = list(dict.fromkeys(os.path.normpath("_".join(name.split("/../"))) for name in names))
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        try:
            placed(
                folder, ["tools.yaml", *(path for path in paths if not path.startswith(("/", "..")) and path != ".")]
            )
        except (OSError, WrinkleError):  # no name of a file, or refused
            return
        found = {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()} - {"out.d"}
        assert seen_by_make(folder) == found
        assert seen_by_ninja(folder) == found or not all(map(knows, found))
