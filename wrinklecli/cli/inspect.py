"""`wrinkle inspect`."""

from collections.abc import Iterator, Sequence
from typing import Any

import click

from wrinklecli.cli import options as opt
from wrinklecli.cli.output import emit, emit_json
from wrinklecli.errors import counted
from wrinklecli.numeric.memory import shown_bytes

_FEW_JOINTS = 8  # joints that one line lists


@click.command(short_help="Say what is in an asset.", epilog="Example: wrinkle inspect samples/trousers.glb")
@click.argument("asset", type=opt.FILE)
@opt.allow_external()
@opt.max_memory
@opt.json("Print JSON instead of a tree.")
def inspect(asset: str, allow_external: bool, max_memory: int, as_json: bool) -> None:
    """Say what is in ASSET (glTF): bounds, meshes, what deforms them, clips, bytes; of a baked file, its tools.

    Vertices are counted as the file has them, and keys of a clip in its longest channel.

    Exit codes: 0 done; 1 the input is at fault; 2 wrong usage; 70 a bug.
    """
    from wrinklecli.review.inspect import inspect as run

    data = run(asset, allow_external=allow_external, max_memory=max_memory)
    if as_json:
        emit_json(data)
    else:
        _emit_tree(data)


def _emit_tree(data: dict[str, Any]) -> None:
    whole = sum(each["bytes"] or 0 for each in data["files"])
    made = f", by {data['generator']}" if data["generator"] else ""
    emit(f"{data['asset']}: glTF {data['version']}{made}, {shown_bytes(whole)}", style={"bold": True})
    required = data["extensions_required"]
    names = [f"{name} (required)" if name in required else name for name in data["extensions_used"]]
    _emit_list("extensions", names)
    if data["bounds"] is not None:
        low, high = (_place(data["bounds"][key]) for key in ("min", "max"))
        _emit_list("bounds", [f"{low} to {high}, as stored"])
    _emit_list("meshes", [line for mesh in enumerate(data["meshes"]) for line in _mesh(*mesh)])
    _emit_list(
        "deform", [_deforming(each, data) for each in data["deforming"]] or ["nothing: no skin, no morph targets"]
    )
    _emit_list("skins", list(_skins(data["skins"])))
    _emit_list("clips", [_clip(each) for each in data["clips"]])
    _emit_list("channels that move no node, and are kept as they are", list(_unplayed(data["unplayed"])))
    for each in data["wrinkles"]:
        _emit_list(f"wrinkles on {each['node']}", _wrinkles(each))
    if data["replaceable"] is not None:
        state = "can be replaced: bake --replace" if data["replaceable"] else "cannot be replaced"
        _emit_list("earlier bake", [state])
    _emit_list("bytes", [f"{shown_bytes(count):>9} {kind}" for kind, count in data["bytes"].items() if count])
    if len(data["files"]) > 1:
        sizes = [shown_bytes(each["bytes"]) if each["bytes"] is not None else "missing" for each in data["files"]]
        _emit_list("files", [f"{size:>9} {each['name']}" for size, each in zip(sizes, data["files"], strict=True)])


def _emit_list(heading: str, lines: list[str]) -> None:
    if lines:
        emit(heading, style={"bold": True})
        for line in lines:
            emit(f"  {line}")


def _mesh(number: int, mesh: dict[str, Any]) -> list[str]:
    primitives = mesh["primitives"]
    lines = [
        f"{mesh['name'] or f'mesh {number}'}: {counted(len(primitives), 'primitive')},"
        f" {counted(mesh['vertices'], 'vertex', 'vertices')}, {counted(mesh['triangles'], 'triangle')}"
    ]
    for index, each in enumerate(primitives):
        material = f", material {each['material']}" if each["material"] else ""
        compressed = f", {each['compression']}" if each["compression"] else ""
        lines.append(
            f"  primitive {index}: {each['mode']}, {counted(each['vertices'], 'vertex', 'vertices')},"
            f" {' '.join(each['attributes'])}{material}{compressed}"
        )
    if mesh["morph_targets"]:
        lines.append(f"  {counted(len(mesh['morph_targets']), 'morph target')}: {', '.join(mesh['morph_targets'])}")
    return lines


def _deforming(each: dict[str, Any], data: dict[str, Any]) -> str:
    by = []
    if each["skin"] is not None:
        by.append(f"skin {data['skins'][each['skin']]['name'] or each['skin']}")
    if each["morph_targets"]:
        by.append(counted(each["morph_targets"], "morph target"))
    return f"{each['node']}: {' and '.join(by)}"


def _skins(skins: list[dict[str, Any]]) -> Iterator[str]:
    """A line for each skin, and a tree of its joints unless they are few.

    A joint has its place in the stored pose where it is listed first.
    """
    listed: set[str] = set()
    for number, skin in enumerate(skins):
        joints = list(skin["joints"])
        if skin["rest"] is not None:
            size = max((abs(x) for place in skin["rest"] for x in place), default=0.0)
            joints = [f"{name} {_place(place, size)}" for name, place in zip(joints, skin["rest"], strict=True)]
        shown = [name if line in listed else line for name, line in zip(skin["joints"], joints, strict=True)]
        again = listed.issuperset(joints)
        listed.update(joints)
        heading = f"{skin['name'] or f'skin {number}'}: {counted(len(joints), 'joint')}"
        if skin["parents"] is None or len(joints) <= _FEW_JOINTS:
            yield f"{heading}: {', '.join(shown)}"
        elif again:
            yield f"{heading}, all listed above"
        else:
            yield heading
            yield from (f"  {line}" for line in _joint_tree(skin["joints"], shown, skin["parents"]))


def _joint_tree(names: Sequence[str], shown: Sequence[str], parents: Sequence[int | None]) -> Iterator[str]:
    """Lines of a tree of joints: a line is a chain of joints, and one of two branches that differ by their side.

    The first joint of a chain is as in `shown`.
    """
    from wrinklecli.tools.mirror import split_side

    below: dict[int | None, list[int]] = {}
    for joint, parent in enumerate(parents):
        below.setdefault(parent, []).append(joint)
    order, left = list[int](), list(below.get(None, ()))
    while left:
        order.append(left.pop())
        left += below.get(order[-1], ())
    # Equal numbers for branches that are equal but for sides.
    kinds: dict[tuple[str, tuple[int, ...]], int] = {}
    kind_of: dict[int, int] = {}
    for joint in reversed(order):
        key = split_side(names[joint])[0], tuple(sorted(kind_of[each] for each in below.get(joint, ())))
        kind_of[joint] = kinds.setdefault(key, len(kinds))
    lines = [(0, joint, False) for joint in reversed(below.get(None, []))]
    while lines:
        depth, joint, twin = lines.pop()
        chain = [shown[joint]]
        while len(below.get(joint, ())) == 1:
            (joint,) = below[joint]
            chain.append(names[joint])
        yield "  " * depth + " > ".join(chain) + ", and the other side" * twin
        branches: dict[tuple[int, bool], list[int]] = {}
        for each in below.get(joint, ()):
            branches.setdefault((kind_of[each], bool(split_side(names[each])[1])), []).append(each)
        folded = [
            (depth + 1, each, len(group) == 2 and sided)
            for (_, sided), group in branches.items()
            for each in (group[:1] if len(group) == 2 and sided else group)
        ]
        lines += reversed(folded)


def _place(place: Sequence[float], size: float | None = None) -> str:
    """A place in the stored pose. Coordinates that are rounding errors of the greatest one are 0."""
    least = 1e-6 * (max(map(abs, place)) if size is None else size)
    return f"[{', '.join(f'{x if abs(x) > least else 0.0:.4g}' for x in place)}]"


def _clip(clip: dict[str, Any]) -> str:
    span = "unknown duration"
    if clip["start"] is not None and clip["end"] is not None:
        span = f"{clip['end'] - clip['start']:.4g} s" + (f" from {clip['start']:.4g} s" if clip["start"] else "")
    channels = ", ".join(f"{count} {path}" for path, count in clip["channels"].items())
    return f"{clip['name']}: {span}, {counted(clip['keys'], 'key')}, {counted(clip['nodes'], 'node')}: {channels}"


def _unplayed(channels: Sequence[dict[str, Any]]) -> Iterator[str]:
    pointers: dict[str, list[str]] = {}
    for each in channels:
        pointers.setdefault(each["animation"], []).append(each["pointer"] or "nothing that is known")
    for name, moved in pointers.items():
        yield f"{name}: {', '.join(dict.fromkeys(moved))}"


def _wrinkles(each: dict[str, Any]) -> list[str]:
    lines = ["a draft: neither proven nor fully refined"] if each["draft"] else []
    for kind, acts in _ACTS.items():
        for effect in each.get(kind, ()):
            targets = effect["targets"]
            lines.append(f"{effect['name']}: {acts(effect)}")
            lines.append(f"  {counted(len(targets), 'target')}: {', '.join(targets)}")
    if each["undriven"]:
        lines.append(f"without a tool: {', '.join(each['undriven'])}")
    return lines


def _swings(region: dict[str, Any]) -> str:
    springs = ", ".join(f"{frequency:.3g}" for frequency in region["frequencies"])
    return f"swings after {region['joint']} by springs of {springs} Hz"


def _slides(touch: dict[str, Any]) -> str:
    where = f"{counted(touch['directions'], 'direction')} of rings" if touch["directions"] else "no rings"
    return f"skin on {' + '.join(touch['joints'])} slides by up to {touch['grip']:.3g}, {where}"


def _folds(field: dict[str, Any]) -> str:
    turns = [f"{turn['joint']} by {turn['degrees'][0]:.4g} to {turn['degrees'][1]:.4g}°" for turn in field["turns"]]
    return f"folds as joints turn: {', '.join(turns)}"


def _spans(tool: dict[str, Any]) -> str:
    anchors = [tool["origin_joints"], *tool.get("between_joints", []), tool["target_joints"]]
    joints = " to ".join(" + ".join(each) for each in anchors)
    return f"{joints}, rest length {tool['rest_length']:.4g}"


# What effects of each kind do, in the order of the lines.
_ACTS = {"flesh": _swings, "touches": _slides, "fields": _folds, "muscles": _spans, "tools": _spans}
