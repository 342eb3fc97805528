"""`wrinkle bake --replace`: the asset that a baked file was made from is baked in its place, to the same bytes."""

import json
import random
import shutil
import struct
import sys
from base64 import b64decode, b64encode
from collections.abc import Callable
from functools import cache, partial
from itertools import takewhile
from operator import eq
from pathlib import Path
from typing import Any

import pytest
import zstandard

import wrinklecli
from kit.asset import pack_glb, read_glb
from kit.bakes import bake_config, place
from kit.clients import optimize, validate
from kit.compressed import EVERY, compressed_sample
from kit.limb import limb_asset, tool, write_tools
from kit.player import Json
from kit.samples import (
    BACK,
    BROW,
    PALM,
    aside,
    bystanders,
    edited,
    sample,
    shared_mesh,
    sharp_keys,
    spline_keys,
    three_materials,
    two_meshes,
    two_parts,
    unnamed_targets,
    with_tangents,
    without_normals,
)
from kit.variants import PNG, crowd, scattered
from wrinklecli import cli
from wrinklecli.baking import original as restore
from wrinklecli.baking.track import track
from wrinklecli.errors import AssetError, BakeError, WrinkleError
from wrinklecli.gltf.document import Document, read_document
from wrinklecli.gltf.edited_document import EditedDocument
from wrinklecli.gltf.writer import write
from wrinklecli.tools.records import Length

FINER: Json = {**PALM, "name": "other", "strategy": "both_ends", "bumps": 4, "width": 0.05}
LIMB = tool(bumps=3)
FINER_LIMB: Json = {**LIMB, "bumps": 2}
KNEE: Json = {"name": "knee", "origin": [0.104, 0.635, -0.091], "target": [0.104, 0.365, -0.084], "width": 0.24}
KEYED: Json = {**BROW, "rest_length": {"keys": {"raise_brows": [[0, "100%"], [1, "130%"], [2, "100%"]]}}}
GONE = r"#/nodes/\d+/extras/wrinkle: .*rewritten.*bake from the original"


def bake(asset: Path, out: Path, *tools: Json, top: Json | None = None, **options: Any) -> Path:
    out.parent.mkdir(exist_ok=True, parents=True)
    (out.parent.parent / "tools").mkdir(exist_ok=True)
    file = write_tools(out.parent.parent / "tools" / "tools.yaml", *tools, **(top or {}))
    wrinklecli.bake(asset, file, out, **{"max_error": Length(5.0, percent=True), "max_levels": 1, **options})
    return out


def files(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def assert_same(one: Document, other: Document) -> None:
    """Equal JSON to the order of keys and the types of numbers, and equal buffers."""
    assert json.dumps(one.gltf) == json.dumps(other.gltf)
    assert [bytes(data) for data in one.buffers] == [bytes(data) for data in other.buffers]


def crowded() -> Path:
    """Unknown keys and extensions everywhere, keys in no usual order."""
    asset = limb_asset(rings=13, morphs=2, weights_at="both", morph_clip="LINEAR", primitives=2)
    crowd(asset)
    return place(asset)


def limb(ending: str = ".glb", **options: Any) -> Path:
    return place(limb_asset(rings=13, **options), ending)


Case = tuple[Callable[[], Path], list[Json], Json, list[Json]]
CASES: dict[str, Case] = {
    "interleaved": (lambda: limb(interleave=True), [LIMB], {}, [FINER_LIMB]),
    "wrist": (lambda: sample("wrist"), [PALM, BACK], {}, [FINER]),
    "nothing refined": (lambda: sample("wrist"), [PALM], {"max_levels": 0}, [FINER]),
    "trousers": (lambda: sample("trousers"), [KNEE, {**KNEE, "name": "again"}], {}, [{**KNEE, "bumps": 2}]),
    "head": (lambda: sample("head"), [BROW], {"max_levels": 1}, [{**BROW, "name": "new", "strategy": "origin"}]),
    "keyed rest length": (lambda: sample("head"), [KEYED], {"max_levels": 0}, [BROW]),
    "steps": (lambda: edited("head", sharp_keys), [BROW], {"max_levels": 0}, [BROW]),
    "splines": (lambda: edited("head", spline_keys), [BROW], {"max_levels": 0}, [BROW]),
    "targets without names": (lambda: edited("head", unnamed_targets), [BROW], {"max_levels": 0}, [BROW]),
    "bystanders": (lambda: edited("wrist", bystanders), [PALM], {}, [FINER]),
    "two parts": (lambda: edited("wrist", two_parts), [PALM], {}, [FINER]),
    "shared vertices": (lambda: edited("wrist", three_materials), [PALM], {}, [FINER]),
    "without normals": (lambda: edited("wrist", without_normals), [PALM], {}, [FINER]),
    "cloned mesh": (lambda: edited("wrist", shared_mesh), [aside(PALM)], {}, [aside(FINER)]),
    "two nodes": (
        lambda: edited("wrist", two_meshes),
        [{**PALM, "node": "wrist"}, aside(BACK)],
        {},
        [aside(FINER)],
    ),
    "tangents": (lambda: edited("wrist", with_tangents), [PALM], {"morph_tangents": True}, [FINER]),
    "patch": (lambda: sample("wrist"), [{**PALM, "attachment": "patch"}, BACK], {"max_levels": 0}, [FINER]),
    "dense": (lambda: sample("wrist"), [PALM], {"accessors": "dense"}, [FINER]),
    "no tracks": (lambda: sample("wrist"), [PALM], {"tracks": "none"}, [FINER]),
    "for an engine": (lambda: sample("wrist"), [PALM, BACK], {"engine": "three"}, [FINER]),
    "a rest pose": (lambda: sample("wrist"), [PALM], {"top": {"rest": {"clip": "extend", "time": 1.0}}}, [FINER]),
    "unknown keys": (crowded, [LIMB], {}, [FINER_LIMB]),
    "sparse": (lambda: limb(sparse="base", morphs=1, morph_clip="STEP"), [LIMB], {}, [FINER_LIMB]),
    "strip": (lambda: limb(".gltf", mode="strip"), [LIMB], {}, [FINER_LIMB]),
    **{name: (lambda name=name: compressed_sample(name), [PALM], {}, [FINER]) for name in EVERY},  # type: ignore[misc]
}


# Of a .gltf the buffers' files too: where they are kept, cut, or not there to begin with.
AS_GLTF = (
    "wrist",
    "cloned mesh",
    "two nodes",
    "unknown keys",
    "strip",
    "gltfpack_cc",
    "gltf_transform_draco",
)


@pytest.mark.quick(1, 3)
@pytest.mark.parametrize("case", CASES)
def test_the_original_comes_back(case: str, tmp_path: Path) -> None:
    asset, tools, options, _ = CASES[case]
    earlier = bake(asset(), tmp_path / "earlier" / "earlier.glb", *tools, **options)
    assert_same(restore.original(read_document(earlier)), read_document(asset()))


@pytest.mark.quick(0, 2)
@pytest.mark.parametrize(("case", "ending"), [("trousers", "glb"), *((each, "gltf") for each in AS_GLTF)])
def test_same_bytes_as_from_the_original(case: str, ending: str, tmp_path: Path) -> None:
    asset, first, options, second = CASES[case]
    earlier = bake(asset(), tmp_path / "earlier" / f"earlier.{ending}", *first, **options)
    bake(asset(), tmp_path / "direct" / f"out.{ending}", *second)
    bake(earlier, tmp_path / "replaced" / f"out.{ending}", *second, replace=True)
    assert files(tmp_path / "direct") == files(tmp_path / "replaced")


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize(
    ("asset", "config"), [("wrist", "wrist"), ("head", "head"), ("head", "head_keyed"), ("trousers", "trousers")]
)
def test_samples_come_back_and_their_records_are_small(asset: str, config: str) -> None:
    baked, source = read_document(bake_config(asset, config, fine=True).path), read_document(sample(asset))
    assert_same(restore.original(baked), source)
    record = baked.items("bufferViews")[-1]["byteLength"]
    assert record < 0.02 * (len(baked.buffers[0]) - len(source.buffers[0]))
    assert record < 20_000  # the head's forehead is refined from side to side


@pytest.mark.quick(1)
@pytest.mark.parametrize("name", ["wrist", "head", "trousers"])
def test_old_vertices_are_found_and_not_compressed(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    alike: list[int] = []
    dictionary = restore._dictionary

    def noted(bare: Json, parts: list[bytes]) -> bytes:
        alike.append(sum(len(part) for part in parts))
        return dictionary(bare, parts)

    monkeypatch.setattr(restore, "_dictionary", noted)
    tool = {"wrist": PALM, "head": BROW, "trousers": KNEE}[name]
    out = bake(sample(name), tmp_path / "b" / "out.glb", tool, max_levels=1)
    source, baked = read_document(sample(name)), read_document(out)
    before, primitive = (each.items("meshes")[0]["primitives"][0] for each in (source, baked))
    # Of indices the triangles between the first and the last that were split, weight tracks, and own targets that
    # have become sparse.
    old, new = source.stored(before["indices"]).tobytes(), baked.stored(primitive["indices"]).tobytes()
    head = sum(takewhile(bool, map(eq, old, new)))
    tail = sum(takewhile(bool, map(eq, old[head:][::-1], new[head:][::-1])))
    own = primitive["targets"][: len(before.get("targets", []))]
    sparse = sum(baked.items("accessors")[k]["sparse"]["count"] for each in own for k in each.values())
    between = len(new) - head - tail
    assert between <= alike[0] < 1.05 * between + 12 * sparse
    restore.original(baked)
    assert alike[1:] == alike[:1]


@pytest.mark.slow
def test_replacing_again_and_again_is_replacing_once(tmp_path: Path) -> None:
    file = bake(sample("wrist"), tmp_path / "0" / "out.glb", PALM)
    for number, tools in enumerate(([FINER], [PALM, BACK], [PALM]), start=1):
        file = bake(file, tmp_path / str(number) / "out.glb", *tools, replace=True)
    assert files(tmp_path / "0") == files(tmp_path / "3")


@pytest.mark.slow
def test_bakes_of_one_node_after_another_come_off_together(tmp_path: Path) -> None:
    asset = edited("wrist", two_meshes)
    first = bake(asset, tmp_path / "first" / "out.glb", {**PALM, "node": "wrist"})
    second = bake(first, tmp_path / "second" / "out.glb", aside(BACK))
    assert_same(restore.original(read_document(second)), read_document(asset))


@pytest.mark.quick(0, 2)
@pytest.mark.parametrize(
    ("earlier", "out"),
    [
        (earlier, out)
        for earlier in ("in/b.glb", "in/b.gltf", "b/b.glb", "b/b.gltf")
        for out in ("in/c.glb", "in/c.gltf", "c/c.glb", "c/c.gltf", "b/c.glb", "b/c.gltf")
        if (earlier[0], out) != ("b", "in/c.gltf")  # the original's folder is not known any more
    ],
)
def test_resources_of_every_kind(earlier: str, out: str, tmp_path: Path) -> None:
    """As from the original; where that lay elsewhere than the earlier bake, as from an original in another folder."""
    (tmp_path / "in").mkdir()
    asset = scattered(tmp_path / "in")
    shutil.copytree(tmp_path / "in", tmp_path / "away")
    middle = bake(asset, tmp_path / earlier, LIMB)
    start = asset if earlier.startswith("in/") else tmp_path / "away" / asset.name
    kept = files(tmp_path)
    bake(start, tmp_path / out, FINER_LIMB)
    made = {name: data for name, data in files(tmp_path).items() if kept.get(name) != data}
    for name in made:
        (tmp_path / name).unlink()
    for name, data in kept.items():
        (tmp_path / name).write_bytes(data)
    bake(middle, tmp_path / out, FINER_LIMB, replace=True)
    again = {name: data for name, data in files(tmp_path).items() if kept.get(name) != data}
    assert made == again
    assert out in made


@pytest.mark.slow
def test_a_glb_is_the_same_in_the_original_s_folder_too(tmp_path: Path) -> None:
    asset = shutil.copy(limb(".gltf", morphs=1), tmp_path / "limb.gltf")
    shutil.copy(Path(limb(".gltf", morphs=1)).with_suffix(".bin"), tmp_path / "limb.bin")
    elsewhere = bake(asset, tmp_path / "b" / "b.glb", LIMB)
    direct = bake(asset, tmp_path / "direct.glb", FINER_LIMB)
    replaced = bake(elsewhere, tmp_path / "replaced.glb", FINER_LIMB, replace=True)
    assert direct.read_bytes() == replaced.read_bytes()


@pytest.mark.slow
@pytest.mark.parametrize("ending", ["glb", "gltf"])
def test_images_from_outside_the_folder(ending: str, tmp_path: Path) -> None:
    asset = limb_asset(rings=13)
    asset.gltf["images"] = [{"uri": "../skin.png"}]
    (tmp_path / "in").mkdir()
    (tmp_path / "skin.png").write_bytes(PNG)
    source = asset.write(tmp_path / "in" / "limb.gltf")
    earlier = bake(source, tmp_path / "b" / f"b.{ending}", LIMB, allow_external=True)
    (tmp_path / "skin.png").rename(tmp_path / "moved.png")
    bake(earlier, tmp_path / "replaced" / f"c.{ending}", FINER_LIMB, replace=True)
    (tmp_path / "moved.png").rename(tmp_path / "skin.png")
    bake(source, tmp_path / "direct" / f"c.{ending}", FINER_LIMB, allow_external=True)
    assert files(tmp_path / "direct") == files(tmp_path / "replaced")


@pytest.mark.slow
def test_images_come_back_through_two_bakes(tmp_path: Path) -> None:
    """The second file holds the image itself, the first had it beside, where it is no more."""
    (tmp_path / "in.glb").write_bytes(edited("wrist", two_meshes).read_bytes())
    (tmp_path / "skin.png").write_bytes(PNG)
    document = EditedDocument(read_document(tmp_path / "in.glb"))
    document.gltf["images"] = [{"uri": "skin.png"}]
    write(document, tmp_path / "in.glb")
    first = bake(tmp_path / "in.glb", tmp_path / "first" / "out.gltf", {**PALM, "node": "wrist"})
    second = bake(first, tmp_path / "second" / "out.glb", aside(BACK))
    restored = restore.original(read_document(second))
    assert restored.gltf == read_document(tmp_path / "in.glb").gltf
    assert restored.resources == {"skin.png": PNG}


def test_what_was_read_is_named(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    earlier = bake(scattered(tmp_path / "in"), tmp_path / "b" / "b.gltf", LIMB)
    tools = write_tools(tmp_path / "tools.yaml", LIMB)
    report = wrinklecli.bake(earlier, tools, tmp_path / "c.glb", replace=True)
    assert {Path(name).name for name in report.inputs} >= {"b.gltf", "tools.yaml", "skin.png", "ä#1.png"}
    assert all(Path(name).parent != tmp_path / "in" for name in report.inputs)


@pytest.mark.parametrize("uri", ["padded", "plain"])
def test_data_in_uris_comes_back_to_the_letter(uri: str, tmp_path: Path) -> None:
    """A URI with more bytes than the buffer's length says cannot be made of the buffer."""
    asset = limb_asset(rings=13)
    path = asset.write(tmp_path / "limb.gltf", buffer="data")
    if uri == "padded":
        gltf = json.loads(path.read_text())
        head, _, body = gltf["buffers"][0]["uri"].partition(",")
        gltf["buffers"][0]["uri"] = f"{head},{b64encode(b64decode(body) + bytes(2)).decode()}"
        path.write_text(json.dumps(gltf))
    source = read_document(path)
    edited = EditedDocument(source)
    edited.gltf["nodes"][0].setdefault("extras", {})["wrinkle"] = {"tools": []}
    edited.add(source.stored(0))
    write(edited, tmp_path / "b.glb", seal=partial(restore.seal, source))
    assert_same(restore.original(read_document(tmp_path / "b.glb")), source)
    record = read_document(tmp_path / "b.glb").items("bufferViews")[-1]["byteLength"]
    if uri == "plain":
        assert record < 0.05 * len(source.buffers[0])


@pytest.mark.slow
@pytest.mark.parametrize("options", [{"mode": "frames"}, {"frames": "obj"}])
def test_frames_of_the_original(options: Json, tmp_path: Path) -> None:
    earlier = bake(sample("wrist"), tmp_path / "earlier" / "out.glb", PALM)
    for folder, asset in (("direct", sample("wrist")), ("replaced", earlier)):
        out = tmp_path / folder / "out.glb"
        more = {"mode": "frames"} if "mode" in options else {"frames_dir": tmp_path / folder / "frames"}
        bake(asset, out, FINER, fps=4, max_levels=1, clips=["flex"], replace=asset == earlier, **more)
    assert files(tmp_path / "direct") == files(tmp_path / "replaced")
    assert len(files(tmp_path / "direct")) > ("frames" in options)


@pytest.mark.quick(1)
@pytest.mark.parametrize("levels", [0, 2])
def test_without_the_option_it_is_named(levels: int, tmp_path: Path) -> None:
    earlier = bake(sample("wrist"), tmp_path / "b" / "earlier.glb", PALM, max_levels=levels)
    with pytest.raises(BakeError, match="--replace"):
        bake(earlier, tmp_path / "b" / "out.glb", FINER)
    assert not (tmp_path / "b" / "out.glb").exists()


def test_an_asset_without_wrinkles_bakes_as_ever(tmp_path: Path) -> None:
    for name, replace in (("direct", False), ("replaced", True)):
        bake(sample("wrist"), tmp_path / name / "out.glb", PALM, replace=replace)
    assert files(tmp_path / "direct") == files(tmp_path / "replaced")


def test_the_input_is_left_as_it_was(tmp_path: Path) -> None:
    earlier = bake(sample("wrist"), tmp_path / "b" / "earlier.glb", PALM)
    kept = earlier.read_bytes()
    with pytest.raises(BakeError, match="overwritten"):
        bake(earlier, earlier, FINER, replace=True)
    assert earlier.read_bytes() == kept


@pytest.mark.slow
def test_from_the_command_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    earlier = bake(sample("wrist"), tmp_path / "b" / "earlier.glb", PALM)
    direct = bake(sample("wrist"), tmp_path / "b" / "direct.glb", FINER)
    monkeypatch.chdir(tmp_path)
    options = ["bake", str(earlier), "tools/tools.yaml", "-o", "out.glb", "--replace", "--max-error", "5%"]
    options += ["--max-levels", "1"]
    monkeypatch.setattr(sys, "argv", ["wrinkle", *options, "-q"])
    cli.main()
    assert (tmp_path / "out.glb").read_bytes() == direct.read_bytes()


@pytest.mark.quick(1)
@pytest.mark.parametrize(("asset", "config"), [("wrist", "wrist"), ("head", "head"), ("trousers", "trousers")])
def test_the_validator_calls_the_record_unused_and_nothing_else(asset: str, config: str) -> None:
    before, after = validate([sample(asset), bake_config(asset, config).path])
    last = len(bake_config(asset, config).json["bufferViews"]) - 1
    codes = {(message["code"], message.get("pointer")) for message in before.messages}
    fresh = [each for each in after.messages if (each["code"], each.get("pointer")) not in codes]
    assert [(each["code"], each["severity"], each["pointer"]) for each in fresh] == [
        ("UNUSED_OBJECT", 2, f"/bufferViews/{last}")
    ]


# Files that are not as they were written


@cache
def _baked_limb() -> bytes:
    asset = limb_asset(rings=13)
    asset.gltf["materials"] = [{"pbrMetallicRoughness": {"roughnessFactor": 0.5}}]
    path = place(asset)
    return bake(path, path.parent / "b" / "baked.glb", LIMB).read_bytes()


def baked_limb(folder: Path) -> Path:
    """A file of its own with a bake that is made once."""
    path = folder / "b" / "baked.glb"
    path.parent.mkdir()
    path.write_bytes(_baked_limb())
    return path


def colour(gltf: Json, _: bytearray) -> None:
    gltf["materials"][0]["pbrMetallicRoughness"]["roughnessFactor"] = 0.6


def renamed(gltf: Json, _: bytearray) -> None:
    gltf["nodes"][1]["name"] = "renamed"


def moved_key(gltf: Json, _: bytearray) -> None:
    gltf["asset"]["version"] = gltf["asset"].pop("version")
    gltf["asset"]["generator"] = "other"


def tool_renamed(gltf: Json, _: bytearray) -> None:
    gltf["nodes"][wrinkled(gltf)]["extras"]["wrinkle"]["tools"][0]["name"] = "other"


def vertex(gltf: Json, data: bytearray) -> None:
    data[gltf["bufferViews"][0].get("byteOffset", 0)] ^= 1


def no_reference(gltf: Json, _: bytearray) -> None:
    del gltf["nodes"][wrinkled(gltf)]["extras"]["wrinkle"]["original"]


def other_reference(gltf: Json, _: bytearray) -> None:
    gltf["nodes"][wrinkled(gltf)]["extras"]["wrinkle"]["original"] = 0


def no_entry(gltf: Json, _: bytearray) -> None:
    gltf["nodes"][wrinkled(gltf)]["extras"]["wrinkle"] = 5


def no_view(gltf: Json, _: bytearray) -> None:
    gltf["bufferViews"].pop()


def another_view(gltf: Json, _: bytearray) -> None:
    gltf["bufferViews"].append({"buffer": 0, "byteLength": 4})


def short_view(gltf: Json, _: bytearray) -> None:
    gltf["bufferViews"][-1]["byteLength"] = 20


def shorter(gltf: Json, _: bytearray) -> None:
    gltf["bufferViews"][-1]["byteLength"] -= 1


def record_digest(gltf: Json, data: bytearray) -> None:
    data[gltf["bufferViews"][-1]["byteOffset"]] ^= 1


def record_count(gltf: Json, data: bytearray) -> None:
    data[gltf["bufferViews"][-1]["byteOffset"] + 32] ^= 0x40


def record_ranges(gltf: Json, data: bytearray) -> None:
    """The whole buffer, of which the record is to be made."""
    struct.pack_into("<QQ", data, gltf["bufferViews"][-1]["byteOffset"] + 36, 0, 2**63)


def record_end(gltf: Json, data: bytearray) -> None:
    data[gltf["bufferViews"][-1]["byteOffset"] + gltf["bufferViews"][-1]["byteLength"] - 1] ^= 1


def record_middle(gltf: Json, data: bytearray) -> None:
    data[gltf["bufferViews"][-1]["byteOffset"] + 40 + gltf["bufferViews"][-1]["byteLength"] // 2] ^= 0xFF


def wrinkled(gltf: Json) -> int:
    (node,) = restore.wrinkled(gltf)
    return node


@pytest.mark.quick(6)
@pytest.mark.parametrize(
    "change",
    [
        colour,
        renamed,
        moved_key,
        tool_renamed,
        vertex,
        no_reference,
        other_reference,
        no_entry,
        no_view,
        another_view,
        short_view,
        shorter,
        record_digest,
        record_count,
        record_ranges,
        record_end,
        record_middle,
    ],
)
def test_a_file_that_was_changed_since_is_refused(change: Callable[[Json, bytearray], None], tmp_path: Path) -> None:
    gltf, data = read_glb(baked_limb(tmp_path).read_bytes())
    changed = bytearray(data)
    change(gltf, changed)
    path = tmp_path / "changed.glb"
    path.write_bytes(pack_glb(json.dumps(gltf).encode(), bytes(changed)))
    with pytest.raises(BakeError, match=rf"changed\.glb{GONE}"):
        bake(path, tmp_path / "b" / "out.glb", LIMB, replace=True)
    assert not (tmp_path / "b" / "out.glb").exists()


def test_a_file_whose_json_was_only_written_anew_is_not(tmp_path: Path) -> None:
    earlier = baked_limb(tmp_path)
    gltf, data = read_glb(earlier.read_bytes())
    path = tmp_path / "anew.glb"
    path.write_bytes(pack_glb(json.dumps(gltf, indent=3).encode(), data))
    assert path.read_bytes() != earlier.read_bytes()
    assert_same(*(restore.original(read_document(each)) for each in (path, earlier)))


def test_a_baked_file_without_its_extras_is_refused(tmp_path: Path) -> None:
    """Blender exports no extras unless told to keep custom properties: wrinkles would be baked over wrinkles."""
    gltf, data = read_glb(baked_limb(tmp_path).read_bytes())
    for node in gltf["nodes"]:
        node.pop("extras", None)
    path = tmp_path / "bare.glb"
    path.write_bytes(pack_glb(json.dumps(gltf).encode(), data))
    with pytest.raises(
        BakeError, match=r"bare\.glb: has morph targets of a bake, 'wrinkle_.*Custom Properties.*original"
    ):
        bake(path, tmp_path / "b" / "out.glb", LIMB, replace=True)
    with pytest.raises(AssetError, match=r"bare\.glb: has morph targets of a bake, 'wrinkle_.*Custom Properties"):
        track(path, [path], tmp_path / "tracked")
    assert not (tmp_path / "b" / "out.glb").exists()


def test_a_file_that_an_optimiser_has_written_is_refused(tmp_path: Path) -> None:
    earlier = bake_config("wrist", "wrist").path
    optimize(earlier, tmp_path / "optimised.glb")
    with pytest.raises(BakeError, match=GONE):
        bake(tmp_path / "optimised.glb", tmp_path / "b" / "out.glb", FINER, replace=True)


def test_a_baked_file_with_weights_of_another_body_is_refused(tmp_path: Path) -> None:
    """`track` writes clips anew, and what is baked in them stays."""
    body = bake_config("wrist", "wrist").path
    (made,) = track(body, [shutil.copy(body, tmp_path / "clips.glb")], tmp_path / "tracked")
    with pytest.raises(BakeError, match=GONE):
        bake(Path(made.path), tmp_path / "b" / "out.glb", FINER, replace=True)


# Records that are well sealed and lie


def forged(path: Path, change: Callable[[Json, bytes], tuple[Json, bytes]]) -> Path:
    """A baked file with another record, as sound as a record of those contents can be."""
    document = read_document(path)
    view = document.items("bufferViews")[-1]
    offset = view["byteOffset"]
    record = bytes(document.view(len(document.items("bufferViews")) - 1))
    (count,) = struct.unpack_from("<I", record, 32)
    body = 36 + 16 * count
    alike = [document.buffers[0][low:high] for low, high in struct.iter_unpack("<QQ", record[36:body])]
    bare = restore._without_record(document.gltf)
    raw = zstandard.ZstdCompressionDict(restore._dictionary(bare, alike), dict_type=zstandard.DICT_TYPE_RAWCONTENT)
    content = zstandard.ZstdDecompressor(dict_data=raw, max_window_size=2**31).decompress(record[body:])
    text, _, dead = content.partition(b"\n")
    made, dead = change(json.loads(text), dead)
    again = zstandard.ZstdCompressor(dict_data=raw).compress(json.dumps(made).encode() + b"\n" + dead)
    document.gltf["bufferViews"][-1]["byteLength"] = body + len(again)
    document.gltf["buffers"][0]["byteLength"] = offset + body + len(again)
    data = bytes(document.buffers[0][:offset]) + record[:body] + again
    out = path.with_name("forged.glb")
    out.write_bytes(pack_glb(json.dumps(document.gltf).encode(), data))
    return out


def test_a_forged_record_of_the_truth_is_believed(tmp_path: Path) -> None:
    path = baked_limb(tmp_path)
    assert_same(
        *(restore.original(read_document(each)) for each in (path, forged(path, lambda made, dead: (made, dead))))
    )


def _set(*keys: Any, to: Any) -> Callable[[Json, bytes], tuple[Json, bytes]]:
    def change(made: Json, dead: bytes) -> tuple[Json, bytes]:
        place: Any = made
        for key in keys[:-1]:
            place = place[key]
        place[keys[-1]] = to
        return made, dead

    return change


def _all_kept(made: Json, _: bytes) -> tuple[Json, bytes]:
    """The first bytes again and again."""
    made["kept"][0] = [[k * 1000, k * 1000 + 1000, 0, 0] for k in range(10_000)]
    made["sizes"][0] = made["gltf"]["buffers"][0]["byteLength"] = 10_000_000
    return made, b""


def _itself(made: Json, dead: bytes) -> tuple[Json, bytes]:
    made["gltf"]["nodes"][0]["extras"] = {"wrinkle": {"original": len(made["gltf"]["bufferViews"]) - 1}}
    return made, dead


def _deep(made: Json, dead: bytes) -> tuple[Json, bytes]:
    value: Json = {}
    for _ in range(300):
        value = {"a": value}
    made["gltf"]["extras"] = value
    return made, dead


LIES: dict[str, Callable[[Json, bytes], tuple[Json, bytes]]] = {
    "no JSON object": lambda made, dead: ([made], dead),  # type: ignore[return-value, arg-type]
    "no document": _set("gltf", to=3),
    "no version": _set("gltf", "asset", to={}),
    "nodes of another kind": _set("gltf", "nodes", to=3),
    "images of another kind": _set("gltf", "images", to={"0": None}),
    "images that are not there": _set("gltf", "images", to=[None]),
    "no buffers": _set("gltf", "buffers", to=[]),
    "a buffer too many": _set("gltf", "buffers", to=[{"byteLength": 4}] * 2),
    "a buffer without length": _set("gltf", "buffers", 0, to={}),
    "a buffer of another length": _set("gltf", "buffers", 0, "byteLength", to=4),
    "no sizes": _set("sizes", to=None),
    "a negative size": _set("sizes", 0, to=-1),
    "a great size": _set("sizes", 0, to=2**60),
    "a fractional size": _set("sizes", 0, to=0.5),
    "a size too many": _set("sizes", to=[1, 1]),
    "nothing kept": _set("kept", 0, to=[]),
    "a span of nothing known": _set("kept", 0, 0, to=[1, 2]),
    "a span of text": _set("kept", 0, 0, to="abcd"),
    "a span of another buffer": _set("kept", 0, 0, 2, to=7),
    "a span of a negative buffer": _set("kept", 0, 0, 2, to=-1),
    "a span outside": _set("kept", 0, 0, 3, to=2**40),
    "a span before": _set("kept", 0, 0, 3, to=-4),
    "a span backwards": _set("kept", 0, 0, to=[8, 4, 0, 0]),
    "spans without end": _all_kept,
    "bytes too few": lambda made, dead: (made, dead[:-1]),
    "bytes too many": lambda made, dead: (made, dead + b"\0"),
    "far too many bytes": lambda made, _: (made, bytes(2**27)),
    "no word of images": lambda made, dead: ({k: v for k, v in made.items() if k != "beside"}, dead),
    "itself again": _itself,
    "deep JSON": _deep,
    "numbers that are none": _set("gltf", "extras", to=float("nan")),
}


@pytest.mark.quick(4)
@pytest.mark.parametrize("lie", LIES)
def test_a_record_that_lies_is_refused_in_one_line(lie: str, tmp_path: Path) -> None:
    path = forged(baked_limb(tmp_path), LIES[lie])
    with pytest.raises(WrinkleError, match=r"forged\.glb#/nodes/\d+/extras/wrinkle: the (record|bytes)") as caught:
        bake(path, tmp_path / "b" / "out.glb", LIMB, replace=True)
    assert len(caught.value.lines) == 1


@pytest.mark.slow
def test_damaged_records_are_refused(tmp_path: Path) -> None:
    """At random, in the compressed stream, which the digest does not cover."""
    whole, path = baked_limb(tmp_path), tmp_path / "damaged.glb"
    gltf, data = read_glb(whole.read_bytes())
    view, before = gltf["bufferViews"][-1], restore.original(read_document(whole))
    refused = 0
    for number in range(200):
        chance, changed = random.Random(number), bytearray(data)
        for _ in range(chance.choice([1, 2, 8])):
            changed[view["byteOffset"] + 40 + chance.randrange(view["byteLength"] - 40)] ^= 1 << chance.randrange(8)
        path.write_bytes(pack_glb(json.dumps(gltf).encode(), bytes(changed)))
        try:
            assert_same(restore.original(read_document(path)), before)  # a bit may say nothing
        except BakeError:
            refused += 1
    assert refused > 150
