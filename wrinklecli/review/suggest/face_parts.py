"""The parts of a face, found by the targets that move them: eyes, brows, mouth, lids and lips.

Eyes are where a blink moves most, brows where they rise or fall most, a mouth where speech and smiles move most. So
places do not depend on coordinates, and a drawn face, or a head that is turned, has its parts where they are.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from wrinklecli.character.bones import read_bones
from wrinklecli.character.motion import motion_clip, raising
from wrinklecli.character.pose import node_matrices
from wrinklecli.character.rig import Rig
from wrinklecli.character.surface import read_surface
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.document import Document
from wrinklecli.numeric.arrays import Bools, Floats, unit
from wrinklecli.numeric.closest import nearest_of
from wrinklecli.review.suggest.choice import rims_of
from wrinklecli.review.suggest.face_targets import FaceTarget, Side
from wrinklecli.review.suggest.measure import MeasuredMesh, ground_of
from wrinklecli.surface.compression import extent, sites_with_twins
from wrinklecli.surface.rest import rest_pose
from wrinklecli.surface.sites import Sites, spread_sites
from wrinklecli.surface.strain import Gauge, part_of, read_gauge, unscaled_pose
from wrinklecli.surface.substance import read_makeup, substance_of
from wrinklecli.tools.records import ToolsFile

# Part of its greatest displacement by which a target moves the surface that is a part of the face.
_OF_PART = 0.3
# Space around the part of a mesh that a face's targets move, as a part of its size: skin that is compressed lies there.
_AROUND = 0.15
# Displacement over the greatest of all targets below which skin does not belong to the face, and a target moves none.
_STILL, _IDLE = 0.1, 0.01
# Width of lips and lids over the distance of the eyes: nearly a centimetre of a person.
_RIM_WIDTH = 0.13
# Half the width of an eye over the distance of the eyes, if no target moves a lid, ...
_USUAL_EYE = 0.25
# ... and that distance over the width of both brows, if nothing tells the eyes.
_EYES_OF_BROWS = 0.6
# Least distance of brows and mouth from the eyes in their height, in distances of the eyes.
_LEAST_HEIGHT = 0.1
# Height of a mouth in distances of the eyes, if no target moves it, and of the brows, likewise.
_USUAL_MOUTH, _USUAL_BROWS = -1.1, 0.35
# Greatest |x| of a face's middle over the distance of its eyes, and least |x| of its left, for a face on x = 0.
_ON_PLANE, _SIDEWAYS = 0.05, 0.995
# Motions by which a mouth is found, the best first.
_OF_MOUTH = (("mouthPucker",), ("mouthSmile", "mouthFrown"), ("jawOpen",))


@dataclass(frozen=True)
class Face:
    """The skin of a face, and its parts. Heights and sizes without a unit are in distances of the eyes.

    Attributes:
        mesh: The skin of the face alone, without clips.
        targets: Those that move it.
        moved: By the target's name, (sites, 3) displacement at weight 1, scene units.
        middle: (3,) between the eyes.
        left: (3,) unit vector to the left of the character.
        up: (3,) unit vector from the mouth to the eyes.
        ahead: (3,) unit vector in which the character looks.
        size: Distance of the eyes, scene units.
        brows: Height of the brows above the eyes.
        mouth: Height of the mouth above the eyes, which is below 0.
        eye: Half the width of the lids of an eye.
        symmetric: True if the face is its own mirror image across x = 0.
    """

    mesh: MeasuredMesh
    targets: tuple[FaceTarget, ...]
    moved: Mapping[str, Floats]
    middle: Floats
    left: Floats
    up: Floats
    ahead: Floats
    size: float
    brows: float
    mouth: float
    eye: float
    symmetric: bool

    def of(self, motions: Sequence[str], side: Side = "") -> list[FaceTarget]:
        """The targets of some motions, on a side or on both."""
        return targets_of(self.targets, motions, side)

    def heights(self, points: Floats) -> Floats:
        """(points,) -1 for (points, 3) at the mouth, 0 at the eyes, 1 at the brows."""
        above = (points - self.middle) @ self.up / self.size
        return np.where(above < 0, above / -self.mouth, above / self.brows)

    def asides(self, points: Floats) -> Floats:
        """(points,) 0 for (points, 3) in the middle, 1 at the left eye, 2 at its outer corner; on the right below 0."""
        aside = (points - self.middle) @ self.left / self.size
        beyond = np.maximum(np.abs(aside) - 0.5, 0.0)
        return np.asarray(np.sign(aside) * (np.minimum(2.0 * np.abs(aside), 1.0) + beyond / self.eye))

    @cached_property
    def rims(self) -> Floats:
        """(points, 3) of lids, lips and nostrils, world space."""
        points = rims_of(self.mesh)
        heights = self.heights(points)
        # Further back are ears, and where the skin of the face was cut out.
        of_face = (heights > -1.5) & (heights < 1.0) & ((points - self.middle) @ self.ahead > -self.size)
        return np.asarray(np.concatenate([points[of_face], self.mesh.sites.positions[self.lids]]))

    @cached_property
    def lids(self) -> Bools:
        """(sites,) True where a blink moves the skin."""
        lids = np.zeros(len(self.mesh.sites.positions), bool)
        for each in self.of(["eyeBlink"]):
            way = np.linalg.norm(self.moved[each.name], axis=1)
            lids |= way > _OF_PART * way.max()
        return lids

    @cached_property
    def free(self) -> Bools:
        """(sites,) True where neither lids nor lips are near."""
        sites = self.mesh.sites.positions
        near = nearest_of(self.rims, sites)[0] if len(self.rims) else np.full(len(sites), np.inf)
        return np.asarray(near > _RIM_WIDTH * self.size)


def read_face(document: Document, rig: Rig, targets: Sequence[FaceTarget], node: str | None) -> Face | None:
    """Find the parts of a face; None if no target moves skin. `node` is the name as a tool must give it."""
    whole = read_skin(document, rig)
    if whole is None:
        return None
    ways = np.max([np.linalg.norm(_displacements(whole, each), axis=1) for each in targets], axis=0)
    ways = ways[whole.triangles].max(axis=1)
    if not ways.any():
        return None
    gauge = cropped(whole, ways > _STILL * ways.max())
    sites = spread_sites(gauge)
    moved = {each.name: _displacements(gauge, each)[gauge.triangles].mean(axis=1) for each in targets}
    motion = _Motion(targets, {name: np.asarray(sites.gather @ way) for name, way in moved.items()}, sites).of_skin()
    ahead = motion.ahead(document)
    up = motion.up(ahead)
    eyes = _find_eyes(document, rig, motion, unit(np.cross(up, ahead)))
    brows = motion.part(["browInnerUp", "browOuterUp", "browDown"])
    mouth = next((found for motions in _OF_MOUTH if (found := motion.part(motions))), None)
    if eyes is None:
        if brows is None:
            return None
        eyes = _eyes_below(brows, sites, up, unit(np.cross(up, ahead)))
    size, left = float(np.linalg.norm(eyes.left - eyes.right)), unit(eyes.left - eyes.right)
    middle = (eyes.left + eyes.right) / 2.0
    if mouth is not None:
        up = middle - mouth.middle
    up = unit(up - (up @ left) * left)
    on_plane = abs(float(middle[0])) < _ON_PLANE * size and abs(float(left[0])) > _SIDEWAYS
    symmetric = on_plane and bool(sites_with_twins(sites).any())
    if symmetric:
        left, middle = np.array([np.sign(left[0]), 0.0, 0.0]), middle * [0.0, 1.0, 1.0]
        up = unit(up * [0.0, 1.0, 1.0])
    return Face(
        mesh=MeasuredMesh(ground_of(document, sites.gauge), sites, (), (), node),
        targets=tuple(motion.targets),
        moved=motion.moved,
        middle=middle,
        left=left,
        up=up,
        ahead=np.cross(left, up),
        size=size,
        brows=max(_LEAST_HEIGHT, _USUAL_BROWS if brows is None else float((brows.middle - middle) @ up) / size),
        mouth=min(-_LEAST_HEIGHT, _USUAL_MOUTH if mouth is None else float((mouth.middle - middle) @ up) / size),
        eye=eyes.half_width / size,
        symmetric=symmetric,
    )


@dataclass(frozen=True, slots=True)
class _Part:
    """A part of a face: (sites,) weights, and its (3,) middle."""

    weights: Floats
    middle: Floats


@dataclass(frozen=True, slots=True)
class _Eyes:
    """The (3,) middles of the left and the right eye, and half the width of their lids, scene units."""

    left: Floats
    right: Floats
    half_width: float


@dataclass(frozen=True, slots=True)
class _Motion:
    """The moves of targets: by name, (sites, 3) displacements at weight 1, scene units."""

    targets: Sequence[FaceTarget]
    moved: Mapping[str, Floats]
    sites: Sites

    def ways(self, name: str) -> Floats:
        """(sites,) lengths of a target's displacements."""
        return np.asarray(np.sqrt(np.sum(self.moved[name] ** 2, axis=1)))

    def of_skin(self) -> "_Motion":
        """The motion of those targets that move the skin, and not only eyes or teeth."""
        greatest = {each.name: float(self.ways(each.name).max()) for each in self.targets}
        least = _IDLE * max(greatest.values())
        return replace(self, targets=[each for each in self.targets if greatest[each.name] > least])

    def part(self, motions: Sequence[str]) -> _Part | None:
        """The part of the skin that motions move most; None if no target is one of them."""
        ways = [self.ways(each.name) for each in targets_of(self.targets, motions)]
        if not ways:
            return None
        way = np.max([each / each.max() for each in ways], axis=0)
        return self._of(np.where(way > _OF_PART, self.sites.areas * way**2, 0.0))

    def halves(self, part: _Part, left: Floats) -> tuple[_Part, _Part] | None:
        """The left and the right half of a part; None if it lies on one side."""
        apart = (self.sites.positions - part.middle) @ left > 0
        weights = part.weights * apart, part.weights * ~apart
        return (self._of(weights[0]), self._of(weights[1])) if all(each.any() for each in weights) else None

    def _of(self, weights: Floats) -> _Part:
        return _Part(weights, weights @ self.sites.positions / weights.sum())

    def ahead(self, document: Document) -> Floats:
        """(3,) unit, where a face looks: as the skin that its targets move looks on the whole."""
        ways = np.max([self.ways(each.name) for each in self.targets], axis=0)
        mean = unit((self.sites.areas * ways) @ self.sites.normals)
        return mean if mean.any() else read_bones(document).ahead

    def up(self, ahead: Floats) -> Floats:
        """(3,) unit, about up: where brows rise, and against where they or the jaw fall; else y."""
        total = np.zeros(3)
        for motions, sign in ((("browInnerUp", "browOuterUp"), 1.0), (("browDown", "jawOpen"), -1.0)):
            for each in targets_of(self.targets, motions):
                total += sign * unit(self.sites.areas @ self.moved[each.name])
        total = total if total.any() else np.array([0.0, 1.0, 0.0])
        return unit(total - (total @ ahead) * ahead)


def _find_eyes(document: Document, rig: Rig, motion: _Motion, left: Floats) -> _Eyes | None:
    """Find the eyes where targets close lids, or else by joints; None if neither tells."""
    both = motion.part(["eyeBlink"]) or motion.part(["eyeSquint"])
    halves = None if both is None else motion.halves(both, left)
    if halves is not None:
        one, other = halves
        across = (motion.sites.positions - one.middle) @ unit(one.middle - other.middle)
        areas = np.where(one.weights > 0, motion.sites.areas, 0.0)
        low, high = extent(across, areas)
        return _Eyes(one.middle, other.middle, (high - low) / 2.0)
    nodes = [node for node, part in enumerate(read_bones(document).parts) if part == "eye"]
    if len(nodes) != 2:
        return None
    one_place, other_place = node_matrices(rig, None, np.zeros(1), nodes)[0, :, :3, 3]
    if (one_place - other_place) @ left < 0:
        one_place, other_place = other_place, one_place
    return _Eyes(one_place, other_place, _USUAL_EYE * float(np.linalg.norm(one_place - other_place)))


def _eyes_below(brows: _Part, sites: Sites, up: Floats, left: Floats) -> _Eyes:
    """Guess the eyes below brows."""
    low, high = extent((sites.positions - brows.middle) @ left, brows.weights)
    size = _EYES_OF_BROWS * (high - low)
    middle = brows.middle - _USUAL_BROWS * size * up
    return _Eyes(middle + size / 2.0 * left, middle - size / 2.0 * left, _USUAL_EYE * size)


def targets_of(targets: Sequence[FaceTarget], motions: Sequence[str], side: Side = "") -> list[FaceTarget]:
    """The targets of some motions, on a side or on both."""
    return [
        each for each in targets if set(motions).intersection(each.motions) and (not side or each.side in ("", side))
    ]


def read_skin(document: Document, rig: Rig) -> Gauge | None:
    """The triangles of a mesh that may wrinkle, unlike eyes, teeth and hair; None if there are none."""
    surface = read_surface(document, rig)
    rest = rest_pose(surface, rig, ToolsFile(path=document.path), (), [])
    gauge = read_gauge(surface, rest, rig)
    makeup = read_makeup(document, rig, gauge)
    skin = np.zeros(len(gauge.triangles), bool)
    for primitive in np.unique(makeup.primitives).tolist():
        own = makeup.primitives == primitive
        skin |= own & (substance_of(makeup, own / own.sum(), by_morph=True).kind != "hard")
    return part_of(gauge, skin) if skin.any() else None


def cropped(gauge: Gauge, moving: Bools) -> Gauge:
    """The triangles around those of a gauge that move, with (triangles,) `moving`."""
    inside = gauge.middles[moving]
    low, high = inside.min(axis=0), inside.max(axis=0)
    space = _AROUND * float(np.linalg.norm(high - low))
    return part_of(gauge, ((gauge.middles > low - space) & (gauge.middles < high + space)).all(axis=1))


def _displacements(gauge: Gauge, target: FaceTarget) -> Floats:
    """(vertices, 3) by which a target moves the vertices at weight 1, world space."""
    clip = motion_clip(target.name, [raising(gauge.rig, target.weights)])
    return unscaled_pose(gauge, clip, 1.0) - unscaled_pose(gauge, clip, 0.0)
