"""Reads clips of other files for an asset whose nodes have the same names."""

import os
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import islice, takewhile
from pathlib import Path

from wrinklecli.character.clip import Channel, Clip, read_clips
from wrinklecli.character.rig import morph_target_names, parents_of, read_rig, upwards
from wrinklecli.character.weight_track import by_names
from wrinklecli.errors import AssetError, counted, listed, nearest
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.document import Document, read_document
from wrinklecli.gltf.images import files_of
from wrinklecli.gltf.references import unused_name
from wrinklecli.gltf.shape import Json
from wrinklecli.numeric.arrays import Floats, Ints
from wrinklecli.numeric.guard import guarded

# Names of the longest path to a joint: rigs have some twenty levels, and hostile files thousands.
_MOST_NAMES = 32
# What programs put before the names of one rig: `mixamorig9:`, `mixamorig_`, `mixamorig`, and Maya's namespaces.
_PREFIX = re.compile(r"(?:.*:)?(?:mixamorig\d*_?)?(?=.)", re.DOTALL)


@dataclass(frozen=True, slots=True)
class Anims:
    """The contents of files with clips.

    Attributes:
        clips: Clips of the asset's nodes.
        notes: Lines on nodes that are left out and clips that are renamed.
        warnings: A line for each file without clips.
        read: Paths of the files that were read.
        beside: Paths of all files that these consist of, read or not.
    """

    clips: tuple[Clip, ...]
    notes: tuple[str, ...]
    warnings: tuple[str, ...]
    read: tuple[str, ...]
    beside: tuple[str, ...]


def read_anims(document: Document, paths: Sequence[str | os.PathLike[str]]) -> Anims:
    """Read the clips of files for the nodes of an asset.

    A channel moves the node of the same name. Weights go to morph targets of the same names; other targets keep the
    stored ones. A clip whose name is taken gets the name of its file, as Mixamo gives all of its clips one name.

    Raises:
        AssetError: A file is malformed, or none of its channels moves a node of the asset.
    """
    taken = {clip.name for clip in read_clips(document)}
    clips: list[Clip] = []
    notes: list[str] = []
    warnings: list[str] = []
    read: list[str] = []
    beside: list[str] = []
    for path in paths:
        with guarded(os.fspath(path)):
            anim = read_document(path, allow_external=document.allow_external, memory=document.memory)
            read += anim.files
            beside += files_of(anim)
            found = read_clips(anim)
            if not found:
                warnings.append(f"{anim.path}: has no clip")
                continue
            of_asset, left_out = _for_asset(document, anim, found)
            notes += left_out
            for clip in of_asset:
                # A name that no clip has yet: its own, that of its file, or one with a number.
                stem = Path(anim.path).stem
                other = stem if len(found) == 1 else f"{stem} {clip.name}"
                name = clip.name if clip.name not in taken else unused_name(other, taken, " ")
                if name != clip.name:
                    notes.append(f"{anim.path}: its clip {clip.name!r} is {name!r} here, as that name is taken")
                taken.add(name)
                clips.append(replace(clip, name=name))
    return Anims(tuple(clips), tuple(notes), tuple(warnings), tuple(read), tuple(beside))


def _for_asset(document: Document, anim: Document, clips: Sequence[Clip]) -> tuple[list[Clip], list[str]]:
    """Give the clips of a file with the asset's indices of nodes, and notes.

    Raises:
        AssetError: No clip moves a node of the asset.
    """
    names, known = ([str(node.get("name", "")) for node in each.items("nodes")] for each in (anim, document))
    there, here = NamedNodes.of(anim.items("nodes")), NamedNodes.of(document.items("nodes"))
    meshes: dict[int, tuple[tuple[str, ...], Floats]] = {}
    made: list[Clip] = []
    strangers: dict[str, None] = {}
    alike: dict[str, str] = {}
    for clip in clips:
        channels: list[Channel] = []
        for channel in clip.channels:
            name = names[channel.node]
            node = here.moved_by(channel.path, name) if there.moved_by(channel.path, name) == channel.node else None
            if (
                name not in here.joints
                and channel.path != "weights"
                and there.bare.get(bare_name(name)) == channel.node
            ):
                node = here.bare.get(bare_name(name))
                alike |= {} if node is None else {name: known[node]}
            moved = None
            if node is not None and channel.path == "weights":
                if node not in meshes:
                    rig = read_rig(document, node)
                    meshes[node] = rig.morph_names, rig.morph_weights
                theirs = morph_target_names(anim.items("meshes")[anim.items("nodes")[channel.node]["mesh"]])
                moved = _weights(channel, theirs, node, *meshes[node])
            elif node is not None:
                moved = replace(channel, node=node)
            if moved is None:
                strangers[name] = None
            else:
                channels.append(replace(moved, index=len(channels)))
        if channels:
            made.append(replace(clip, channels=tuple(channels)))
    if not made:
        raise AssetError(
            f"has no joints of {document.path}: its clips move {listed(strangers)}, the asset's nodes are"
            f" {listed(known)}",
            where=anim.path,
        )
    notes = [f"{anim.path}: {line}" for line in matched_without_prefixes(alike)]
    if strangers:
        hint = nearest(next(iter(strangers)), known) if len(strangers) == 1 else ""
        notes.append(
            f"{anim.path}: {counted(len(strangers), 'node')} of its clips cannot be moved in {document.path}:"
            f" {listed(strangers)}{hint}"
        )
    return made, notes


@dataclass(frozen=True, slots=True)
class NamedNodes:
    """Indices of nodes by their names.

    Attributes:
        joints: The first node of a name without a mesh, if any, as bodies are often named like a joint.
        meshes: The first node of a name with a mesh.
        shared: Names of joints that other nodes have with the same right.
        bare: The joints by their names without prefixes; only names that one node has.
        nodes: The nodes as the document has them.
        groups: Indices of nodes; those of an earlier group go first.
    """

    joints: dict[str, int]
    meshes: dict[str, int]
    shared: frozenset[str]
    bare: dict[str, int]
    nodes: Sequence[Json]
    groups: tuple[tuple[int, ...], ...]

    @classmethod
    def of(cls, nodes: Sequence[Json], preferred: Iterable[Iterable[int]] = ()) -> "NamedNodes":
        """Index nodes that have a name; a node of the first group of `preferred` that has the name is its joint."""
        bare = [index for index, node in enumerate(nodes) if "mesh" not in node]
        meshes = [index for index, node in enumerate(nodes) if "mesh" in node]
        joints: dict[str, int] = {}
        shared: set[str] = set()
        groups = tuple(tuple(dict.fromkeys(group)) for group in (*preferred, bare, meshes))
        for group in groups:
            found: dict[str, int] = {}
            for index in group:
                name = nodes[index].get("name")
                if name and name not in joints and found.setdefault(name, index) != index:
                    shared.add(name)
            joints |= found
        with_mesh = {nodes[index]["name"]: index for index in reversed(meshes) if nodes[index].get("name")}
        counts = Counter(map(bare_name, joints))
        alone = {bare_name(name): index for name, index in joints.items() if name not in shared}
        alone = {name: index for name, index in alone.items() if counts[name] == 1}
        return cls(joints, with_mesh, frozenset(shared), alone, nodes, groups)

    @classmethod
    def of_body(cls, gltf: Json, node: int | None, *, skinned: bool) -> "NamedNodes":
        """Index nodes for the drives of a body, on a node if the document has it.

        A joint of the body's own skin goes before those of other skins, as characters in one document often have the
        same names, and these go before other nodes. A body without skin is its own joint.
        """
        nodes, skins = gltf.get("nodes", []), gltf.get("skins", [])
        own: list[int] = []
        if node is not None:
            own = skins[nodes[node]["skin"]].get("joints", []) if "skin" in nodes[node] else [] if skinned else [node]
        return cls.of(nodes, [own, (joint for skin in skins for joint in skin.get("joints", []))])

    def joint(self, name: str) -> int | None:
        """The joint of a name, or of a path where several have the name: names from one above, with `/` between.

        Without any, it is the only one of the same name but for prefixes.
        """
        found = self.joints.get(name, next(iter(self._below(name)), None))
        return self.bare.get(bare_name(name)) if found is None else found

    def alike(self, names: Iterable[str]) -> dict[str, str]:
        """The names of those nodes that `joint` finds only without prefixes, by the names for which it does."""
        known = {name: self.bare.get(bare_name(name)) for name in names if name not in self.joints}
        return {name: self.nodes[i]["name"] for name, i in known.items() if i is not None and not self._below(name)}

    def called(self, index: int) -> str | None:
        """The name by which `joint` finds a node, or the shortest such path; None if another node has these too."""
        names = _names_above(self.nodes, index, parents_of(self.nodes))
        if names and names[0] not in self.shared and self.joints.get(names[0]) == index:
            return names[0]
        paths = ("/".join(reversed(names[: size + 1])) for size in range(1, len(names)))
        return next((path for path in paths if path not in self.joints and self._below(path) == [index]), None)

    def _below(self, path: str) -> list[int]:
        """The nodes of a path, in the first group that has any; none for a name without a path."""
        if "/" not in path:
            return []
        parents = parents_of(self.nodes)
        for group in self.groups:
            # A path ends in the node's name.
            ending = [index for index in group if path.endswith(f"/{self.nodes[index].get('name') or '/'}")]
            paths = ("/".join(["", *reversed(_names_above(self.nodes, each, parents))]) for each in ending)
            found = [index for index, whole in zip(ending, paths, strict=True) if whole.endswith(f"/{path}")]
            if found:
                return found
        return []

    def moved_by(self, path: str, name: str) -> int | None:
        """The node of a name that a channel of a path moves, if any."""
        if not name:
            return None
        return (self.meshes if path == "weights" else self.joints).get(name)


def bare_name(name: str) -> str:
    """A joint's name without namespaces, and without what programs put before the names of one rig."""
    return _PREFIX.sub("", name, count=1)


def matched_without_prefixes(names: Mapping[str, str]) -> Iterator[str]:
    """A line on joints of a file that count as others of the asset, by name; none without any."""
    for one, other in list(names.items())[:1]:
        more = f", and {counted(len(names) - 1, 'more joint')}" if len(names) > 1 else ""
        yield f"{one!r} counts as {other!r}, as their names are the same without prefixes{more}"


def _names_above(nodes: Sequence[Json], index: int, parents: Ints) -> list[str]:
    """The names of a node and of those above it, up to the first without a name."""
    names = (nodes[each].get("name", "") for each in islice(upwards(parents, index), _MOST_NAMES))
    return [*takewhile(bool, names)]


def _weights(
    channel: Channel, theirs: Sequence[str], node: int, names: Sequence[str], stored: Floats
) -> Channel | None:
    """Turn a channel of weights of another mesh, with morph targets `theirs`, into one for a node's mesh.

    The node's morph targets have `names` and `stored` weights, which targets without a namesake keep. Gives None if no
    target has a namesake.
    """
    if not set(names) & set(theirs):
        return None
    return replace(channel, node=node, values=by_names(channel.values, theirs, names, stored))
