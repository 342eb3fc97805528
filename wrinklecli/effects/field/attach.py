"""Fields on a mesh at rest: what folds it, how high, and the few shapes that play it."""

from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from wrinklecli.character.bent import bending_nodes
from wrinklecli.choices import SUBSTANCES
from wrinklecli.drive.table import Table
from wrinklecli.drive.turned import TurnDrive
from wrinklecli.effects.attached import Attached
from wrinklecli.effects.field.factors import UNSEEN, Factors, factors_of
from wrinklecli.effects.field.heights import WAVE, averages_over, measure
from wrinklecli.effects.field.irregular import Irregular
from wrinklecli.effects.field.material import FABRICS, Fabric
from wrinklecli.effects.field.region import FieldRegion
from wrinklecli.effects.field.turns import Sweeps, acting_together, led_by, turns_of
from wrinklecli.errors import BakeError, listed, nearest
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import TINY, Floats, Ints, face_normals, smoothstep, weighted_quantiles
from wrinklecli.numeric.closest import Tree, nearest_of
from wrinklecli.numeric.laplacian import Average, Sheet
from wrinklecli.numeric.memory import once
from wrinklecli.surface.features import cut_at_features
from wrinklecli.surface.ground import Ground
from wrinklecli.surface.mask import read_mask
from wrinklecli.surface.refine import Refinement
from wrinklecli.surface.rounding import FACETED, bends
from wrinklecli.surface.strain import solid
from wrinklecli.surface.substance import substances_at
from wrinklecli.tools.fields import Field
from wrinklecli.tools.records import drawn_from

# Part of the largest area that a joint bends below which it folds nothing.
_LEAST_BENT = 1e-3
# Most shapes of a field.
_MOST_SHAPES = 24
# Least and greatest ratio of the girth of limbs to the typical one.
_THINNEST, _THICKEST = 0.2, 3.0
# The part of a place's bends at hard edges from which on no wrinkle is left; from `FACETED` on they become lower.
_MOST_FACETED = 0.8
# Numbers of each vertex and pose that are held at once.
_HELD = 4
# Half height of the tallest fold over the wavelength below which nobody sees one.
_LEAST_HEIGHT = 0.01
# Weight below which a shape does not act: a fifth of the default --max-error. Factors come near to 0 and never reach
# it, so an engine would play each shape from the first degree on.
_LEAST_WEIGHT = 2e-3


@dataclass(frozen=True, slots=True, eq=False)
class AttachedField(Attached[Field]):
    """A field on a mesh at rest.

    Attributes:
        tool: The field of the tools file.
        fabric: The shape of its folds.
        girth: Of the limbs beneath, in the median; scene units.
        wavelength: From crest to crest at rest, scene units.
        sweeps: The poses in which it was measured.
        factors: Half heights by shapes on the coarse surface.
        region: The part of the surface.
        drive: The weights of its targets.
        notes: A line for each texture that cannot be read, if its substances are looked for.
    """

    tool: Field
    fabric: Fabric
    girth: float
    wavelength: float
    sweeps: Sweeps
    factors: Factors
    region: FieldRegion
    drive: TurnDrive
    notes: tuple[str, ...] = ()

    moves: ClassVar[None] = None
    covers: ClassVar[tuple[str, ...]] = ()

    @property
    def regions(self) -> tuple[FieldRegion]:
        """The one region."""
        return (self.region,)

    @property
    def span(self) -> float:
        """The girth."""
        return self.girth

    @property
    def greatest_height(self) -> float:
        """The height of its tallest fold at rest; skinning lowers those on the inner side of a bend."""
        return self.region.greatest_height

    @property
    def bump_width(self) -> float:
        """A wavelength."""
        return self.wavelength

    def may_move(self, fine: Refinement) -> list[Ints]:
        """For each fold the vertices of a refined surface that it may move: all but those that lowering leaves out."""
        heights = fine.subdivision.interpolate(self.factors.shapes[~self.factors.creases].T)
        return [np.flatnonzero(each > UNSEEN * heights.max()) for each in heights.T]


def attach_fields(fields: Sequence[Field], ground: Ground) -> list[AttachedField]:
    """Attach every field of a mesh.

    Raises:
        WrinkleError: Fields do not fit, a line for each.
    """
    return BakeError.every(lambda each: _attach(each, ground), fields)


def _attach(tool: Field, ground: Ground) -> AttachedField:
    surface, rest = ground.surface, ground.rest
    where, name = tool.where, ground.rig.node_name
    if not ground.rig.skinned:
        raise BakeError(f"{name} has no skin: a field needs joints that fold it", where=where)
    members = np.flatnonzero(solid(rest.positions, surface.triangles, face_normals(rest.positions, surface.triangles)))
    if not len(members):
        raise BakeError(f"{name} has no triangle with an area", where=where)
    fabric = FABRICS[tool.material]
    sheet = Sheet.of(rest.positions, surface.triangles[members])
    radii, girth, wavelength = _girth(tool, ground, sheet)
    near, wave, beyond = averages_over(sheet, wavelength)
    ratios = np.clip(beyond.of(2.0 * np.pi * radii / max(girth, TINY)), _THINNEST, _THICKEST)
    # Sheets on a thicker tube fold in longer waves, λ ~ √(thickness · radius).
    wavelengths = wavelength * (np.sqrt(ratios) if tool.wavelength.percent else np.ones(len(ratios)))
    seed = drawn_from(tool.name, tool.seed)
    # With another wavelength, joints turn as before.
    sweeps = once(ground.known, (tool.joints, seed), lambda: _sweeps(tool, ground, girth / np.pi, seed))
    poses = len(sweeps.angles)
    ground.document.memory.check(_HELD * 8 * poses * len(rest.positions), f"heights in {poses} poses", where=where)
    allowed = _allowed(tool, ground, members, sheet, wave, wavelength)
    # Lengths slip there and back, so as much is missing as the square of this.
    reached = sheet.averaging(girth / np.pi).of((allowed > 0).astype(np.float64))
    beside = (allowed > 0) | (reached > UNSEEN / 3.0)
    around = sheet.triangles[beside[sheet.triangles].any(axis=1)]
    if 0 < len(around) < len(sheet.triangles):
        # Most of a mesh may be skin or hair, which takes as long to measure as its cloth.
        sheet = Sheet.of(rest.positions, around)
        near, wave, beyond = averages_over(sheet, wavelength)
    measured = measure(
        sheet,
        rest,
        surface.joints,
        surface.weights,
        sweeps.matrices,
        (near, wave, beyond),
        wavelength=wavelength,
        wavelengths=wavelengths,
        radii=ratios * girth / (2.0 * np.pi),
        slack=tool.slack,
        allowed=allowed,
    )
    factors = factors_of(sweeps, measured.heights, sheet.areas, _MOST_SHAPES)
    tallest = float(measured.heights.max())
    if not len(factors.shapes) or tallest < _LEAST_HEIGHT * wavelength:
        raise BakeError(
            f"hardly anything of {name} loses more than {100 * tool.slack:.3g} % of its length, the slack, as its"
            f" joints turn: folds would be {2.0 * tallest:.2g} high at most",
            where=where,
        )
    factors = factors.creased(sweeps, _MOST_SHAPES)
    height = 2.0 * (1.0 - fabric.inward) * tallest
    shares = measured.heights.max(axis=0) / tallest
    seen = members[(shares[surface.triangles[members]] > UNSEEN).any(axis=1)]
    irregular = Irregular(wavelength, tool.variation, seed)
    tree = Tree.of(rest.positions, surface.triangles[seen])
    crests = (measured.directions, measured.slants, measured.leads)
    region = FieldRegion(seen, rest, height, shares, *crests, wavelengths, irregular, tree)
    return AttachedField(
        tool,
        fabric,
        girth,
        wavelength,
        sweeps,
        factors,
        region,
        drive_of(tool, sweeps, factors),
        () if tool.substance is None else tuple(ground.pictures.notes),
    )


def _sweeps(tool: Field, ground: Ground, thickness: float, seed: str) -> Sweeps:
    """The poses in which a field is measured, on limbs of a typical thickness, scene units.

    Raises:
        BakeError: No joint turns.
    """
    turns = turns_of(ground, _joints(tool, ground), thickness)
    if not turns:
        raise BakeError("no joint of its mesh turns", where=tool.where)
    together, led = acting_together(ground, turns), led_by(ground)
    return Sweeps.of(ground.rig, turns, ground.clips, seed=seed, together=together, led=led)


def drive_of(tool: Field, sweeps: Sweeps, factors: Factors) -> TurnDrive:
    """The weights of the shapes, by all turns that raise them or pull them flat."""
    acting = [np.where(np.abs(table) < _LEAST_WEIGHT, 0.0, table) for table in factors.tables]
    turns = [
        (turn.signal, Table("angles", turn.angles, table))
        for turn, table in zip(sweeps.turns, acting, strict=True)
        if table.any()
    ]
    names = tuple(f"wrinkle_{tool.identifier}_{number + 1}" for number in range(len(factors.shapes)))
    return TurnDrive(tool.name, tuple(turns), names, dict(tool.clips), tool.strength)


def _joints(tool: Field, ground: Ground) -> list[int]:
    """The nodes whose turns bend the mesh, or those among them that the field names.

    Raises:
        BakeError: There is no such joint.
    """
    rig = ground.rig
    bending = bending_nodes(ground.document, rig, _LEAST_BENT)
    if tool.joints == "all":
        return bending
    known = {rig.names[node]: node for node in bending}
    absent = [name for name in tool.joints if name not in known]
    if absent and not (tool.optional and len(absent) < len(tool.joints)):
        raise BakeError(
            f"no joint {absent[0]!r} bends its mesh{nearest(absent[0], known)}; there are {listed(known)}",
            where=tool.place("joints"),
        )
    return [known[name] for name in tool.joints if name in known]


def _girth(tool: Field, ground: Ground, sheet: Sheet) -> tuple[Floats, float, float]:
    """(vertices,) radii of the limbs beneath, their girth, and the typical wavelength, scene units.

    Raises:
        BakeError: It is longer than the mesh, or a percentage where no limb is beneath.
    """
    size = float(np.linalg.norm(np.ptp(sheet.positions, axis=0)))
    radii = _radii(ground, sheet.areas)
    girth = 2.0 * np.pi * float(weighted_quantiles(radii, sheet.areas, np.array([0.5]))[0])
    found = tool.wavelength.resolve(girth or np.inf)  # what is flat belongs to no limb
    if not found < size:
        long = f"a wavelength of {found:.3g} is longer than its mesh, {size:.3g}"
        flat = "a percentage is of the girth of a limb, and what is flat has none; give a length in scene units"
        raise BakeError(long if girth or np.isfinite(found) else flat, where=tool.place("wavelength"))
    return radii, girth, found


def _radii(ground: Ground, areas: Floats) -> Floats:
    """(vertices,) radii of the limbs beneath: for each joint the mean distance, along normals, from where these meet.

    Bones say less: there are some without a length, beside a limb, or none before the first joint that turns.
    """
    joints, places, normals = ground.surface.joints, ground.rest.positions, ground.rest.normals
    sizes = ground.surface.weights**2 * areas[:, None]  # what a joint hardly moves hardly counts
    wholes = np.maximum(np.bincount(joints.ravel(), sizes.ravel()), TINY)

    def means(values: Floats) -> Floats:
        """(joints, n) means of (vertices, influences or 1, n) values."""
        shares = sizes[..., None] * values
        return np.stack([np.bincount(joints.ravel(), each.ravel()) / wholes for each in np.moveaxis(shares, 2, 0)], 1)

    # The nearest point to all lines along normals: the middle of a tube, and that of what is a part of its round.
    middles = means(places[:, None])
    across = np.eye(3) - normals[:, :, None] * normals[:, None]
    forms = means(across.reshape(-1, 1, 9)).reshape(-1, 3, 3)
    pulls = means((across @ places[:, :, None]).transpose(0, 2, 1)) - np.einsum("jab,jb->ja", forms, middles)
    middles += np.einsum("jab,jb->ja", np.linalg.pinv(forms, hermitian=True), pulls)
    apart = np.abs(np.einsum("vki,vi->vk", places[:, None] - middles[joints], normals))
    return np.asarray(np.average(means(apart[..., None])[joints, 0], axis=1, weights=sizes))


def _allowed(tool: Field, ground: Ground, members: Ints, sheet: Sheet, wave: Average, wavelength: float) -> Floats:
    """(vertices,) factors of the heights: by mask and substances, at features, and where the surface is faceted.

    Raises:
        BakeError: Nothing is left.
    """
    surface, name = ground.surface, ground.rig.node_name
    found = np.ones(len(sheet.positions))
    if tool.stops == "features":
        bent = bends(surface, ground.rest.bind_positions)
        at_hard, at_all = (np.maximum(wave.of_integrals(each), 0.0) for each in bent)
        faceted = at_hard / np.where(at_all > 0, at_all, 1.0)
        found *= np.clip((_MOST_FACETED - faceted) / (_MOST_FACETED - FACETED), 0.0, 1.0)
        if not found.any():
            raise BakeError(f"{name} is faceted: a field needs a smooth surface with normals", where=tool.where)
        # Folds run over the creases within cloth, such as a pocket's: no run of these is long enough to be a feature.
        ends = cut_at_features(ground, members, np.inf).features
        if len(ends):
            places = sheet.positions[ends]
            near, _ = nearest_of(np.concatenate([places[:, 0], places.mean(axis=1), places[:, 1]]), sheet.positions)
            found *= smoothstep(np.minimum(near / (WAVE * wavelength), 1.0))
    found *= _of_substance(tool, ground, members, sheet, wave)
    mask = read_mask(tool, ground, members)
    if mask is not None:
        found *= mask.welded(surface.weld, len(found))
        if not found.any():
            raise BakeError(f"the mask leaves nothing of {tool.name}", where=tool.place("mask"))
    return found


def _of_substance(tool: Field, ground: Ground, members: Ints, sheet: Sheet, wave: Average) -> Floats:
    """(vertices,) factors of the heights, which fade where its substances end.

    Raises:
        BakeError: Its substances are nowhere.
    """
    if tool.substance is None:
        return np.ones(len(sheet.positions))
    kinds = substances_at(ground)[members]
    inside = np.isin(kinds, [SUBSTANCES.index(each) for each in tool.substance])
    # The average is a half at a straight border.
    part = wave.of_integrals(sheet.to_vertices(inside.astype(float)))
    found = smoothstep(np.clip(2.0 * part - 1.0, 0.0, 1.0))
    if not found.any():
        there = listed(SUBSTANCES[kind] for kind in np.unique(kinds).tolist())
        raise BakeError(
            f"nothing of {ground.rig.node_name} looks like {' or '.join(tool.substance)}: it is {there}",
            where=tool.place("substance"),
        )
    return found
