"""Meshes that clips move, measured: the nodes that have one, the poses to look at, and where these compress each."""

import math
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import field, replace

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.character.contacts import Neighbours
from wrinklecli.character.mesh_names import MeshNames
from wrinklecli.character.rig import Rig, moving_nodes, read_hierarchy, read_rig
from wrinklecli.character.scene import deforming_nodes, deforms
from wrinklecli.character.surface import read_surface
from wrinklecli.drive.drive import is_baked
from wrinklecli.errors import AssetError, BakeError, listed, nearest
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.document import Document
from wrinklecli.numeric.arrays import Floats
from wrinklecli.numeric.guard import Progress
from wrinklecli.review.suggest.suggest_options import SuggestOptions
from wrinklecli.surface.ground import Ground
from wrinklecli.surface.rest import Rest, rest_pose
from wrinklecli.surface.sites import Peaks, Sites, find_peaks, spread_sites
from wrinklecli.surface.strain import Gauge, read_gauge
from wrinklecli.tools.records import ToolsFile

# Most poses of a clip: a compression that matters lasts longer than a 200th of its clip.
MOST_POSES = 200
# Triangles times poses of all clips and meshes, measured in two to three seconds. For more, poses are further apart ...
_MOST_WORK = 3_000_000
# ... but each clip has at least this number of poses: 76 clips of 30,000 triangles take 4 s, and 7 s with 9 poses. One
# that goes from one key to another has no more: it folds most at one of its ends, or hardly less.
FEWEST_POSES = 5
# Least number of poses of a clip in which a tool's shortening is measured, which takes next to nothing.
_FEWEST_LENGTHS = 25
# Bytes of a triangle with its vertices, and of its measurement in a pose.
_TRIANGLE_BYTES = 1000
# Triangles times poses beyond which an asset is refused, as measuring it would take minutes.
_TOO_MUCH_WORK = 200_000_000


@dataclass(frozen=True, slots=True)
class MeasuredMesh:
    """A deforming mesh and the clips that move it.

    Attributes:
        ground: The mesh at rest.
        sites: Points spread over it.
        clips: Those that move it.
        times: (frames,) seconds of each clip at which tools are measured.
        node: The name of its node as a tool must give it; None if a tool need not.
        known_rows: The `node_rows` of nodes posed so far, by a clip's name and its number of poses.
    """

    ground: Ground
    sites: Sites
    clips: tuple[Clip, ...]
    times: tuple[Floats, ...]
    node: str | None = None
    known_rows: dict[tuple[str, int], dict[int, Floats]] = field(default_factory=dict, compare=False, repr=False)

    @property
    def gauge(self) -> Gauge:
        """Measures the strain of the mesh."""
        return self.sites.gauge

    @property
    def rig(self) -> Rig:
        """The rig that moves the mesh."""
        return self.gauge.rig

    @property
    def flat(self) -> bool:
        """True for a mesh without normals, which is shaded flat."""
        primitives = self.ground.document.items("meshes")[self.rig.mesh]["primitives"]
        return not any("NORMAL" in primitive["attributes"] for primitive in primitives)

    @property
    def rest(self) -> Rest:
        """The stored pose."""
        return self.gauge.rest


def ground_of(document: Document, gauge: Gauge, neighbours: Neighbours | None = None) -> Ground:
    """The mesh of a gauge at rest, among the neighbours in its document."""
    return Ground(document, gauge.rig, gauge.surface, gauge.rest, (), neighbours or Neighbours(document))


def find_mesh_nodes(document: Document, options: SuggestOptions) -> tuple[dict[int, str | None], list[str]]:
    """Find the nodes of the scene whose meshes deform, or the one asked for.

    Returns:
        By the node's index, its name as a tool must give it, None if a tool need not; and a line about nodes that the
        scene does not draw.

    Raises:
        AssetError: There is no such node, or a node carries wrinkles of an earlier bake.
    """
    asked, nodes, names = options.node, document.items("nodes"), MeshNames.of(document)
    deforming = [index for index in names.own if deforms(document, index)]
    known = {index: names.name_of(index) for index in deforming}
    shown = deforming_nodes(document)
    if asked is not None:
        shown = [index for index in names.called(asked) if index in known]
        if len(shown) != 1:
            fault = f"{asked!r} is no node with a mesh that deforms{nearest(asked, known.values())}"
            if shown:
                fault = f"{len(shown)} nodes with a mesh that deforms are meant by {asked!r}"
            there = listed(known[index] for index in shown or deforming)
            raise AssetError(f"{fault}; there are {there}", where=document.path)
    for index in shown:
        if is_baked(nodes[index]):
            raise AssetError(
                "already carries wrinkles of an earlier bake; ask for suggestions on the original asset",
                where=document.where("nodes", index, "extras", "wrinkle"),
            )
    aside = [known[index] for index in deforming if index not in shown] if asked is None else []
    notes = [
        f"{listed(aside)}: left out, as the scene does not draw it: it is in another scene or in none, hidden, or a"
        " level of detail; --node asks for it"
    ]
    return {index: known[index] if len(deforming) > 1 else None for index in shown}, notes if aside else []


def measure_meshes(
    document: Document,
    nodes: Mapping[int, str | None],
    clips: tuple[Clip, ...],
    options: SuggestOptions,
    progress: Progress,
) -> list[tuple[MeasuredMesh, Peaks]]:
    """Measure those meshes of the nodes of `find_mesh_nodes` that clips move.

    Returns:
        Each mesh, with the greatest compression of its sites over the clips.

    Raises:
        BakeError: The work would take minutes.
        TooMuchError: The work would take too much memory.
    """
    hierarchy, neighbours = read_hierarchy(document), Neighbours(document)
    # Instances that all clips pose alike are measured once.
    distinct: dict[Hashable, tuple[Gauge, tuple[Clip, ...]]] = {}
    moved: list[tuple[Hashable, Rig, str | None]] = []
    for node, name in nodes.items():
        rig = read_rig(document, node, hierarchy)
        its_clips = clips_that_move(rig, clips)
        if its_clips:
            key = _motion_of(rig, its_clips)
            if key not in distinct:
                surface = read_surface(document, rig)
                what = f"{len(surface.triangles):,} triangles to measure"
                document.memory.claim(_TRIANGLE_BYTES * len(surface.triangles), what, where=document.path)
                rest = rest_pose(surface, rig, ToolsFile(path=document.path), its_clips, [])
                distinct[key] = read_gauge(surface, rest, rig), its_clips
            moved.append((key, rig, name))
    distinct = {key: (gauge, its_clips) for key, (gauge, its_clips) in distinct.items() if len(gauge.triangles)}
    counts = _pose_counts(list(distinct.values()), clips, options.fps, where=document.path)
    total = sum(counts[clip.index] for _, its_clips in distinct.values() for clip in its_clips)
    measured: dict[Hashable, tuple[Sites, tuple[Floats, ...], Peaks]] = {}
    before = 0
    for key, (gauge, its_clips) in distinct.items():

        def report(done: int, before: int = before) -> None:
            progress("posing", before + done, total)

        sites = spread_sites(gauge)
        times = tuple(np.linspace(clip.start, clip.end, counts[clip.index]) for clip in its_clips)
        peaks = find_peaks(sites, its_clips, times, report, jobs=options.jobs)
        finer = tuple(_finer(clip, at, options.fps) for clip, at in zip(its_clips, times, strict=True))
        measured[key] = sites, finer, peaks
        before += sum(map(len, times))
    meshes: list[tuple[MeasuredMesh, Peaks]] = []
    for key, rig, name in (each for each in moved if each[0] in measured):
        (gauge, its_clips), (sites, times, peaks) = distinct[key], measured[key]
        own = replace(gauge, rig=rig)
        ground = ground_of(document, own, neighbours)
        meshes.append((MeasuredMesh(ground, replace(sites, gauge=own), its_clips, times, name), peaks))
    return meshes


def _finer(clip: Clip, times: Floats, fps: float) -> Floats:
    """(frames,) seconds at which tools are measured: those of a clip's poses, with others between few of them."""
    wanted = min(_FEWEST_LENGTHS, (clip.end - clip.start) * fps + 1.0)
    parts = math.ceil((wanted - 1.0) / max(len(times) - 1, 1))
    return times if parts <= 1 or len(times) < 2 else np.linspace(times[0], times[-1], parts * (len(times) - 1) + 1)


def _motion_of(rig: Rig, clips: tuple[Clip, ...]) -> Hashable:
    """A key that two nodes share if they show one mesh, and clips pose it alike: the same joints move both."""
    alone = not rig.skinned or any(clip.channel(rig.node, "weights") for clip in clips)
    shown = rig.joints.tobytes(), rig.inverse_binds.tobytes(), rig.morph_weights.tobytes()
    return rig.mesh, rig.node if alone else -1, *shown, *(clip.index for clip in clips)


def clips_that_move(rig: Rig, clips: Sequence[Clip]) -> tuple[Clip, ...]:
    """The clips that move a rig's mesh."""
    moving = moving_nodes(rig)
    return tuple(clip for clip in clips if not clip.nodes.isdisjoint(moving))


def _pose_counts(
    meshes: Sequence[tuple[Gauge, tuple[Clip, ...]]], clips: Sequence[Clip], fps: float, *, where: str
) -> dict[int, int]:
    """The number of poses to look at, by the clip's index; fewer for large meshes and clips."""
    wanted = {
        clip.index: min(
            FEWEST_POSES if max(len(channel.times) for channel in clip.channels) <= 2 else MOST_POSES,
            (clip.end - clip.start) * fps + 1.0,
        )
        for clip in clips
    }
    parts = [(clip.index, gauge, gauge.strained.of(clip)) for gauge, its_clips in meshes for clip in its_clips]
    strained = [(number, len(gauge.triangles if part is None else part.triangles)) for number, gauge, part in parts]

    def work(counts: Mapping[int, float]) -> float:
        """Triangles times poses."""
        return sum(count * counts[index] for index, count in strained)

    thinner = min(1.0, _MOST_WORK / max(work(wanted), 1.0))
    counts = {index: max(min(FEWEST_POSES, round(n)), math.floor(thinner * n), 1) for index, n in wanted.items()}
    if work(counts) > _TOO_MUCH_WORK:
        raise BakeError(
            f"has {work(counts):.3g} triangles times poses to measure; at once {_TOO_MUCH_WORK:,} may be:"
            " use --clip or --node",
            where=where,
        )
    return counts
