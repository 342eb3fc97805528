"""Small pictures of a place without and with wrinkles, by the rays of a review, and how much of the wrinkles shows."""

from dataclasses import replace

import numpy as np

from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Bools, Floats, Ints, distinct_values, face_normals, unit
from wrinklecli.review.preview.camera import Camera
from wrinklecli.review.preview.light import RAKING_LIGHTS, smooth
from wrinklecli.review.preview.rays import Hits, Occluders, first_hits, trace
from wrinklecli.review.preview.sides import UNSEEN, Place, Side, best_light, best_side
from wrinklecli.review.suggest.stage import StagedTool, meets

# Pixels along a picture's side: a place that is drawn as large as on a sheet of `preview --review`.
SIDE = 160
# Pixels over which shadows are softened.
_SOFT = 11
# Factor of a picture's reach round a place: what is beside it shows where it is.
_MARGIN = 1.15
# Bounds of what a picture shows, in camera space.
_PICTURE = np.array([(-1.0, -1.0, -np.inf), (1.0, 1.0, np.inf)])
# Strips in which crests are looked at, side by side across a tool; a crest is at least as long as one.
_STRIPS = 3
# Greatest |v| in them; beyond, wrinkles fade.
_WITHIN = 0.75
# Steps across a bump in which the light is alike: eight for either flank, as large as a pixel or two.
_STEPS = 16
# Pixels in a step from which its mean counts.
_FEWEST = 3
# Part of the steps of a strip that must be seen.
_LEAST_KNOWN = 0.25


@dataclass(frozen=True, slots=True)
class Crests:
    """The change of lightness that wrinkles make at a place, over the lightness.

    Crests are bands across the tool, light on one side and dark on the other. Lumps, specks and a step at the border
    of a place change the light as much, but not along the crests.

    Attributes:
        contrast: The part that is alike along the crests and alternates across them, root mean square.
        share: Square of that part over the square of all that changes within the place.
    """

    contrast: float
    share: float

    @classmethod
    def of(cls, changes: Floats, us: Floats, vs: Floats, bumps: int) -> "Crests":
        """Measure (pixels,) changes of lightness at places us along the curve of the wrinkles and vs across it."""
        inside = np.abs(vs) < _WITHIN
        changes, us, vs = changes[inside], us[inside], vs[inside]
        steps = _STEPS * bumps
        columns = np.clip((us * steps).astype(np.intp), 0, steps - 1)
        strips = np.clip(((vs / _WITHIN + 1.0) * (_STRIPS / 2.0)).astype(np.intp), 0, _STRIPS - 1)
        along, whole = 0.0, 0.0
        for strip in range(_STRIPS):
            here = strips == strip
            counts = np.bincount(columns[here], minlength=steps)
            known = counts >= _FEWEST
            here &= known[columns]
            if known.sum() < _LEAST_KNOWN * steps:
                continue
            counts = counts[known]
            means = np.bincount(columns[here], changes[here], steps)[known] / counts
            # A step or a slope in the light over a strip of several crests is none of them.
            line = np.polynomial.Polynomial.fit(np.flatnonzero(known), means, min(bumps - 1, 1), w=np.sqrt(counts))
            means_at = np.zeros(steps)
            means_at[known] = means
            beside = float(np.sum((changes[here] - means_at[columns[here]]) ** 2))
            crests = float(counts @ (means - line(np.flatnonzero(known))) ** 2)
            along, whole = along + crests, whole + crests + beside
        count = max(int(np.count_nonzero(inside)), 1)
        return cls(float(np.sqrt(along / count)), along / whole if whole > 0 else 0.0)


@dataclass(frozen=True, slots=True)
class Sight:
    """A place, and what may hide it.

    Attributes:
        place: Some of its triangles.
        reach: Distance from its middle that a picture shows, scene units.
        occluders: All that is near, with wrinkles.
    """

    place: Place
    reach: float
    occluders: Occluders

    @classmethod
    def of(cls, staged: StagedTool) -> "Sight":
        """Prepare to look at a tool from many sides."""
        plain, wrinkled = (each[staged.triangles[staged.place]] for each in (staged.plain, staged.wrinkled))
        place = Place.of(plain, wrinkled)
        reach = _MARGIN * float(np.linalg.norm(wrinkled - place.centre, axis=2).max())
        return cls(place, reach, Occluders.of(staged.wrinkled, staged.triangles))

    @property
    def best_side(self) -> Side:
        """The side to look from."""
        return best_side(self.place, self.free)

    def free(self, directions: Floats) -> Bools:
        """(directions, points) True for points of the place that nothing hides from (directions, 3)."""
        return self.occluders.free(self.place.points, self.place.normals, directions)


def look_at(staged: StagedTool, sight: Sight, side: Side) -> tuple[Side, Crests]:
    """Look at a tool from a side, in the light in which a review shows it: what one sees from there, and its crests."""
    camera = Camera(sight.place.centre, side.axes, sight.reach, tangent=0.0)
    key = best_light(sight.place, camera.axes, sight.free)
    triangles, shown = staged.triangles, staged.shown
    placed = distinct_values(triangles[staged.place])
    pixels = _pixels_round(camera.project(np.concatenate([each[placed] for each, _ in shown]), (SIDE, SIDE)))
    drawn = [_drawn(staged, camera, pixels, *each) for each in shown]
    # Shadows of the body are the same without and with wrinkles.
    lit = _lit(sight, camera, staged.wrinkled[triangles], drawn[1], key)
    lightness = np.zeros((2, SIDE * SIDE))
    taken = np.zeros((2, SIDE * SIDE), np.bool_)
    for number, hits in enumerate(drawn):
        amounts = lit[hits.pixels] * np.maximum(hits.normals @ key, 0.0), hits.normals[:, 2], np.ones(len(hits.pixels))
        # Of the colours of the lights green is closest to how light they look.
        lightness[number, hits.pixels] = np.stack(amounts, axis=1) @ RAKING_LIGHTS[:, 1]
        taken[number, hits.pixels] = staged.place[hits.triangles]
    crests = Crests(0.0, 0.0)
    both = taken[0] & taken[1]
    if both.any():
        hits = drawn[1].only(both[drawn[1].pixels])
        us, vs = np.einsum("pk,pka->ap", hits.weights, staged.places[triangles[hits.triangles]])
        known = np.isfinite(us)
        before, after = lightness[:, both]
        # Deep shade counts as the mean.
        changes = (after - before) / np.maximum(before, before.mean())
        # A field has no coordinates, and crests all over its place.
        crests = Crests(float(np.sqrt(np.mean(changes**2))), 1.0)
        if known.any():
            crests = Crests.of(changes[known], us[known], vs[known], staged.bumps)
    # What hides a place may lie so near to it that its points seemed visible.
    return side if taken[1].any() else UNSEEN, crests


def _pixels_round(points: Floats) -> Ints:
    """(pixels,) of a picture that are round (points, 2) in it, with those that soften their shadows."""
    low, high = (
        np.clip(each, 0, SIDE).astype(int) for each in (points.min(axis=0) - _SOFT, points.max(axis=0) + _SOFT)
    )
    found: Ints = (SIDE * np.arange(low[1], high[1])[:, None] + np.arange(low[0], high[0])).ravel()
    return found


def _drawn(staged: StagedTool, camera: Camera, pixels: Ints, positions: Floats, smoothed: Floats) -> Hits:
    """See a state of a tool, with (vertices, 3) normals of smooth shading, at some pixels."""
    local = camera.local(positions)
    near = np.flatnonzero(meets(local, staged.triangles, *_PICTURE))
    used, triangles = np.unique(staged.triangles[near], return_inverse=True)
    local, triangles = local[used], triangles.reshape(-1, 3)
    normals = smoothed[used][triangles] @ camera.axes.T
    if staged.shaded_flat:
        normals = np.repeat(face_normals(local, triangles)[:, None], 3, axis=1)
    surface = trace(local, unit(normals), camera.tangent, triangles=triangles)
    hits = first_hits(surface, (SIDE, SIDE), 0, pixels, np.zeros((1, 2)))
    return replace(hits, triangles=near[hits.triangles])


def _lit(sight: Sight, camera: Camera, corners: Floats, hits: Hits, key: Floats) -> Floats:
    """(pixels,) part of the key light in direction (3,), in camera axes, that reaches each; with soft shadows."""
    points = np.einsum("pk,pka->pa", hits.weights, corners[hits.triangles])
    # What faces away from the light is dark anyway, and its neighbours are not in its shade.
    free = sight.occluders.free(points, hits.normals @ camera.axes, key[None] @ camera.axes)[0] | (
        hits.normals @ key <= 0
    )
    lit: Floats = smooth(free, hits.pixels, (SIDE, SIDE), _SOFT)
    return lit
