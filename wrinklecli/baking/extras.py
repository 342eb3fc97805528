"""Extras of a baked node: the drives of its effects as JSON, for players of clips that were never baked."""

from collections.abc import Collection, Sequence

from wrinklecli.character.anims import NamedNodes
from wrinklecli.character.rig import Rig
from wrinklecli.drive.drive import LAYOUT
from wrinklecli.effects.effect import Effect, MeshPlan, targets_of
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.edited_document import EditedDocument
from wrinklecli.gltf.shape import Json

# Raised only when the geometry that the same asset and tools give changes.
METHOD = 5
# The section that extras always have: readers know a baked node by it.
_TOOLS = "tools"


@dataclass(frozen=True, slots=True)
class JointNames:
    """The names by which players find the joints of drives.

    Attributes:
        given: Names of joints that have none in the asset.
        shared: Names with which players find other nodes, too, and which no path tells apart.
    """

    given: tuple[str, ...] = ()
    shared: tuple[str, ...] = ()


def encode_extras(
    edited: EditedDocument, plan: MeshPlan, effects: Sequence[Effect], *, draft: bool = False
) -> JointNames:
    """Write the drives into the node's extras, enough to play the effects in a clip that was never baked.

    `tools` and `folds` hold drives, as module `drive.drive` describes them. `undriven` names targets without a
    drive: those of vertices that are projected in each frame, and those of contact for one clip alone. `draft` says
    that the bake was not proven, and less refined. `parts` names the nodes with the other parts of a split mesh;
    targets of one name must have the same weight in all parts.

    Returns:
        The names of the drives' joints: those that have none get one.
    """
    rig = plan.rig
    node = edited.gltf["nodes"][rig.node]
    if not isinstance(node.setdefault("extras", {}), dict):
        return JointNames()
    node["extras"]["wrinkle"] = drives_json(edited.gltf, plan, effects, draft=draft)
    return _name_joints(edited, rig, _driving(effects))


def drives_json(gltf: Json, plan: MeshPlan, effects: Sequence[Effect], *, draft: bool = False) -> Json:
    """The drives of a node's effects, as players read them."""
    sections: dict[str, list[Json]] = {_TOOLS: []}
    undriven: list[str] = []
    rig, nodes = plan.rig, _driving(effects)
    named = NamedNodes.of_body(gltf, rig.node, skinned=rig.skinned)
    # Players find joints by these names, paths where a name is shared.
    names = tuple((named.called(node) if node in nodes else None) or name for node, name in enumerate(rig.names))
    for effect in effects:
        if effect.drive is None or not effect.drive.measures:
            undriven += [target.name for target in targets_of([effect])]
        else:
            sections.setdefault(effect.section, []).append(effect.drive.to_json(names, rig.morph_names))
    return {
        "layout": LAYOUT,
        "method": METHOD,
        **({"draft": True} if draft else {}),
        **sections,
        **({"undriven": undriven} if undriven else {}),
    }


def _driving(effects: Sequence[Effect]) -> set[int]:
    """The nodes whose motion drives effects."""
    return {node for each in effects if each.drive is not None for node in each.drive.nodes}


def _name_joints(edited: EditedDocument, rig: Rig, joints: Collection[int]) -> JointNames:
    """Give names to the joints of drives, and to the mesh's node, that have none, as players look them up by name.

    Indices would do for this file alone: optimisers number nodes anew, and players keep names.
    """
    gltf = edited.gltf
    unnamed = [node for node in sorted(joints) if not gltf["nodes"][node].get("name")]
    for node in (*unnamed, rig.node):
        gltf["nodes"][node]["name"] = rig.names[node]
    named = NamedNodes.of_body(gltf, rig.node, skinned=rig.skinned)
    shared = [rig.names[node] for node in sorted(joints) if named.called(node) is None]
    return JointNames(tuple(rig.names[node] for node in unnamed), tuple(dict.fromkeys(shared)))
