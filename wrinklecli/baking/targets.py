"""Morph targets of a tool: their names, their shapes, and other shapes that an engine asks for."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from wrinklecli.baking.left import Left
from wrinklecli.effects.wrinkle.carry import CarriedPatch
from wrinklecli.effects.wrinkle.shapes import Shape
from wrinklecli.numeric.arrays import Floats, Ints

if TYPE_CHECKING:
    from wrinklecli.effects.contact.crease import Crease, Followed


@dataclass(frozen=True, slots=True)
class Target:
    """A morph target to write: its name and shape."""

    name: str
    shape: Shape


@dataclass(frozen=True, slots=True)
class Remix:
    """Shapes in place of the control curve's own, which play the same within an engine's limits.

    Attributes:
        mix: (curve's shapes, shapes before the split) what weights of the curve's shapes are multiplied by.
        unmix: (shapes, curve's shapes) what the new shapes are made of.
        split: Columns of `mix` whose negative weights drive shapes of their own, which follow.
        least: Weights up to this are 0.
    """

    mix: Floats
    unmix: Floats
    split: tuple[int, ...] = ()
    least: float = 0.0

    def weights(self, of_curve: Floats) -> Floats:
        """(frames, shapes) weights of the new shapes from (frames, curve's shapes) weights of the curve's."""
        mixed = of_curve @ self.mix
        kept = np.where(np.abs(mixed) > self.least, mixed, 0.0)
        columns = list(self.split)
        negative = np.maximum(-kept[:, columns], 0.0)
        kept[:, columns] = np.maximum(kept[:, columns], 0.0)
        return np.concatenate([kept, negative], axis=1)

    @property
    def signed_mix(self) -> Floats:
        """(curve's shapes, shapes) the mix with the split columns' negatives: weights, where those below 0 are 0."""
        return np.concatenate([self.mix, -self.mix[:, list(self.split)]], axis=1)


@dataclass(frozen=True, slots=True)
class Lift:
    """One shape more than a fold's, the others taken back: with it, weights from 0 to 1 do what any others do.

    Blender takes no weight below 0 nor above 1, and other players not all.

    Attributes:
        count: Of the fold's shapes.
        greatest: Weight of theirs, to either side of 0.
    """

    count: int
    greatest: float

    def weights(self, sampled: Floats) -> Floats:
        """(frames, count + 1) weights from (frames, count) of the fold's shapes."""
        below = np.minimum(sampled.min(axis=1, initial=0.0), 0.0)[:, None]
        weights: Floats = np.concatenate([sampled - below, -below], axis=1) / self._full
        return weights

    @property
    def unmix(self) -> Floats:
        """(count + 1, count) what the new shapes are made of."""
        shares = np.concatenate([np.eye(self.count), -np.ones((1, self.count))])
        return np.asarray(self._full[:, None] * shares)

    @property
    def _full(self) -> Floats:
        """(count + 1,) what weights of 1 stand for."""
        return self.greatest * np.append(np.full(self.count, 2.0), 1.0)


@dataclass(frozen=True, slots=True)
class TargetSet:
    """One tool's morph targets.

    Attributes:
        carried: The tool on the refined surface.
        targets: One for each shape; None for a shape that moves no vertex, which is not written.
        remix: Where the shapes are others than the control curve's, as an engine asked for.
    """

    carried: CarriedPatch
    targets: tuple[Target | None, ...]
    remix: Remix | None = None

    @property
    def identifier(self) -> str:
        """What the targets are named by."""
        return self.carried.patch.tool.identifier

    @property
    def from_skin(self) -> bool:
        """Whether weights follow from the anchors' distance alone."""
        return self.carried.patch.tool.attachment == "skin"

    def shape_weights(self, of_curve: Floats) -> Floats:
        """(frames, shapes) weights of the shapes from (frames, …) weights of the control curve's."""
        flat = of_curve.reshape(len(of_curve), -1)
        return flat if self.remix is None else self.remix.weights(flat)

    @property
    def columns(self) -> Ints:
        """The shapes that have a target."""
        return _columns(self.targets)

    def written(self, weights: Floats) -> Floats:
        """The columns of (frames, shapes) weights that have a target."""
        written: Floats = weights[:, self.columns]
        return written


@dataclass(frozen=True, slots=True)
class CreaseSet:
    """The morph targets of a fold whose contact is resolved.

    Attributes:
        crease: What contact does.
        identifier: What the targets are named by.
        lift: What makes their shapes of the crease's.
        targets: One for each shape; None for a shape that moves no vertex.
        clips: How the shapes follow the clips that they act in,
        left: and what crosses there still.
        clip: The one clip that they act in; None for all.
    """

    crease: "Crease"
    identifier: str
    lift: Lift
    targets: tuple[Target | None, ...]
    clips: "tuple[Followed, ...]"
    left: tuple[Left, ...] = ()
    clip: str | None = None

    @property
    def from_skin(self) -> bool:
        """Weights do not follow from the distance of anchors."""
        return False

    @property
    def columns(self) -> Ints:
        """The shapes that have a target."""
        return _columns(self.targets)

    def shape_weights(self, sampled: Floats) -> Floats:
        """(frames, shapes) weights of the shapes from those of the crease's."""
        return self.lift.weights(sampled)

    def written(self, weights: Floats) -> Floats:
        """The columns of (frames, shapes) weights that have a target."""
        written: Floats = weights[:, self.columns]
        return written


AnySet: TypeAlias = TargetSet | CreaseSet


def of_tools(target_sets: Iterable[AnySet]) -> list[TargetSet]:
    """The sets of tools alone, which stand before those of folds."""
    return [each for each in target_sets if isinstance(each, TargetSet)]


def of_folds(target_sets: Iterable[AnySet]) -> list[CreaseSet]:
    """The sets of folds alone."""
    return [each for each in target_sets if isinstance(each, CreaseSet)]


def _columns(targets: Sequence[Target | None]) -> Ints:
    return np.array([index for index, target in enumerate(targets) if target is not None], np.intp)


def named_targets(identifier: str, shapes: Iterable[Shape | None]) -> tuple[Target | None, ...]:
    """Targets `wrinkle_TOOL_1`, `wrinkle_TOOL_2` … for the shapes that there are, by a tool's identifier."""
    targets: list[Target | None] = []
    number = 0
    for shape in shapes:
        number += shape is not None
        targets.append(None if shape is None else Target(f"wrinkle_{identifier}_{number}", shape))
    return tuple(targets)


def targets_of(target_sets: Iterable[AnySet]) -> tuple[Target, ...]:
    """The morph targets of all tools and folds, in order."""
    return tuple(target for each in target_sets for target in each.targets if target is not None)
