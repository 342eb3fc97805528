"""The drive of a field of wrinkles: some joints' turns, each with weights of its own targets."""

from collections.abc import Mapping, Sequence
from dataclasses import field, replace
from functools import partial
from itertools import compress
from typing import NamedTuple

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.character.rig import Rig
from wrinklecli.drive.angle import Angles, JointAngle, angles_of, read_angle
from wrinklecli.drive.stored import Json, read_numbers, read_strengths, strengths_json
from wrinklecli.drive.table import BaseDrive, Table, Weights, read_table
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Bools, Floats


class TurnsSeen(NamedTuple):
    """The measurements of several joints at the same times."""

    angles: tuple[Angles, ...]

    @property
    def active(self) -> Bools:
        """(frames,) True: joints always have angles."""
        return self.angles[0].active


def squares_of(parts: Sequence[Floats] | Floats) -> Floats:
    """(…,) sums of the squares of (turns, …) parts, less those of parts below 0."""
    return np.asarray(np.sum([each * np.abs(each) for each in parts], axis=0))


def together(parts: Sequence[Floats]) -> Floats:
    """(…,) weights by (turns, …) parts: the roots of the sums of their squares with signs, at most 1.

    Lengths that turns take from cloth add up, those that they give it count against them, and heights go with the root.
    """
    return np.asarray(np.sqrt(np.clip(squares_of(parts), 0.0, 1.0)))


@dataclass(frozen=True, slots=True, eq=False)
class TurnDrive(BaseDrive):
    """Turns of joints that give the weights of morph targets.

    Attributes:
        name: The field's name.
        turns: Each joint's angle, and the parts of weights of all targets against it, which act `together`.
        targets: Names of the targets.
        strengths: By clip, factors on the weights.
        strength: The factor in all other clips.
    """

    name: str
    turns: tuple[tuple[JointAngle, Table], ...]
    targets: tuple[str, ...]
    strengths: Mapping[str, float] = field(default_factory=dict)
    strength: float = 1.0

    @property
    def nodes(self) -> frozenset[int]:
        """The nodes whose matrices it needs."""
        return frozenset[int]().union(*(signal.nodes for signal, _ in self.turns))

    def reader(self, rig: Rig, clip: Clip | None) -> "partial[TurnsSeen]":
        """A function from (frames,) seconds of a clip, and rows known there as in `node_rows`, to measurements."""
        return partial(self._read, rig, clip)

    def _read(self, rig: Rig, clip: Clip | None, times: Floats, known: dict[int, Floats]) -> TurnsSeen:
        return TurnsSeen(tuple(angles_of([signal for signal, _ in self.turns], rig, clip, times, known)))

    def weights(self, clip: Clip | None, reading: TurnsSeen, _response: Weights | None = None) -> Floats:
        """(frames, targets) weights at measurements in a clip."""
        strength = self.strength if clip is None else self.strengths.get(clip.name, self.strength)
        tables = [table.weights(seen) for (_, table), seen in zip(self.turns, reading.angles, strict=True)]
        return strength * together(tables)

    def why_flat(self, _rig: Rig, clip: Clip, _times: Floats) -> str:
        """Why a field makes no wrinkle in a clip."""
        if self.strengths.get(clip.name, self.strength) == 0:
            return f"{self.name} stays flat, as its strength is 0 in this clip"
        return f"{self.name} stays flat, as none of its joints turns far enough"

    def of_targets(self, kept: Bools) -> "TurnDrive":
        """The drive of some of its (targets,) alone; turns without any are left out."""
        turns = tuple(
            (signal, replace(table, table=table.table[:, kept]))
            for signal, table in self.turns
            if table.table[:, kept].any()
        )
        return replace(self, turns=turns, targets=tuple(compress(self.targets, kept)))

    def weaker(self, factor: float) -> "TurnDrive":
        """The drive with weights divided by a factor."""
        strengths = {clip: each / factor for clip, each in self.strengths.items()}
        return replace(self, strengths=strengths, strength=self.strength / factor)

    def to_json(self, names: Sequence[str], _morph_names: Sequence[str]) -> Json:
        """The drive as extras store it, by the names of all nodes."""
        return {
            "name": self.name,
            "turns": [_turn_json(signal, table, names) for signal, table in self.turns],
            **strengths_json(self.strengths, self.strength),
            "targets": list(self.targets),
        }


def _turn_json(signal: JointAngle, table: Table, names: Sequence[str]) -> Json:
    """A turn as extras store it, with the targets that it raises alone."""
    acts = table.table.any(axis=0)
    own = np.flatnonzero(acts | ~acts.any())
    return {**signal.to_json(names), **replace(table, table=table.table[:, own]).to_json(), "raises": own.tolist()}


def read_turned(data: Json, nodes: Mapping[str, int]) -> TurnDrive:
    """Read the drive in extras, from nodes by name.

    Raises:
        KeyError, TypeError, ValueError: The extras are not what `bake` writes.
    """
    turns, targets = [], tuple(str(name) for name in data["targets"])
    for each in data["turns"]:
        own = read_numbers(each["raises"], -1)
        table = read_table(each, len(own))
        if not isinstance(table, Table) or table.by != "angles" or table.paths:
            raise ValueError
        if not np.isin(own, np.arange(len(targets))).all() or len(np.unique(own)) < len(own):
            raise ValueError
        whole = np.zeros((len(table.rows), len(targets)))
        whole[:, own.astype(np.intp)] = table.table
        turns.append((read_angle(each, nodes), replace(table, table=whole)))
    if not turns:
        raise ValueError
    return TurnDrive(str(data["name"]), tuple(turns), targets, *read_strengths(data))
