"""Folds that are kept: where one of two knees' tools changes, the other knee is found, and the bytes are the same."""

import hashlib
import re
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

pytest.importorskip("ipctk", reason="needs the extra `contact`")

from kit.command import Wrinkle
from kit.folds import knees
from kit.limb import write_tools
from wrinklecli.effects.contact import kept, remaining, sample
from wrinklecli.effects.contact.fold import Fold
from wrinklecli.numeric.arrays import Floats, Ints

FORGERIES: list[Callable[[str], str]] = [
    lambda _: "{}",
    lambda _: "[" * 100_000,
    lambda _: "[]",
    lambda _: "[[1, {}]]",
    lambda text: text[:-1],
    lambda text: text.replace('{"known": 0}', '{"known": 9}'),
    lambda text: text.replace('{"Crease"', '{"Fold"'),
    lambda text: text.replace('{"Followed": [{"known": 1}, ', '{"Followed": ['),
    lambda text: text.replace('[["map", [[0, ', '[["map", [[1, ').replace('{"map": [[0, ', '{"map": [[1, '),
    lambda text: re.sub(r'"array": \[\[(\d+), (\d+), 3\]', r'"array": [[\2, \1, 3]', text, count=1),
    lambda text: re.sub(r'"array": \[\[(\d+), (\d+)\]', r'"array": [[\2, \1]', text),
]


@pytest.mark.slow
def test_folds_whose_surface_is_as_before_are_not_solved_again(
    wrinkle: Wrinkle, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    legs = knees(inwards=0.0, angle=90.0, sides=8)
    asset, tools = legs.asset.write(tmp_path / "limb.glb"), tmp_path / "tools.yaml"
    # Each leg is in the fold of the other's knee, but contact does not move it there.
    first, second = ({**tool, "contact": "resolve"} for tool in legs.tools)
    write_tools(tools, first, second, refinement={"max_levels": 1})
    solve, solved, asked = sample._solved_system, list[list[Fold]](), list[tuple[list[Fold], sample._Clips]]()

    def logged(members: list[Fold], *, clips: sample._Clips, jobs: int) -> kept.Spanned:
        solved.append(members)
        asked.append((members, clips))
        return solve(members, clips=clips, jobs=jobs)

    monkeypatch.setattr(sample, "_solved_system", logged)

    def bake(out: str, *options: str) -> tuple[list[str], bytes]:
        solved.clear()
        searched.clear()
        ran = wrinkle("bake", str(asset), str(tools), "-o", out, "-j", "1", *options)
        assert ran.code == 0, ran.lines
        assert not [line for line in ran.lines if "shapes/" in line]
        names = [patch.tool.name for members in solved for fold in members for patch in fold.patches]
        return names, Path(out).read_bytes()

    counted, searched = remaining._Look._counts, list[remaining._Look]()

    def looked(look: remaining._Look, poses: Iterator[tuple[Floats, Floats]]) -> Ints:
        searched.append(look)
        return counted(look, poses)

    looked.__qualname__ = counted.__qualname__
    monkeypatch.setattr(remaining._Look, "_counts", looked)
    names = [str(tool["name"]) for tool in legs.tools]
    of_both, plain = bake("plain.glb")
    assert of_both == names
    for expected in (names, []):
        assert bake("out.glb", "--cache", "c") == (expected, plain)
        # What crosses is not searched for again, either.
        assert bool(searched) == bool(expected)

    # What is damaged is solved anew, and what is forged is no solution.
    entries = sorted(Path("c/shapes").glob("*/*"))
    sound = [each.read_bytes() for each in entries]
    for entry, data in zip(entries, sound, strict=True):
        entry.write_bytes(data[:-1])
    ran = wrinkle("bake", str(asset), str(tools), "-o", "again.glb", "-j", "1", "--cache", "c")
    assert [line for line in ran.lines if line.startswith("warning: ") and "is damaged" in line]
    assert Path("again.glb").read_bytes() == plain
    assert [each.read_bytes() for each in entries] == sound
    members, clips = asked[0]
    data = next(each[32:] for each in sound if _is_of(each[32:], members, clips))
    for forge in FORGERIES:
        forged = forge(data.decode())
        assert forged != data.decode()
        with pytest.raises((AttributeError, TypeError, ValueError, OverflowError, RecursionError, LookupError)):
            kept.read(forged.encode(), members, clips.moving)

    # With a shorter tool over one knee, the vertices of the other have other numbers.
    target = [*legs.tools[0]["target"]]
    write_tools(tools, {**first, "target": [0.37, *target[1:]]}, second, refinement={"max_levels": 1})
    _, changed = bake("fresh.glb")
    assert changed != plain
    assert bake("changed.glb", "--cache", "c") == (names[:1], changed)
    asset = Path("out.glb")
    assert bake("replaced.glb", "--replace", "--cache", "c") == ([], changed)
    assert not searched


def _is_of(data: bytes, members: list[Fold], clips: sample._Clips) -> bool:
    """True if a solution is that of some folds, which reads them the same way again."""
    try:
        solved = kept.read(data, members, clips.moving)
    except (TypeError, ValueError):
        return False
    return hashlib.sha256(kept.written(solved, members, clips.moving)).digest() == hashlib.sha256(data).digest()
