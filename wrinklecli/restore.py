"""An asset as it was before an earlier bake: its targets, weights and extras taken out again.

What was only added can be taken out. Refined triangles cannot: the original ones are not kept in the file.
"""

import copy
from collections import Counter
from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from wrinklecli.document import Document, Json
from wrinklecli.draft import accessor_references, accessor_views, extension_integers, view_references
from wrinklecli.errors import AssetError, BakeError, WrinkleError
from wrinklecli.pose import morph_target_names

Array = NDArray[np.float32]

# A sampler, `input` or `output`, and the (numbers,) that it is to hold.
_Rewritten = tuple[Json, str, Array]

_ALIGNMENT = 4  # bytes; the largest component has as many
# Keys of an accessor that concern its data.
_STORAGE = ("bufferView", "byteOffset", "sparse", "min", "max")


def without_wrinkles(document: Document) -> Document:
    """Take out all that earlier bakes added to an asset.

    A bake of the result gives the same bytes as one of the original, if no clip had weights of the mesh before (and
    nothing else has rewritten the file since). Where a clip had some, its old targets move as they did, but the keys
    stay as dense as wrinkles needed them, LINEAR in place of STEP; and targets to which the bake gave NORMALs of
    zero keep these.

    Raises:
        BakeError: A mesh was refined, or other software has changed its vertices: a line for each.
        AssetError: Extras are not what `bake` writes.
    """
    gltf = copy.deepcopy(document.gltf)
    dropped: set[int] = set()
    narrowed: list[_Rewritten] = []
    problems: list[WrinkleError] = []
    for index, node in enumerate(gltf.get("nodes", [])):
        extras = node.get("extras")
        if not isinstance(extras, dict) or "wrinkle" not in extras or "mesh" not in node:
            continue
        where = document.where("nodes", index, "extras", "wrinkle")
        try:
            entry = extras["wrinkle"]
            names = {str(name) for tool in entry["tools"] for name in tool["targets"]} | set(entry.get("undriven", []))
            before = entry.get("vertices")
        except (KeyError, TypeError, AttributeError) as error:
            raise AssetError("is not what `wrinkle bake` writes", where=where) from error
        mesh = gltf["meshes"][node["mesh"]]
        now = [gltf["accessors"][each["attributes"]["POSITION"]]["count"] for each in mesh["primitives"]]
        if before != now:
            problems.append(
                BakeError(
                    "the earlier bake refined this mesh, which cannot be undone; bake from the original asset"
                    " (only bakes with --max-levels 0 can be replaced)",
                    where=where,
                )
            )
            continue
        keep = [k for k, name in enumerate(morph_target_names(mesh)) if name not in names]
        carriers = [k for k, each in enumerate(gltf["nodes"]) if each.get("mesh") == node["mesh"]]
        for carrier in carriers:
            _narrow_tracks(document, gltf, carrier, keep, dropped, narrowed)
        del extras["wrinkle"]
        _drop_if_made(node, "extras")
        for carrier in carriers:
            _narrow_weights(gltf["nodes"][carrier], mesh, keep)
        dropped |= _narrow_mesh(mesh, keep)
    if problems:
        raise BakeError.of_all(problems)
    return _compacted(document, gltf, dropped, narrowed) if dropped or narrowed else document


def _drop_if_made(holder: Json, key: str) -> None:
    """Remove an empty object or array if it is the last of its holder, where a bake would have put it."""
    if not holder[key] and next(reversed(holder)) == key:
        del holder[key]


def _narrow_mesh(mesh: Json, keep: list[int]) -> set[int]:
    """Keep some targets of a mesh; the accessors of the others."""
    names = morph_target_names(mesh)
    dropped: set[int] = set()
    for primitive in mesh["primitives"]:
        targets = primitive.get("targets", [])
        for number, target in enumerate(targets):
            if number not in keep:
                dropped |= set(target.values())
        if "targets" in primitive:
            primitive["targets"] = [targets[number] for number in keep]
            _drop_if_made(primitive, "targets")
    extras = mesh.get("extras")
    if isinstance(extras, dict) and "targetNames" in extras:
        extras["targetNames"] = [names[number] for number in keep]
        _drop_if_made(extras, "targetNames")
        _drop_if_made(mesh, "extras")
    if "weights" in mesh:
        mesh["weights"] = [mesh["weights"][number] for number in keep]
    return dropped


def _narrow_weights(node: Json, mesh: Json, keep: list[int]) -> None:
    """Keep some of a node's stored weights, and none where a bake has put them there."""
    if "weights" not in node:
        return
    weights = node["weights"]
    kept = [weights[number] for number in keep]
    shown = mesh.get("weights", [0.0] * len(weights))
    # A bake adds weights to a node only where its own are not zero.
    added = kept == [shown[number] for number in keep] and any(
        weight for number, weight in enumerate(weights) if number not in keep
    )
    node["weights"] = [] if added else kept
    _drop_if_made(node, "weights")


def _narrow_tracks(
    document: Document,
    gltf: Json,
    node: int,
    keep: list[int],
    dropped: set[int],
    narrowed: list[_Rewritten],
) -> None:
    """Keep some columns of a node's weight tracks; tracks that a bake has added go altogether."""
    for animation in gltf.get("animations", []):
        for number, channel in reversed(list(enumerate(animation["channels"]))):
            if channel.get("target", {}).get("node") != node or channel["target"].get("path") != "weights":
                continue
            sampler = animation["samplers"][channel["sampler"]]
            times, values = (document.accessor(sampler[key]) for key in ("input", "output"))
            spline = 3 if sampler.get("interpolation") == "CUBICSPLINE" else 1
            kept = values.reshape(len(times) * spline, -1)[:, keep].astype(np.float32)
            if not keep or channel.get("extras") == {"wrinkle": "added"}:
                dropped |= {sampler["input"], sampler["output"]}
                del animation["channels"][number]
                _remove_sampler(animation, channel["sampler"])
            else:
                # Key times too: they lie behind what is dropped, and would keep its place.
                narrowed.append((sampler, "input", times.astype(np.float32)))
                narrowed.append((sampler, "output", kept.reshape(-1)))


def _remove_sampler(animation: Json, number: int) -> None:
    """Remove a sampler that no channel uses any more."""
    if any(channel["sampler"] == number for channel in animation["channels"]):
        return
    del animation["samplers"][number]
    for channel in animation["channels"]:
        channel["sampler"] -= channel["sampler"] > number


def _compacted(document: Document, gltf: Json, dropped: set[int], narrowed: list[_Rewritten]) -> Document:
    """The document with new JSON, without the data at its end that this does not refer to any more.

    Args:
        document: As it was.
        gltf: The new JSON, to change.
        dropped: Accessors that lost a reference.
        narrowed: What samplers' inputs and outputs are to hold.
    """
    accessors, views = gltf["accessors"], gltf.setdefault("bufferViews", [])
    buffers = [dict(buffer) for buffer in document.items("buffers")]
    data = [bytes(each) for each in document.buffers]
    foreign = set(extension_integers(gltf))
    uses = Counter([*accessor_references(gltf), *foreign])
    dead = {index for index in dropped if not uses[index]}
    narrowed = [each for each in narrowed if each[1] == "output" or uses[each[0]["input"]] == 1]
    for sampler, key, _ in narrowed:
        if uses[sampler[key]] > 1:
            uses[sampler[key]] -= 1
            accessors.append({})
            sampler[key] = len(accessors) - 1
    freed = dead | {sampler[key] for sampler, key, _ in narrowed}
    candidates = {view for index in freed for view in accessor_views(accessors[index])}
    for index in freed:
        # One between others stays, without data, so that these keep their numbers.
        accessors[index] = {key: value for key, value in accessors[index].items() if key not in _STORAGE}
    _pop_while(accessors, dead)
    dead_views = candidates - set(view_references(gltf)) - foreign
    for number in range(len(buffers)):
        live = [_span(view) for k, view in enumerate(views) if view["buffer"] == number and k not in dead_views]
        end = max((high for _, high in live), default=0)
        gone = [_span(views[k])[0] for k in dead_views if views[k]["buffer"] == number]
        data[number] = data[number][: min((low for low in gone if low >= end), default=len(data[number]))]
    for k in dead_views:
        views[k] = {"buffer": 0, "byteLength": 1}
    free = sorted(dead_views)
    for sampler, key, values in narrowed:
        if not free:
            views.append({})
            free = [len(views) - 1]
        stored, slot, last = values.astype("<f4").tobytes(), free.pop(0), len(data) - 1
        data[last] += bytes(-len(data[last]) % _ALIGNMENT)
        views[slot] = {"buffer": last, "byteOffset": len(data[last]), "byteLength": len(stored)}
        data[last] += stored
        index = sampler[key]
        entry = {"bufferView": slot, "componentType": 5126, "count": len(values), "type": "SCALAR"}
        if key == "input":
            entry |= {"min": [float(values[0])], "max": [float(values[-1])]}
        accessors[index] = entry | {
            name: accessors[index][name] for name in ("name", "extras") if name in accessors[index]
        }
    _pop_while(views, free)
    used = {view["buffer"] for view in views}
    while buffers and len(buffers) - 1 not in used and not data[-1]:
        buffers.pop()
        data.pop()
    for number, buffer in enumerate(buffers):
        if len(data[number]) != len(document.buffers[number]):
            # What a URI would name is the old data.
            buffer.pop("uri", None)
            buffer["byteLength"] = len(data[number])
    gltf["buffers"] = buffers
    return replace(document, gltf=gltf, buffers=tuple(memoryview(each) for each in data))


def _pop_while(items: list[Json], free: Iterable[int]) -> None:
    while items and len(items) - 1 in free:
        items.pop()


def _span(view: Json) -> tuple[int, int]:
    start = view.get("byteOffset", 0)
    return start, start + view["byteLength"]
