"""Meshes that clips move, measured: which nodes have one, at which times to look, and where each is compressed most."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.character.pose import LEAST_SCALE
from wrinklecli.character.rig import Rig, moving_nodes, read_hierarchy, read_rig
from wrinklecli.character.scene import deforms, scene_nodes
from wrinklecli.character.surface import Surface, read_surface
from wrinklecli.errors import AssetError, BakeError, listed, nearest
from wrinklecli.gltf.document import Document
from wrinklecli.numeric.arrays import Floats
from wrinklecli.numeric.guard import Progress
from wrinklecli.surface.rest import Rest, rest_pose
from wrinklecli.surface.sites import Peaks, Sites, find_peaks, spread_sites
from wrinklecli.surface.strain import Gauge, posed, read_gauge
from wrinklecli.tools.records import ToolsFile

# Most poses of a clip: a compression that matters lasts longer than a 200th of its clip.
_MOST_POSES = 200
# Triangles times poses, of all clips and meshes; these take about five seconds. Beyond it, poses lie further apart ...
_MOST_WORK = 6_000_000
# ... but each clip has at least so many.
_FEWEST_POSES = 9
# Poses of a clip that goes from one key to another: it folds most at one of its ends, or hardly less.
_POSES_OF_TWO_KEYS = 4
# Of a triangle with its vertices, and of what is measured of it in a pose.
_TRIANGLE_BYTES = 1000
# Triangles times poses beyond which an asset is refused: more would take minutes.
_TOO_MUCH_WORK = 200_000_000


@dataclass(frozen=True, slots=True)
class MeasuredMesh:
    """A deforming mesh, measured over the clips that move it.

    Attributes:
        rig: What moves it.
        surface: The mesh, welded.
        rest: Its stored pose.
        gauge: What measures it.
        sites: Points spread over it.
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
    """A node whose mesh deforms.

    Attributes:
        index: Of the node.
        name: As a tool must give it; None where it may be left out.
    """

    index: int
    name: str | None


@dataclass(frozen=True, slots=True)
class _MovedMesh:
    """A mesh and the clips that move it."""

    node: MeshNode
    gauge: Gauge
    clips: tuple[Clip, ...]


def find_mesh_nodes(document: Document, asked: str | None) -> tuple[list[MeshNode], list[str]]:
    """The nodes of the scene whose meshes deform, or the one asked for.

    Returns:
        The nodes, and what was left out, a line each.

    Raises:
        AssetError: There is no such node, or a node carries wrinkles of an earlier bake.
    """
    nodes = document.items("nodes")
    deforming = [index for index in range(len(nodes)) if deforms(document, index)]
    names = [nodes[index].get("name") for index in deforming]
    if asked is not None and names.count(asked) != 1:
        known = [str(name) for name in names]
        fault = f"{asked!r} is no node with a mesh that deforms{nearest(asked, known)}; there are {listed(known)}"
        if asked in names:
            fault = f"{names.count(asked)} nodes with a mesh that deforms are named {asked!r}"
        raise AssetError(fault, where=document.path)
    shown = set(scene_nodes(document))
    found, notes = [], []
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
    return found, notes


def measure_meshes(
    document: Document, nodes: Sequence[MeshNode], clips: tuple[Clip, ...], fps: float, progress: Progress
) -> list[MeasuredMesh]:
    """Measure the meshes that clips move.

    Raises:
        BakeError: It would take minutes.
        TooMuchError: It would take too much memory.
    """
    moved = [mesh for mesh in _moved_meshes(document, nodes, clips) if len(mesh.gauge.triangles)]
    counts = _pose_counts(moved, clips, fps, where=document.path)
    total = sum(counts[clip.index] for each in moved for clip in each.clips)
    meshes: list[MeasuredMesh] = []
    for each in moved:
        before = sum(len(mesh.peaks.times) for mesh in meshes)

        def report(done: int, before: int = before) -> None:
            progress("posing", before + done, total)

        meshes.append(_measure(document, each, counts, report))
    return meshes


def _moved_meshes(document: Document, nodes: Sequence[MeshNode], clips: tuple[Clip, ...]) -> Iterator[_MovedMesh]:
    """The meshes that clips move, with what measures them."""
    hierarchy = read_hierarchy(document)
    for node in nodes:
        rig = read_rig(document, node.index, hierarchy)
        moving = moving_nodes(rig)
        its_clips = tuple(clip for clip in clips if any(channel.node in moving for channel in clip.channels))
        if its_clips:
            surface = read_surface(document, rig)
            what = f"{len(surface.triangles):,} triangles to measure"
            document.memory.claim(_TRIANGLE_BYTES * len(surface.triangles), what, where=document.path)
            rest = rest_pose(surface, rig, ToolsFile(path=document.path, tools=()), its_clips, [])
            yield _MovedMesh(node, read_gauge(surface, rest, rig), its_clips)


def _pose_counts(moved: Sequence[_MovedMesh], clips: Sequence[Clip], fps: float, *, where: str) -> dict[int, int]:
    """How many poses of each clip are looked at, by its index: fewer where meshes and clips are large."""
    wanted = {
        clip.index: min(
            _POSES_OF_TWO_KEYS if max(len(channel.times) for channel in clip.channels) <= 2 else _MOST_POSES,
            (clip.end - clip.start) * fps + 1.0,
        )
        for clip in clips
    }

    strained = [(clip.index, _strained_count(each, clip)) for each in moved for clip in each.clips]

    def work(counts: Mapping[int, float]) -> float:
        """Triangles times poses."""
        return sum(count * counts[index] for index, count in strained)

    thinner = min(1.0, _MOST_WORK / max(work(wanted), 1.0))
    counts = {index: max(min(_FEWEST_POSES, round(n)), math.floor(thinner * n), 1) for index, n in wanted.items()}
    if work(counts) > _TOO_MUCH_WORK:
        raise BakeError(
            f"has {work(counts):.3g} triangles times poses to measure; at once {_TOO_MUCH_WORK:,} may be:"
            " use --clip or --node",
            where=where,
        )
    return counts


def _strained_count(mesh: _MovedMesh, clip: Clip) -> int:
    """How many triangles of a mesh have to be looked at in a clip."""
    part = mesh.gauge.strained.of(clip)
    return len(mesh.gauge.triangles if part is None else part.triangles)


def _measure(
    document: Document, moved: _MovedMesh, counts: Mapping[int, int], progress: Callable[[int], None]
) -> MeasuredMesh:
    """Measure a mesh over its clips, so many poses of each."""
    gauge, clips = moved.gauge, moved.clips
    sites = spread_sites(gauge)
    times = tuple(np.linspace(clip.start, clip.end, counts[clip.index]) for clip in clips)
    peaks = find_peaks(sites, clips, times, progress)
    primitives = document.items("meshes")[gauge.rig.mesh]["primitives"]
    flat = not any("NORMAL" in primitive["attributes"] for primitive in primitives)
    return MeasuredMesh(gauge.rig, gauge.surface, gauge.rest, gauge, sites, clips, times, peaks, moved.node.name, flat)


def pose_unscaled(mesh: MeasuredMesh, clip: Clip | None, time: float, weights: Floats | None = None) -> Floats:
    """(vertices, 3) a pose with animated scale taken out; (1, morph targets) weights replace the clip's."""
    positions, scales = posed(mesh.gauge, clip, np.array([time]), weights)
    pose: Floats = positions[0] / np.where(scales[0] > LEAST_SCALE, scales[0], 1.0)[:, None]
    return pose
