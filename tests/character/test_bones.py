"""Parts of bodies, by the names that rigs give joints and by what is above and below."""

import math

import pytest

from kit.asset import Asset
from kit.prepared import as_document
from wrinklecli.character.bones import grown, read_bones, words_of
from wrinklecli.character.rig import read_rig
from wrinklecli.character.scene import read_scene

# By rig, a chain of joints from the trunk to an end, and what they are.
CHAINS = {
    "Mixamo": (
        "mixamorig:Hips mixamorig:LeftUpLeg mixamorig:LeftLeg mixamorig:LeftFoot mixamorig:LeftToeBase",
        "hips, upper leg, lower leg, foot, toes",
    ),
    "three.js's Mixamo": (
        "mixamorigSpine mixamorigSpine1 mixamorigSpine2 mixamorigLeftShoulder mixamorigLeftArm mixamorigLeftForeArm"
        " mixamorigLeftHand mixamorigLeftHandRing1",
        "spine, spine, chest, shoulder, upper arm, lower arm, hand, finger",
    ),
    "HumanIK": (
        "Character1_LeftArm Character1_LeftArmRoll Character1_LeftForeArm",
        "upper arm, twist, lower arm",
    ),
    "Rigify": (
        "DEF-spine DEF-spine.001 DEF-spine.003 DEF-shoulder.L DEF-upper_arm.L DEF-upper_arm.L.001 DEF-forearm.L"
        " DEF-hand.L ORG-palm.01.L DEF-f_index.01.L",
        "spine, spine, chest, shoulder, upper arm, twist, lower arm, hand, palm, finger",
    ),
    "Biped": (
        "Bip01 Bip01_Pelvis Bip01_L_Thigh Bip01_L_Calf Bip01_L_Foot Bip01_L_Toe0",
        "-, hips, upper leg, lower leg, foot, toes",
    ),
    "Source": (
        "ValveBiped.Bip01_Spine2 ValveBiped.Bip01_Spine4 ValveBiped.Bip01_R_Clavicle ValveBiped.Bip01_R_UpperArm",
        "spine, spine, shoulder, upper arm",
    ),
    "CAT": (
        "CATRigHub001 CATRigSpine1 CATRigLArmCollarbone CATRigLArm1 CATRigLArm2 CATRigLArmPalm CATRigLArmDigit11",
        "hips, spine, shoulder, upper arm, lower arm, hand, finger",
    ),
    "Unreal": (
        "pelvis thigh_l thigh_twist_01_l calf_l calf_kneeBack_l foot_l ball_l",
        "hips, upper leg, twist, lower leg, twist, foot, toes",
    ),
    "Daz": (
        "hip abdomenLower abdomenUpper chestLower lCollar lShldrBend lShldrTwist lForearmBend lHand lMid1",
        "hips, spine, spine, chest, shoulder, upper arm, twist, lower arm, hand, finger",
    ),
    "Character Creator": (
        "CC_Base_Hip CC_Base_Waist CC_Base_Spine01 CC_Base_Spine02 CC_Base_NeckTwist01 CC_Base_Head CC_Base_JawRoot",
        "hips, spine, spine, chest, neck, head, jaw",
    ),
    "VRoid": (
        "J_Bip_C_Chest J_Bip_C_UpperChest J_Bip_L_Shoulder J_Bip_L_UpperArm J_Bip_L_LowerArm J_Bip_L_Thumb1",
        "chest, chest, shoulder, upper arm, lower arm, finger",
    ),
    "MikuMikuDance": (
        "センター 腰 上半身 上半身2 左肩 左腕 左腕捩 左ひじ 左手捩 左手首 左人指１",
        "hips, spine, spine, chest, shoulder, upper arm, twist, lower arm, twist, hand, finger",
    ),
    "MikuMikuDance's legs": (
        "下半身 右足 右ひざ 右足首 右つま先 右足ＩＫ",
        "hips, upper leg, lower leg, foot, toes, -",
    ),
    "VRChat": ("Left_leg Left_knee Left_ankle Left_toe", "upper leg, lower leg, foot, toes"),
    "MakeHuman": (
        "spine05 spine04 spine03 clavicle.L shoulder01.L upperarm01.L upperarm02.L lowerarm01.L wrist.L metacarpal1.L",
        "spine, spine, chest, shoulder, shoulder, upper arm, twist, lower arm, hand, palm",
    ),
    "Second Life": (
        "mTorso mCollarLeft mShoulderLeft mElbowLeft mWristLeft",
        "spine, shoulder, upper arm, lower arm, hand",
    ),
    "Second Life's legs": ("mPelvis mHipLeft mKneeLeft mAnkleLeft", "hips, upper leg, lower leg, foot"),
    "numbered": (
        "Skeleton_arm_joint_L__4_ Skeleton_arm_joint_L__3_ Skeleton_arm_joint_L__2_",
        "upper arm, lower arm, hand",
    ),
    "none": ("Armature joint_0 Bone.001 earring.L hindrance", "-, -, -, -, -"),
}


def chain(*names: str) -> Asset:
    """Nodes one below the other."""
    asset = Asset()
    for number, name in enumerate(names):
        asset.append("nodes", {"name": name, "children": [number + 1]} if number + 1 < len(names) else {"name": name})
    asset.append("scenes", {"nodes": [0]})
    return asset


@pytest.mark.parametrize("rig", CHAINS)
def test_joints_of_known_rigs_are_parts_of_a_body(rig: str) -> None:
    names, parts = CHAINS[rig]
    found = read_bones(as_document(chain(*names.split()))).parts
    assert ", ".join(part or "-" for part in found) == parts


def test_the_neck_and_the_head_of_rigify_go_on_from_the_spine() -> None:
    asset = chain("spine", "spine.001", "spine.002", "spine.003", "spine.004", "spine.005", "spine.006", "hair")
    for _ in range(2):
        arm = asset.append("nodes", {"name": "shoulder.L", "children": [len(asset.gltf["nodes"]) + 1]})
        asset.append("nodes", {"name": "upper_arm.L"})
        asset.gltf["nodes"][3]["children"].append(arm)
    # A tail is no neck: it leaves the spine below the arms.
    asset.gltf["nodes"][1]["children"].append(asset.append("nodes", {"name": "spine.007"}))
    parts = read_bones(as_document(asset)).parts
    assert parts[:8] == ("spine", "spine", "chest", "chest", "neck", "neck", "head", None)
    assert parts[-1] == "chest"


def test_chains_of_joints_that_leave_a_hand_are_fingers() -> None:
    asset = chain("Hand", "F1a", "F1b", "F1c")
    for name in ("F2", "F3", "T"):
        asset.gltf["nodes"][0]["children"].append(asset.append("nodes", {"name": f"{name}a", "children": []}))
        asset.gltf["nodes"][-1]["children"].append(asset.append("nodes", {"name": f"{name}b"}))
    asset.gltf["nodes"][0]["children"].append(asset.append("nodes", {"name": "Staff"}))
    assert read_bones(as_document(asset)).parts == ("hand", *["finger"] * 9, None)
    del asset.gltf["nodes"][0]["children"][1]
    # Three chains may be a claw, or strings.
    assert "finger" not in read_bones(as_document(asset)).parts


def test_a_vrm_says_outright_which_node_is_which_bone() -> None:
    asset = chain("a", "b", "c", "Head")
    asset.gltf["extensions"] = {
        "VRMC_vrm": {"humanoid": {"humanBones": {"leftUpperArm": {"node": 1}, "leftLowerArm": {"node": 2}}}}
    }
    found = read_bones(as_document(asset))
    assert found.parts == (None, "upper arm", "lower arm", "head")
    assert found.ahead.tolist() == [0.0, 0.0, 1.0]
    asset.gltf["extensions"] = {
        "VRM": {"humanoid": {"humanBones": [{"bone": "upperChest", "node": 0}, {"bone": "neck", "node": 99}]}}
    }
    found = read_bones(as_document(asset))
    assert found.parts == ("chest", None, None, "head")
    assert found.ahead.tolist() == [0.0, 0.0, -1.0]


@pytest.mark.parametrize(
    "said", [1, [], {}, [3], {"hips": 3}, {"hips": {"node": "a"}}, [{"bone": "hips", "node": -1}], None]
)
def test_a_vrm_that_says_nothing_sensible_is_read_by_names(said: object) -> None:
    asset = chain("pelvis", "b")
    asset.gltf["extensions"] = {"VRM": {"humanoid": {"humanBones": said}}}
    assert read_bones(as_document(asset)).parts == ("hips", None)


def figure(height: float, head: str = "Head") -> Asset:
    """A triangle over four units on hips, and one on a head, up to a height, beside a taller pole."""
    asset = Asset()
    for top, low in ((4.0, 0.0), (height, 4.0), (20.0, -20.0)):
        positions = asset.accessor([(0.0, low, 0.0), (1.0, low, 0.0), (0.0, top, 0.0)])
        asset.append("meshes", {"primitives": [{"attributes": {"POSITION": positions}}]})
    shown = asset.gltf["meshes"][0]["primitives"][0]["attributes"]
    shown["JOINTS_0"], shown["WEIGHTS_0"] = asset.accessor([[0] * 4] * 3, "u1"), asset.accessor([[1.0, 0, 0, 0]] * 3)
    asset.append("nodes", {"name": "Hips", "children": [1]})
    asset.append("nodes", {"name": head, "translation": [0.0, 4.0, 0.0], "children": [2]})
    # The hat is no part of the skin, but goes with the head.
    asset.append("nodes", {"name": "hat", "mesh": 1, "translation": [0.0, -4.0, 0.0]})
    asset.append("nodes", {"name": "body", "mesh": 0, "skin": 0})
    asset.append("nodes", {"name": "pole", "mesh": 2})
    asset.append("skins", {"joints": [0, 1]})
    asset.append("scenes", {"nodes": [0, 3, 4]})
    return asset


@pytest.mark.parametrize("lies", [False, True])
@pytest.mark.parametrize(("height", "expected"), [(4.5, 1.0), (16.0 / 3.0, 1.0), (6.0, 0.75), (8.0, 0.5)])
def test_a_head_of_more_than_a_quarter_of_the_height_is_a_toys(height: float, expected: float, lies: bool) -> None:
    asset = figure(height)
    if lies:
        turned = asset.append("nodes", {"rotation": [0.5**0.5, 0.0, 0.0, 0.5**0.5], "children": [0]})
        asset.gltf["scenes"][0]["nodes"][0] = turned
    document = as_document(asset)
    assert grown(document, read_rig(document, 3), read_scene(document)) == pytest.approx(expected)


def test_proportions_are_unknown_without_a_head_or_if_nothing_is_shown() -> None:
    for asset, shown in ((figure(8.0, "stick"), True), (figure(8.0), False)):
        document = as_document(asset)
        assert math.isnan(grown(document, read_rig(document, 3), read_scene(document) if shown else ()))


def test_words_of_names() -> None:
    assert words_of("CATRigLArmPalm") == "cat rig l arm palm"
    assert words_of("lShldrBend_01") == "l shldr bend"
    assert words_of("上半身2_L") == "上半身2 l"
