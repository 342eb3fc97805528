"""Meshes that clips move, measured: which nodes have one, at which times to look, and where it is compressed most."""

import math
from dataclasses import dataclass

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.character.pose import LEAST_SCALE
from wrinklecli.character.rig import Rig, morph_target_names, moving_nodes, read_rig
from wrinklecli.character.scene import scene_nodes
from wrinklecli.character.surface import Surface, read_surface
from wrinklecli.errors import AssetError, BakeError, listed, nearest
from wrinklecli.gltf.document import Document
from wrinklecli.method.rest import Rest, rest_pose
from wrinklecli.numeric.arrays import Floats
from wrinklecli.numeric.guard import Progress
from wrinklecli.review.suggest.sites import Peaks, Sites, scan, spread_sites
from wrinklecli.review.suggest.strain import Gauge, posed, read_gauge
from wrinklecli.tools.records import ToolsFile

# Poses of a clip, at most: what compresses does so for longer than the 200th part of a clip.
_MOST_POSES = 200
# Triangles times poses of all clips and meshes: about five seconds. Beyond it, poses lie further apart ...
_MOST_WORK = 6_000_000
# ... but a clip has this many at least.
_FEWEST_POSES = 9
# Triangles times poses that are refused: minutes.
_TOO_MUCH_WORK = 200_000_000


@dataclass(frozen=True, slots=True)
class MeasuredMesh:
    """A deforming mesh, measured over the clips that move it.

    Attributes:
        rig: What moves it.
        surface: The mesh, welded.
        rest: Its stored pose.
        gauge: What measures it.
        sites: On it.
        clips: Those that move it.
        times: Of each clip, (frames,) seconds.
        peaks: The greatest compression of each site over the clips.
        node: The name of its node as a tool must give it; None where it may be left out.
        flat: Whether it has no normals, so that it is shaded flat.
    """

    rig: Rig
    surface: Surface
    rest: Rest
    gauge: Gauge
    sites: Sites
    clips: tuple[Clip, ...]
    times: tuple[Floats, ...]
    peaks: Peaks
    node: str | None
    flat: bool


@dataclass(frozen=True, slots=True)
class MeshNode:
    """A node whose mesh deforms; its name as a tools file must write it, if it must."""

    index: int
    node: str | None


def mesh_nodes(document: Document, asked: str | None, notes: list[str]) -> list[MeshNode]:
    """The nodes of the scene whose meshes deform, or the one asked for.

    Raises:
        AssetError: There is no such node, or a node carries wrinkles of an earlier bake.
    """
    nodes = document.items("nodes")
    deforming = []
    for index, carrier in enumerate(nodes):
        if "mesh" in carrier:
            mesh = document.item("meshes", carrier["mesh"], user=document.where("nodes", index))
            if "skin" in carrier or morph_target_names(mesh):
                deforming.append(index)
    names = [nodes[index].get("name") for index in deforming]
    if asked is not None and names.count(asked) != 1:
        known = [str(name) for name in names]
        fault = f"{asked!r} is no node with a mesh that deforms{nearest(asked, known)}; there are {listed(known)}"
        if asked in names:
            fault = f"{names.count(asked)} nodes with a mesh that deforms are named {asked!r}"
        raise AssetError(fault, where=document.path)
    shown = set(scene_nodes(document))
    found = []
    for index, name in zip(deforming, names, strict=True):
        if name != asked if asked is not None else index not in shown:
            continue
        extras = nodes[index].get("extras")
        if isinstance(extras, dict) and "wrinkle" in extras:
            raise AssetError(
                "already carries wrinkles of an earlier bake; ask for suggestions on the original asset",
                where=document.where("nodes", index, "extras", "wrinkle"),
            )
        if len(deforming) > 1 and (not isinstance(name, str) or not name or names.count(name) > 1):
            where = document.where("nodes", index)
            notes.append(f"{where}: left out, as it has no name of its own by which a tool could say where it is")
            continue
        found.append(MeshNode(index, name if len(deforming) > 1 else None))
    return found


def measure_meshes(
    document: Document, carriers: list[MeshNode], clips: tuple[Clip, ...], fps: float, progress: Progress
) -> list[MeasuredMesh]:
    """The meshes that clips move, measured.

    Raises:
        BakeError: It would take minutes.
    """
    parts = []
    for carrier in carriers:
        rig = read_rig(document, carrier.index)
        moving = moving_nodes(rig)
        its_clips = tuple(clip for clip in clips if any(channel.node in moving for channel in clip.channels))
        if its_clips:
            parts.append((carrier, rig, read_surface(document, rig), its_clips))
    wanted = {clip.index: min(_MOST_POSES, (clip.end - clip.start) * fps + 1.0) for clip in clips}
    work = sum(len(surface.triangles) * wanted[clip.index] for _, _, surface, its in parts for clip in its)
    thinner = min(1.0, _MOST_WORK / max(work, 1.0))
    counts = {index: max(min(_FEWEST_POSES, round(n)), math.floor(thinner * n), 1) for index, n in wanted.items()}
    work = sum(len(surface.triangles) * counts[clip.index] for _, _, surface, its in parts for clip in its)
    if work > _TOO_MUCH_WORK:
        raise BakeError(
            f"has {work:.3g} triangles times poses to measure; at once {_TOO_MUCH_WORK:,} may be: use --clip or --node",
            where=document.path,
        )
    total = sum(counts[clip.index] for _, _, _, its in parts for clip in its)
    meshes: list[MeasuredMesh] = []
    before = 0
    for carrier, rig, surface, its in parts:
        rest = rest_pose(surface, rig, ToolsFile(path=document.path, tools=()), clips, [])
        gauge = read_gauge(surface, rest, rig)
        if not len(gauge.triangles):
            continue
        sites = spread_sites(gauge)
        times = tuple(np.linspace(clip.start, clip.end, counts[clip.index]) for clip in its)

        def shown(done: int, before: int = before) -> None:
            progress("posing", before + done, total)

        peaks = scan(gauge, sites, its, times, shown)
        before += len(peaks.times)
        primitives = document.items("meshes")[rig.mesh]["primitives"]
        flat = not any("NORMAL" in primitive["attributes"] for primitive in primitives)
        meshes.append(MeasuredMesh(rig, surface, rest, gauge, sites, its, times, peaks, carrier.node, flat))
    return meshes


def pose_unscaled(mesh: MeasuredMesh, clip: Clip | None, time: float, weights: Floats | None = None) -> Floats:
    """(vertices, 3) a pose with animated scale taken out; (1, morph targets) weights replace the clip's."""
    positions, scales = posed(mesh.gauge, clip, np.array([time]), weights)
    pose: Floats = positions[0] / np.where(scales[0] > LEAST_SCALE, scales[0], 1.0)[:, None]
    return pose
