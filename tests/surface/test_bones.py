"""The bones of a mesh: lines between joints that carry skin."""

import numpy as np
import pytest

from kit.asset import Asset
from kit.garments import ground_of, job_of, tube
from wrinklecli.surface.bones import BoneLines, bone_distances


def with_a_node_between(asset: Asset) -> Asset:
    """The asset with a node that is no joint between each joint and the joint above it."""
    nodes = asset.gltf["nodes"]
    for joint in asset.gltf["skins"][0]["joints"]:
        nodes[joint]["children"] = [
            asset.append("nodes", {"name": f"between_{child}", "children": [child]})
            for child in nodes[joint].get("children", [])
        ] or [asset.append("nodes", {"name": "tip"})]
    return asset


@pytest.mark.parametrize("between", [False, True])
def test_bones_run_from_joint_to_joint_and_the_last_one_to_the_end_of_its_skin(between: bool) -> None:
    asset = tube(joints=4, clip=None)
    ground = ground_of(job_of(with_a_node_between(asset) if between else asset))
    bones = BoneLines.of(ground)
    assert [ground.rig.names[node] for node in bones.nodes] == [f"joint_{number}" for number in range(4)]
    assert np.allclose(bones.ends[:-1], bones.starts[1:])
    points = ground.rest.positions
    assert bones.ends[-1][0] == pytest.approx(points[:, 0].max(), abs=0.1 * np.ptp(points[:, 0]))
    assert np.allclose(bone_distances(bones.starts, np.stack([bones.starts, bones.ends], axis=1)), 0.0)
    assert [bones.nearest(place) for place in (bones.starts + bones.ends) / 2.0] == [0, 1, 2, 3]
