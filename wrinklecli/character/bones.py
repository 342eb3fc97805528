"""Finds the part of the body that each joint is: a VRM says so, else names and the joints above and below tell.

Names alone do not suffice: `LeftLeg` is the lower leg of Mixamo and the upper leg of many others, `lShoulder` the
collar bone or the upper arm. So a leg is the upper one unless there is one above it, and so on.

Sources of the names, of which tests have some each:
    - Mixamo, and HumanIK of Maya and MotionBuilder: `LeftUpLeg`, `LeftLeg`, `LeftArm`, `LeftForeArm`.
    - Rigify's human metarig (Blender Manual): `upper_arm.L`, `f_index.01.L`, `spine.003`; deforming bones `DEF-`.
    - 3ds Max Biped, and with it Source's `ValveBiped.Bip01_L_UpperArm`; CAT: `CATRigLArm1`, `CATRigLArmPalm`.
    - Unreal's mannequins: `upperarm_l`, `upperarm_twist_01_l`, `calf_l`, `ball_l`.
    - Daz Genesis 3 to 9: `lShldrBend`, `lForearmTwist`, `abdomenUpper`; Character Creator: `CC_Base_L_CalfTwist01`.
    - VRoid Studio: `J_Bip_C_UpperChest`; VRM 0.x and VRMC_vrm-1.0, humanoid: `leftUpperLeg`, by node.
    - MikuMikuDance's standard and semi-standard bones: 上半身2, 左腕捩, 左ひじ, 左足首.
    - MakeHuman: `lowerleg02.L`, `spine05`, the lowest; Second Life: `mCollarLeft`, `mShoulderLeft`, `mHipLeft`.
"""

import math
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from typing import Literal

import numpy as np

from wrinklecli.character.pose import node_matrices, stored_positions
from wrinklecli.character.rig import Hierarchy, Rig, from_roots, read_parents
from wrinklecli.character.scene import ScenePrimitive
from wrinklecli.choices import Part
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.document import Document
from wrinklecli.numeric.arrays import Floats, Ints, unit

_Said = Part | Literal["arm", "leg"]
# Parts and patterns of words in lower case with spaces between them, or in Japanese; the first match counts. An `arm`
# or a `leg` is the upper or the lower one, depending on the parts above it.
_NAMES: tuple[tuple[_Said, str], ...] = (
    ("twist", r"(arm|leg|thigh|calf|shin|shldr|shoulder|hand|wrist|elbow|knee|foot|ankle)\w* (twist|roll|share)|捩"),
    ("jaw", r"\bjaw|mandible|顎|あご"),
    ("eye", r"\beyes?\b(?! ?(brow|lid|lash|socket))|目(?!頭|尻)"),
    ("toes", r"\btoes?\b|\bball\b|metatarsal|つま先|足先|足指"),
    ("palm", r"carpal|\bpalm"),
    ("finger", r"thumb|\bindex|\bmiddle|\bring|pinky|\blittle|finger|\bdigit|指"),
    ("lower arm", r"fore ?arm|elbow|low(er)? ?arm|\blo ?arm|ひじ|肘"),
    ("lower leg", r"knee|\bcal(f|ves)|shin\b|low(er)? ?leg|\blo ?leg|ひざ|膝"),
    ("upper leg", r"thigh|up(per)? ?leg|femur|太もも|足(?!首| ?(ik|ｉｋ))"),
    ("shoulder", r"clavicle|collar|shoulder|scapula|肩"),
    ("upper arm", r"up(per)? ?arm|humerus|shldr|腕"),
    ("foot", r"foot|ankle|足首"),
    ("hand", r"\bhand|wrist|手首|手"),
    ("neck", r"neck(?!lace)|首"),
    ("head", r"\bhead|skull|頭"),
    ("chest", r"chest|thorax|\bribs?\b|rib ?cage|上半身[2-9２-９]"),
    ("spine", r"spine|upper ?body|torso|abdomen|waist|belly|上半身|腰"),
    ("hips", r"\bhips?\b|pelvis|\broot\b|\bbody\b|\bhub\b|下半身|センター|グルーブ"),
    ("arm", r"\barm\b"),
    ("leg", r"\bleg\b"),
    ("finger", r"\bmid\b"),
)
_SIDED = re.compile(r"\b(l|r|left|right)\b|[左右]")
# A joint below one of these with the same name is a piece of the same bone, which only twists.
_LIMBS: tuple[Part, ...] = ("upper arm", "lower arm", "upper leg", "lower leg")
_END_OF: dict[Literal["arm", "leg"], tuple[Part, Part, Part]] = {
    "arm": ("upper arm", "lower arm", "hand"),
    "leg": ("upper leg", "lower leg", "foot"),
}
# Joints of a spine below the chest, if names do not tell.
_LOWER_SPINE = 2
# Least chains of joints that leave a hand for these to be fingers, whatever they are called.
_FINGERS = 4
# Part of the length of a newborn that its head is: nobody's is larger.
_HEAD = 0.25
# What joints are called with which arms begin.
_ARMS = frozenset[_Said](("shoulder", "upper arm", "arm"))


@dataclass(frozen=True, slots=True)
class Bones:
    """The parts of a body among a document's nodes.

    Attributes:
        parts: (nodes,) the part that each node moves; None if unknown.
        ahead: (3,) unit direction in which characters of this file format look.
    """

    parts: tuple[Part | None, ...]
    ahead: Floats


def read_bones(document: Document) -> Bones:
    """Find the parts of a body among a document's nodes; AssetError if the hierarchy has a cycle."""
    named = [str(node.get("name", "")) for node in document.items("nodes")]
    for node, name in _of_vrm(document):
        if node < len(named):
            named[node] = name
    # A VRM of version 0 looks along -z.
    old = "VRM" in _extensions(document)
    return Bones(_resolved(named, read_parents(document)), np.array([0.0, 0.0, -1.0 if old else 1.0]))


def forwards_of(rig: Hierarchy, bones: Bones) -> Floats:
    """(3,) unit, the direction in which a character looks: along its feet, or as its file format says."""
    toes = [k for k, part in enumerate(bones.parts) if part == "toes" and rig.parents[k] >= 0]
    if toes:
        places = node_matrices(rig, None, np.zeros(1), [*toes, *(int(rig.parents[k]) for k in toes)])[0, :, :3, 3]
        along = (places[: len(toes)] - places[len(toes) :]).sum(axis=0) * [1.0, 0.0, 1.0]
        if along.any():
            return unit(along)
    return bones.ahead


def grown(document: Document, rig: Rig, scene: Iterable[ScenePrimitive]) -> float:
    """Compare the proportions of a character with those of people: its height over that of one with such a head.

    Up is from the root of its skeleton to its head, as some characters sit or lie in the stored pose.

    Args:
        document: The asset.
        rig: Of a mesh of the character.
        scene: All that the asset shows. What the joints of the same skeleton carry is the character.

    Returns:
        In the stored pose, with hair and hats: 1 for people of any age, about a half for toys; NaN without a joint of a
        head.
    """
    joints, parts = {each for skin in document.items("skins") for each in skin["joints"]}, read_bones(document).parts

    def top(node: int) -> int:
        return next((each for each in [*rig.upwards(node)][::-1] if each in joints), -1)

    own = {*map(top, rig.joints.tolist())}
    heads = [each for each in sorted(joints) if parts[each] == "head" and top(each) in own]
    carried = (each for each in scene if top(int(each.rig.joints[0]) if each.rig.skinned else each.rig.node) in own)
    shown = [each.posed(None, np.zeros(1)).corners().reshape(-1, 3) for each in carried]
    corners = np.concatenate([np.zeros((0, 3)), *shown])
    if not heads or not len(corners):
        return math.nan
    places = stored_positions(rig, [top(heads[0]), *heads])
    up = unit(places[1:].mean(axis=0) - places[0])
    low, high, neck = (corners @ up).min(), (corners @ up).max(), (places[1:] @ up).min()
    return float((high - low) / max(high - low, (high - neck) / _HEAD)) if low < high else math.nan


def words_of(name: str) -> str:
    """Split a name into words in lower case: `mixamorig:LeftForeArm` gives `mixamorig left fore arm`.

    Letters other than Latin ones stay together, with digits after them.
    """
    return " ".join(re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|[^\x00-\x7f]+[0-9]*", name)).lower()


def _resolved(names: Sequence[str], parents: Ints) -> tuple[Part | None, ...]:
    """Find the parts of nodes from their names and those of their ancestors and descendants."""
    words = [words_of(name) for name in names]
    said = [next((part for part, pattern in _NAMES if re.search(pattern, each)), None) for each in words]
    # The parts that the names of each node's descendants say.
    below: list[set[_Said]] = [set() for _ in names]
    order = from_roots(parents)
    for node in reversed(order):
        if parents[node] >= 0:
            below[parents[node]] |= below[node] | {each for each in (said[node],) if each is not None}
    # Rigify's spine goes on beyond the joint from which the arms branch off: as neck, and the last one as head.
    trunk = {int(parents[node]) for node in order if said[node] == "spine" and below[node] & _ARMS}
    for node in order:
        branch = int(parents[node])
        if said[node] != "spine" or branch < 0 or branch in trunk:
            continue
        leaves_arms = said[branch] == "spine" and below[branch] & _ARMS and not below[branch] & {"neck", "head"}
        if said[branch] == "neck" or leaves_arms:
            said[node] = "neck" if "spine" in below[node] else "head"
    # A hand may also hold a weapon, which is no chain.
    chained = {*parents.tolist()} - {-1}
    chains = Counter(int(parents[node]) for node in chained)
    parts: list[Part | None] = [None] * len(names)
    above: list[tuple[Part, ...]] = [()] * len(names)
    for node in order:
        parent = int(parents[node])
        chain = above[parent] if parent >= 0 else ()
        part = _part(said[node], chain, below[node], sided=bool(_SIDED.search(words[node])))
        of_hand = parent >= 0 and parts[parent] == "hand" and node in chained and chains[parent] >= _FINGERS
        if part is None and (of_hand or (chain and chain[-1] == "finger")):
            part = "finger"
        parts[node] = part
        above[node] = chain if part is None else (*chain, part)
    return tuple(parts)


def _part(said: _Said | None, above: tuple[Part, ...], below: set[_Said], *, sided: bool) -> Part | None:
    """Find the part of a node from the part that its name says, the parts above, and those said of nodes below."""
    if said == "arm" or said == "leg":
        upper, lower, end = _END_OF[said]
        return end if lower in above else lower if upper in above else upper
    if said == "palm" and "hand" not in above:
        return "hand"
    if said == "spine" and above.count("spine") >= _LOWER_SPINE:
        return "chest"
    if said in _LIMBS and said in above:
        return "twist"
    limb: Literal["arm", "leg"] = "arm" if said == "shoulder" else "leg"
    upper, lower, _ = _END_OF[limb]
    # A joint before an elbow or knee is the upper bone of the limb if there is no other.
    alone = sided and lower in below and not {upper, limb, said} & below
    return upper if said in ("shoulder", "hips") and alone else said


def _of_vrm(document: Document) -> Iterator[tuple[int, str]]:
    """Give nodes and the names of the bones that a VRM assigns to them."""
    for extension in ("VRM", "VRMC_vrm"):
        bones = _extensions(document).get(extension)
        for key in ("humanoid", "humanBones"):
            bones = bones.get(key) if isinstance(bones, dict) else None
        if not isinstance(bones, dict | list):
            continue
        # Version 1 maps names to bones, version 0 has a list.
        for name, bone in bones.items() if isinstance(bones, dict) else enumerate(bones):
            node = bone.get("node") if isinstance(bone, dict) else None
            if isinstance(node, int) and node >= 0:
                yield node, str(bone.get("bone", name))


def _extensions(document: Document) -> dict[str, object]:
    found = document.gltf.get("extensions")
    return found if isinstance(found, dict) else {}
