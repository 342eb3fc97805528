"""A baked body on the nodes of a file with clips: which of its drives act there, with what weights, and where to."""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from wrinklecli.baking.baked_body import BakedBody, BakedPart
from wrinklecli.baking.morphs import add_idle_targets
from wrinklecli.character.anims import NamedNodes
from wrinklecli.character.clip import Clip
from wrinklecli.character.rig import Rig, morph_target_names, moving_nodes, read_rig
from wrinklecli.character.weight_track import by_names
from wrinklecli.drive.drive import AnyDrive, StoredDrive
from wrinklecli.drive.play import Playing, play_grid, play_keys
from wrinklecli.errors import AssetError, listed, nearest
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.document import Document
from wrinklecli.gltf.edited_document import VERTEX_DATA, EditedDocument
from wrinklecli.gltf.shape import Json
from wrinklecli.numeric.arrays import Floats
from wrinklecli.numeric.piecewise import Signal

# The error bound leaves this much beside the table's own error: a part for samples and a part for dropped keys.
_SAMPLING_SHARE = 2 / 3
_KEYS_SHARE = 1 / 3


def targets_there(document: Document, name: str) -> tuple[str, ...] | None:
    """The names of the morph targets of a file's own mesh on the node of a name; None if there is none."""
    found = next((node for node in document.items("nodes") if node.get("name") == name and "mesh" in node), None)
    return None if found is None else tuple(morph_target_names(document.items("meshes")[found["mesh"]]))


def node_for_tracks(edited: EditedDocument, body: BakedPart, *, ambiguous: bool) -> int:
    """The node that gets a body's tracks: the file's own of that name, which may lack its mesh, or a stub.

    The morph targets of the file's own mesh are put in the order of the body's, which has all of their names; those
    that the mesh lacks do nothing. A body without morph targets gets a node without a mesh. If the body's name is
    `ambiguous`, a node without a mesh may be a joint, and is left alone.

    Raises:
        AssetError: The file has a mesh on a node of that name, with two morph targets of one name, or without vertices.
    """
    nodes = edited.gltf.setdefault("nodes", [])
    found = [index for index, node in enumerate(nodes) if node.get("name") == body.node and "mesh" in node]
    if not found:
        joints = {joint for skin in edited.gltf.get("skins", []) for joint in skin.get("joints", [])}
        bare = [index for index, node in enumerate(nodes) if node.get("name") == body.node and index not in joints]
        index = bare[0] if bare and not ambiguous else _add_node(edited.gltf, body.node)
        if body.targets:
            _add_stub(edited, body, nodes[index])
        return index
    node = nodes[found[0]]
    names = tuple(morph_target_names(edited.gltf["meshes"][node["mesh"]]))
    if names != body.targets:
        twice = [name for name, count in Counter(names).items() if count > 1]
        if twice:
            raise AssetError(
                f"the mesh of {body.node!r} has several morph targets of one name, {listed(twice)}: weights are matched"
                " by name",
                where=edited.source.where("nodes", found[0]),
            )
        _refuse_incomplete(edited.source, node["mesh"], targets=len(names))
        add_idle_targets(edited, node, body.targets, names)
    return found[0]


def _refuse_incomplete(document: Document, mesh: int, *, targets: int) -> None:
    """Check that a mesh has primitives, all of them with vertices and with so many morph targets."""
    primitives = document.items("meshes")[mesh].get("primitives", [])
    if not primitives:
        raise AssetError("has no primitives", where=document.where("meshes", mesh))
    for number, primitive in enumerate(primitives):
        where = document.where("meshes", mesh, "primitives", number)
        if "POSITION" not in primitive.get("attributes", {}):
            raise AssetError("has no POSITION", where=where)
        if len(primitive.get("targets", [])) != targets:
            raise AssetError(f"has {len(primitive.get('targets', []))} morph targets, not {targets}", where=where)


def _add_node(gltf: Json, name: str) -> int:
    """Append a node to the scene; return its index."""
    nodes = gltf["nodes"]
    nodes.append({"name": name})
    for scene in gltf.get("scenes", [])[gltf.get("scene", 0) :][:1]:
        scene.setdefault("nodes", []).append(len(nodes) - 1)
    return len(nodes) - 1


def _add_stub(edited: EditedDocument, body: BakedPart, node: Json) -> None:
    """Give a node a mesh of the body's names and targets, three vertices in one point."""
    point = edited.add(np.zeros((3, 3), np.float32), target=VERTEX_DATA, bounds=True)
    primitive: Json = {"attributes": {"POSITION": point}, "targets": [{"POSITION": point} for _ in body.targets]}
    mesh: Json = {} if body.mesh is None else {"name": body.mesh}
    # Players name the parts of a mesh by their number, and tracks by the part.
    mesh["primitives"] = [primitive for _ in range(body.primitives)]
    mesh["weights"] = [0.0] * len(body.targets)
    mesh["extras"] = {"targetNames": list(body.targets)}
    meshes = edited.gltf.setdefault("meshes", [])
    meshes.append(mesh)
    node["mesh"] = len(meshes) - 1
    if body.stored.any():
        node["weights"] = body.stored.tolist()


def present_drives(body: BakedBody, gltf: Json) -> tuple[list[StoredDrive], list[str]]:
    """The drives whose joints are all there, and a warning for each tool of which a joint is missing or ambiguous.

    Without any of the segments that the body has, there are no drives: a fold alone has nothing to move.
    """
    names = joints_of(body, gltf)
    present, warnings = [], []
    for drive in body.drives:
        missing = [joint for joint in drive.joints if names.joint(joint) is None]
        several = [joint for joint in drive.joints if joint in names.shared]
        if not missing:
            present.append(drive)
        if not drive.acts_alone:
            continue  # its tool's warning says it
        if missing:
            hint = nearest(missing[0], names.joints) if len(missing) == 1 else ""
            warnings.append(f"{drive.name}: left out, as there is no joint {listed(missing)}{hint}")
        elif several:
            warnings.append(f"{drive.name}: several nodes are named {listed(several)}; the first is taken")
    wanted, found = (any(each.acts_alone for each in drives) for drives in (body.drives, present))
    return present if found or not wanted else [], warnings


def joints_of(body: BakedBody, gltf: Json) -> NamedNodes:
    """The nodes of a document by the names of a body's joints."""
    nodes = gltf.get("nodes", [])
    named = [index for index, node in enumerate(nodes) if node.get("name") == body.node]
    node = next((index for index in named if "mesh" in nodes[index]), None if body.skinned or not named else named[0])
    return NamedNodes.of_body(gltf, node, skinned=body.skinned)


def with_own_weights(clip: Clip, node: int, body: BakedBody, there: Sequence[str] | None) -> Clip:
    """The clip with a weights channel of the targets that no drive sets, or none if there are no such targets.

    Of the names of the targets that are `there` in the file, those of the body count; the others of the body are as
    stored. Without a mesh, the channel has the body's targets, or those that the asset had before it was baked.
    """
    channel = clip.channel(node, "weights")
    if channel is None:
        return clip
    if there is None:
        there = body.targets if channel.values.shape[-1] == len(body.targets) else body.original
    values = by_names(channel.values, there, body.kept, body.stored(body.kept))
    kept = (replace(channel, values=values),) if body.kept else ()
    return replace(clip, channels=tuple(c for c in clip.channels if c is not channel) + kept)


@dataclass(frozen=True, slots=True)
class DrivenBody:
    """Morph targets of a body, driven by the joints of another file.

    Attributes:
        drives: The drives whose joints are all there.
        keyed: Names of the clips that key a rest length.
        rig: The joints of the drives, and the morph targets that nothing drives, of the node that gets the tracks;
            then the driven ones that carry anchors.
        stored: (driven targets,) weights in the stored pose, for all drives of the body.
        columns: For each drive, the numbers of its targets among the driven ones.
    """

    drives: tuple[AnyDrive, ...]
    keyed: frozenset[str]
    rig: Rig
    stored: Floats
    columns: tuple[list[int], ...]

    @classmethod
    def of(cls, document: Document, node: int, body: BakedBody, drives: Sequence[StoredDrive]) -> "DrivenBody":
        """Find a body's joints in the file that has the node for its tracks."""
        whole = read_rig(document, node)
        named = joints_of(body, document.gltf)
        wanted = {joint: named.joint(joint) for each in drives for joint in each.joints}
        joints = {joint: node for joint, node in wanted.items() if node is not None}
        kept, driven = body.kept, body.driven
        # Drives whose targets carry the anchors of others, as muscles do under wrinkles, act first.
        carrying = {name for each in drives for name in each.carrying_targets}
        moving = [each.on(joints, kept) for each in drives if carrying.intersection(each.targets)]
        rig = replace(
            whole,
            joints=np.array(list(joints.values()), np.intp),
            inverse_binds=np.tile(np.eye(4), (len(joints), 1, 1)),
            morph_names=kept,
            morph_weights=whole.morph_weights[[body.targets.index(name) for name in kept]],
        ).driven_by(moving)
        numbers = {name: number for number, name in enumerate(driven)}
        columns = tuple([numbers[name] for name in each.targets] for each in drives)
        keyed = frozenset(clip for each in drives for clip in each.keyed)
        on_rig = tuple(each.on(joints, rig.morph_names) for each in drives)
        return cls(on_rig, keyed, rig, body.stored(driven), columns)

    def moved_by(self, clip: Clip) -> bool:
        """True if a clip moves a joint, or keys a rest length."""
        moving = moving_nodes(self.rig)
        return any(c.node in moving for c in clip.channels) or clip.name in self.keyed

    def weights_in(self, clip: Clip) -> Signal:
        """(frames,) seconds of a clip to (frames, driven targets) weights; those of absent drives as stored."""
        acting = [number for number, each in enumerate(self.drives) if not self._has_own(each, clip)]
        playing = Playing([self.drives[number] for number in acting], self.rig, clip)
        columns = [column for number in acting for column in self.columns[number]]

        def weights(times: Floats) -> Floats:
            found = np.tile(self.stored, (len(times), 1))
            found[:, columns] = playing.at(times)
            return found

        return weights

    def flat(self, clip: Clip, times: Floats, weights: Floats) -> Iterator[str]:
        """A line for each tool whose (frames, driven targets) weights are 0 at (frames,) seconds of a clip."""
        for drive, columns in zip(self.drives, self.columns, strict=True):
            why = drive.why_flat(self.rig, clip, times)
            if why is not None and not weights[:, columns].any() and not self._has_own(drive, clip):
                yield why

    def _has_own(self, drive: AnyDrive, clip: Clip) -> bool:
        """True if a clip moves targets that belong to it alone, as in the file of its bake."""
        channel = clip.channel(self.rig.node, "weights")
        columns = [number for number, name in enumerate(self.rig.morph_names) if name in drive.own]
        return channel is not None and bool(channel.points[:, columns].any())

    def key_times(self, clip: Clip, *, fps: float, tolerance: float) -> Floats:
        """(keys,) seconds between which straight lines are right to a ratio of the greatest weight."""
        weights = self.weights_in(clip)
        times, keys = play_keys(
            play_grid(self.drives, self.rig, clip, fps=fps),
            lambda _stretch: weights,
            width=len(self.stored),
            tolerance=_SAMPLING_SHARE * tolerance,
            thinning=_KEYS_SHARE * tolerance,
        )
        return times[keys]
