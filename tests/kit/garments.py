"""Garments with a field of wrinkles, as the stages before the encoding see them: a tube that bends, a plane."""

import json
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from kit.asset import ARRAY_BUFFER, Array, Asset, Json, attribute, stored
from kit.bakes import place
from kit.limb import limb_asset
from wrinklecli.baking.job import BakeOptions, Job, read_job
from wrinklecli.baking.plan import plan_meshes
from wrinklecli.effects.effect import MeshPlan
from wrinklecli.effects.field.attach import AttachedField, attach_fields
from wrinklecli.effects.field.compression import shortest
from wrinklecli.numeric.arrays import Floats
from wrinklecli.surface.ground import Ground, read_ground
from wrinklecli.surface.strain import tangents

FOLDS: Json = {"name": "folds"}


def tube(**options: Any) -> Asset:
    """A tube along x that bends by 90° towards +y about its middle, `joint_1`, and back: half of it is compressed."""
    return limb_asset(**{"rings": 21, "sides": 16, "angle": 90.0, **options})


def job_of(asset: Asset, *fields: Json, levels: int = 1, **top: Any) -> Job:
    """An asset read with fields, or with what `top` has; with one field where there is neither."""
    path = place(asset)
    listed = {"fields": list(fields)} if fields else {} if top.keys() & {"fields", "flesh"} else {"fields": [FOLDS]}
    file = path.with_suffix(".yaml")
    file.write_text(json.dumps({"version": 1, **listed, **top}))
    return read_job(path, file, BakeOptions(max_levels=levels))


def ground_of(job: Job, node: int = 0) -> Ground:
    """The mesh of a job at rest."""
    return read_ground(job.document, node, list(job.settings.effects), job.settings, job.every_clip)


def attached(asset: Asset, **keys: Any) -> tuple[Ground, AttachedField]:
    """A mesh at rest with one field."""
    job = job_of(asset, {"name": "folds", **keys})
    ground = ground_of(job)
    (found,) = attach_fields(list(job.settings.effects), ground)
    return ground, found


@cache
def bent_tube(**keys: Any) -> tuple[Ground, AttachedField]:
    """The tube with one field."""
    return attached(tube(), **keys)


def planned(asset: Asset, *fields: Json, levels: int = 1, **top: Any) -> MeshPlan:
    """The refined mesh with its effects."""
    (plan,) = plan_meshes(job_of(asset, *fields, levels=levels, **top))
    return plan


def tallest(field: AttachedField) -> Floats:
    """(coarse vertices,) the tallest half height of any shape."""
    return np.asarray(field.factors.shapes.max(axis=0))


def across(ground: Ground, field: AttachedField) -> Floats:
    """(coarse vertices, 3) unit directions across the crests, without signs."""
    return shortest(field.region.directions, tangents(ground.rest.normals))[1]


def plane(length: float, width: float, cells: int) -> tuple[Floats, Array]:
    """A sheet in the plane z = 0 with square cells, `cells` on each unit: positions and triangles."""
    columns, rows = round(length * cells) + 1, round(width * cells) + 1
    x, y = np.meshgrid(np.linspace(0.0, length, columns), np.linspace(0.0, width, rows), indexing="ij")
    positions = np.stack([x.ravel(), y.ravel(), 0.0 * x.ravel()], axis=1)
    a = (np.arange(columns - 1)[:, None] * rows + np.arange(rows - 1)).ravel()
    b, c, d = a + 1, a + rows, a + rows + 1
    return positions, np.concatenate([np.stack([a, c, b], axis=1), np.stack([b, c, d], axis=1)])


def thinner(asset: Asset, share: float) -> Asset:
    """The asset of a tube along x, as thick as a share of what it was."""
    places = attribute(asset, 0, "POSITION")
    return with_attribute(asset, "POSITION", places * np.array([1.0, share, share], places.dtype))


def with_attribute(asset: Asset, name: str, values: Array) -> Asset:
    """An asset whose only primitive has one attribute more."""
    (primitive,) = asset.gltf["meshes"][0]["primitives"]
    primitive["attributes"][name] = asset.accessor(values, target=ARRAY_BUFFER)
    return asset


def split_materials(asset: Asset, *colours: Json | None) -> Asset:
    """An asset whose primitives have materials of these base colours."""
    asset.gltf["materials"] = [{"pbrMetallicRoughness": {"baseColorFactor": [*each, 1.0]}} for each in colours]
    for number, primitive in enumerate(asset.gltf["meshes"][0]["primitives"]):
        primitive["material"] = number
    return asset


def cut_open(asset: Asset, least: float) -> Asset:
    """A tube without its triangles below a height y: its new border runs along it."""
    (primitive,) = asset.gltf["meshes"][0]["primitives"]
    faces = stored(asset, primitive["indices"]).reshape(-1, 3)
    kept = (attribute(asset, 0, "POSITION")[faces, 1] >= least).all(axis=1)
    primitive["indices"] = asset.accessor(faces[kept].ravel(), "u2")
    return asset


def renumbered(asset: Asset, seed: int = 0) -> tuple[Asset, Array]:
    """An asset whose vertices have other numbers: the new number of each old one."""
    (primitive,) = asset.gltf["meshes"][0]["primitives"]
    count = asset.gltf["accessors"][primitive["attributes"]["POSITION"]]["count"]
    order = np.random.default_rng(seed).permutation(count)
    for index in primitive["attributes"].values():
        values = stored(asset, index)
        values[order] = values.copy()
    faces = stored(asset, primitive["indices"])
    faces[:] = order[faces]
    return asset, order


def many_joints(count: int, *, rings: int = 60, sides: int = 8) -> Asset:
    """A tube along a chain of very many joints, each of which a clip turns by 20°."""
    asset = limb_asset(rings=rings, sides=sides, clip=None)
    joints = [
        asset.append("nodes", {"name": f"link_{k}", "translation": [-1.0 if k == 0 else 2.0 / count, 0.0, 0.0]})
        for k in range(count)
    ]
    for one, other in pairwise(joints):
        asset.gltf["nodes"][one]["children"] = [other]
    matrices = np.tile(np.eye(4), (count, 1, 1))
    matrices[:, 3, 0] = 1.0 - 2.0 * np.arange(count) / count
    asset.gltf["skins"][0] = {"joints": joints, "inverseBindMatrices": asset.accessor(matrices.reshape(count, 16))}
    asset.gltf["scenes"][0]["nodes"] = [0, joints[0]]
    at = (attribute(asset, 0, "POSITION")[:, 0].astype(float) + 1.0) / 2.0 * count - 0.5
    low = np.clip(np.floor(at), 0, count - 2)
    share = np.clip(at - low, 0.0, 1.0)
    (primitive,) = asset.gltf["meshes"][0]["primitives"]
    numbers, shares = np.stack([low, low + 1, 0 * low, 0 * low], 1), np.stack([1 - share, share, 0 * low, 0 * low], 1)
    primitive["attributes"]["JOINTS_0"] = asset.accessor(numbers, "u2", target=ARRAY_BUFFER)
    primitive["attributes"]["WEIGHTS_0"] = asset.accessor(shares, target=ARRAY_BUFFER)
    clip: Json = {"name": "coil"}
    half = np.radians(10.0)
    for joint in joints:
        turns = [[0.0, 0.0, 0.0, 1.0], [0.0, 0.0, np.sin(half), np.cos(half)], [0.0, 0.0, 0.0, 1.0]]
        asset.channel(clip, joint, "rotation", [0.0, 1.0, 2.0], turns)
    asset.append("animations", clip)
    return asset


def tools_file(asset: Path, *fields: Json, **top: Any) -> Path:
    """A tools file beside an asset."""
    file = asset.with_suffix(".yaml")
    file.write_text(json.dumps({"version": 1, "fields": list(fields), **top}))
    return file
