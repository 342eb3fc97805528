"""The rings of wrinkles in front of a touch: bumps round its pad, which take up the shortening along each ray from it.

The slide of the skin falls with the distance from the pad. So the skin between two distances gets shorter along each
ray by a part of the slide's component along the ray, and the bump there rises as one of a control curve does: its
length stays (`effects.profile`). To the sides, where the ray turns away from the slide, rings fade like the cosine of
the angle, as a tool's wrinkles fade to the sides of its patch. The directions are cut into windows, each with a morph
target, whose weights are that cosine times one function of the slide.

Source: C. Larboulette, M.-P. Cani, *Real-Time Dynamic Wrinkles*, CGI 2004, on the control curve and, as future work, on
wrinkles caused by an interaction. Differs: the curve runs along rays from the pad.
"""

from dataclasses import replace

import numpy as np

from wrinklecli.drive.table import ROWS
from wrinklecli.effects.profile import SmoothProfile, plan_smooth
from wrinklecli.effects.touch.skin import Place
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import TINY, Floats, interpolated, ramp, smoothstep
from wrinklecli.numeric.drawn import drawn
from wrinklecli.surface.region import FACING
from wrinklecli.tools.body import Touch, TouchWrinkles
from wrinklecli.tools.records import drawn_from

# Farthest that a furrow wanders from its circle, over the width of a ring, and loss of height along a crest, both at a
# variation of 1; and differences of widths.
_WANDER, _FADING, _WIDTH = 0.4, 0.9, 0.35
# Waves round the pad of which furrows and crests are made: shorter ones would read as crumpled paper.
_WAVES = np.array([2.0, 3.0, 4.0, 5.0, 7.0])
# Power of the cosine by which rings of a row fade to the sides, which a tip that goes on leaves behind: with 2, an
# eighth of the height was left a pad behind it.
_AHEAD = 3
# Halvings of an interval by which the part that the tissue takes itself is found.
_HALVINGS = 40


@dataclass(frozen=True, slots=True, eq=False)
class Rings:
    """The rings of a touch.

    Attributes:
        start: Distance of the first furrow from the middle of the place, scene units.
        length: From there to the last furrow, scene units.
        edges: (rings + 1,) places of the furrows, from 0 to 1.
        shares: (rings,) part of the slide by which the skin under each ring gets shorter.
        amplitudes: (rings,) heights at the greatest slide, scene units.
        rises: (rows, 2) slides over the greatest, and weights.
        compressible: Part of the shortening that the tissue takes itself.
        angles: (windows,) directions of the windows, radians from forward towards sideways.
        profile: The shape of a bump.
        wander: (2, rings + 1, waves) amplitudes of the furrows' cosines and sines, over the length.
        fading: (2, rings, waves) amplitudes of the loss of height along the crests.
        travels: True in a row of places.
    """

    start: float
    length: float
    edges: Floats
    shares: Floats
    amplitudes: Floats
    rises: Floats
    compressible: float
    angles: Floats
    profile: SmoothProfile
    wander: Floats
    fading: Floats
    travels: bool = False

    @property
    def tallest(self) -> float:
        """Greatest height of a ring, scene units."""
        return float(self.amplitudes.max(initial=0.0)) * self.profile.peak

    def windows(self, angles: Floats) -> Floats:
        """(windows, …) shares of the windows in the directions of (…,) angles; they sum to 1 if there are several."""
        apart = np.abs((angles - self.angles.reshape(-1, *(1,) * angles.ndim) + np.pi) % (2.0 * np.pi) - np.pi)
        if len(self.angles) == 1:
            return np.maximum(np.cos(apart), 0.0) ** (_AHEAD if self.travels else 1)
        return np.maximum(1.0 - apart * len(self.angles) / (2.0 * np.pi), 0.0)

    def heights(self, distances: Floats, angles: Floats) -> Floats:
        """(places,) heights at the greatest slide along each ray, at (places,) distances and angles, scene units."""
        u = (distances - self.start) / self.length
        rows = np.multiply.outer(_WAVES, angles)
        furrows = self.edges[:, None] + _waving(self.wander, rows)
        heights = np.zeros(len(u))
        losses = _waving(self.fading, rows)
        for ring, amplitude in enumerate(self.amplitudes.tolist()):
            taus = (u - furrows[ring]) / (furrows[ring + 1] - furrows[ring])
            inside = (taus > 0) & (taus < 1)
            shape = self.profile.shapes(np.clip(taus, 0.0, 1.0))[0]
            heights += np.where(inside, amplitude * shape * np.clip(1.0 - losses[ring], 0.0, 1.0), 0.0)
        return heights

    def displacements(self, place: Place, slides: Floats, positions: Floats, normals: Floats) -> Floats:
        """(windows, vertices, 3) displacements at the greatest slide in the direction of each window.

        Skin that slides less than other skin at its distance, as over a bone, gets lower rings.

        Args:
            place: The place of the touch.
            slides: (2, vertices, 3) slides whose mean under the pad is 1.
            positions: (vertices, 3).
            normals: (vertices, 3) unit vectors.
        """
        distances, angles = place.polar(positions)
        radial = radial_slides(place, slides, positions)
        facing = smoothstep(ramp(normals @ place.axes[2], *FACING))
        mean = interpolated(distances, *mean_slides(place, slides, positions, normals, self))[:, 0]
        part = np.sqrt(np.clip(radial / np.maximum(mean, 1e-9), 0.0, 1.0))
        heights = self.heights(distances, angles) * facing * part
        return np.asarray((self.windows(angles) * heights)[..., None] * normals)


def radial_slides(place: Place, slides: Floats, positions: Floats) -> Floats:
    """(vertices,) slides away from the pad, where the pad slides by 1 in the direction of each vertex."""
    _, angles = place.polar(positions)
    outward = np.cos(angles)[:, None] * place.axes[0] + np.sin(angles)[:, None] * place.axes[1]
    along = np.cos(angles)[:, None] * slides[0] + np.sin(angles)[:, None] * slides[1]
    return np.asarray(np.sum(outward * along, axis=1))


def mean_slides(
    place: Place, slides: Floats, positions: Floats, normals: Floats, rings: "Rings"
) -> tuple[Floats, Floats]:
    """(furrows,) distances from the middle, and (furrows, 1) mean radial slides there, by a line fitted round each."""
    distances, _ = place.polar(positions)
    radial = radial_slides(place, slides, positions)
    facing = np.flatnonzero(normals @ place.axes[2] > FACING[1])
    at = rings.start + rings.length * rings.edges
    width = rings.length / (len(rings.edges) - 1)
    found = np.zeros(len(at))
    for number, distance in enumerate(at.tolist()):
        offsets = distances[facing] - distance
        # A kernel as wide as a ring; where a mesh is coarse, as wide as takes in a few vertices.
        weights = np.exp(-0.5 * (offsets / width) ** 2)
        sums = np.array([(weights * offsets**power).sum() for power in range(3)])
        values = np.array([(weights * offsets**power * radial[facing]).sum() for power in range(2)])
        spread = sums[0] * sums[2] - sums[1] ** 2
        found[number] = (sums[2] * values[0] - sums[1] * values[1]) / spread if spread > 0 else 0.0
    return at, np.maximum(found, 0.0)[:, None]


def plan_rings(
    tool: Touch,
    wanted: TouchWrinkles,
    place: Place,
    grip: float,
    main: float | None,
    number: int,
    slides: Floats,
    positions: Floats,
    normals: Floats,
) -> Rings:
    """Plan the rings of a touch.

    Args:
        tool: The touch.
        wanted: Its rings, as the tools file asks for them.
        place: Its place.
        grip: The greatest slide, scene units.
        main: The direction of the only window, radians; unused if there are several, and None in a row, whose window is
            ahead.
        number: Of the place in its row.
        slides: (2, vertices, 3) slides whose mean under the pad is 1.
        positions: (vertices, 3) of the skin.
        normals: (vertices, 3) unit vectors.
    """
    bumps, amount, seed = wanted.bumps, wanted.amount, drawn_from(tool.name, wanted.seed)
    # Each place of a row has rings of its own; those of all would be stamps.
    rings_of = f"rings of {number}" if number else "rings"
    widths = 1.0 + _WIDTH * amount * drawn(seed, rings_of, bumps)
    edges = np.append(0.0, np.cumsum(widths / widths.sum()))
    wander = (
        _WANDER
        * amount
        / bumps
        * drawn(seed, f"furrows of {rings_of}", 2, bumps + 1, len(_WAVES))
        / np.sqrt(len(_WAVES))
    )
    wander[:, [0, -1]] = 0.0
    fading = _FADING * amount * drawn(seed, f"crests of {rings_of}", 2, bumps, len(_WAVES)) / np.sqrt(len(_WAVES))
    directions = 1 if main is None else wanted.directions
    several = np.linspace(0.0, 2.0 * np.pi, directions, endpoint=False)
    start, length = place.pad, wanted.length.resolve(place.reach)
    profile = plan_smooth((), wanted.shape)
    rings = Rings(
        start=start,
        length=length,
        edges=edges,
        shares=np.zeros(bumps),
        amplitudes=np.zeros(bumps),
        rises=np.zeros((ROWS, 2)),
        compressible=0.0,
        angles=several if directions > 1 else np.array([main or 0.0]),
        profile=profile,
        wander=wander,
        fading=fading,
        travels=main is None,
    )
    _, mean = mean_slides(place, slides, positions, normals, rings)
    shares = np.maximum(-np.diff(mean[:, 0]), 0.0)
    spans = length * np.diff(edges)
    highest = wanted.bump_height * length / bumps
    compressible = 0.0
    low, high = 0.0, 1.0
    for _ in range(_HALVINGS if profile.peak * _amplitudes(profile, spans, shares * grip, low).max() > highest else 0):
        middle = (low + high) / 2.0
        above = profile.peak * _amplitudes(profile, spans, shares * grip, middle).max() > highest
        low, high = (middle, high) if above else (low, middle)
        compressible = high
    steps = np.linspace(0.0, 1.0, ROWS) ** 2  # heights start like a square root
    table = np.stack([_amplitudes(profile, spans, shares * grip * step, compressible) for step in steps])
    full = table[-1]
    weights = table @ full / max(float(full @ full), TINY)
    return replace(
        rings, shares=shares, amplitudes=full, compressible=compressible, rises=np.stack([steps, weights], axis=1)
    )


def _amplitudes(profile: SmoothProfile, spans: Floats, shortenings: Floats, compressible: float) -> Floats:
    """(rings,) amplitudes of bumps on (rings,) spans that get shorter by (rings,) lengths, scene units."""
    absorbed = (1.0 - compressible) * np.minimum(shortenings, spans)
    return np.asarray(profile.amplitudes(absorbed, (spans - absorbed) / 2.0, np.inf)[:, 0])


def _waving(amplitudes: Floats, rows: Floats) -> Floats:
    """(lines, angles) sums of waves of (2, lines, waves) amplitudes, at (waves, angles) phases."""
    return np.asarray(amplitudes[0] @ np.cos(rows) + amplitudes[1] @ np.sin(rows))
