"""The effect of a fold whose contact is resolved: its targets, their weights in clips, and its drive."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, field, replace

import numpy as np

from wrinklecli.drive.drive import Drive, Rows
from wrinklecli.drive.swing import nonnegative
from wrinklecli.effects.contact.crease import Crease, Followed, PlayerError
from wrinklecli.effects.contact.fitting import MOST_WEIGHT
from wrinklecli.effects.contact.hinge import Hinge
from wrinklecli.effects.contact.remaining import Remaining
from wrinklecli.effects.effect import Effect, MeshPlan, Seen, Target
from wrinklecli.effects.wrinkle.effect import tool_drive
from wrinklecli.errors import counted, listed
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.shape import Json
from wrinklecli.numeric.arrays import Floats, significant

SECTION = "folds"
"""The key of extras and report under which folds stand."""

MOST_APART = 0.1
"""Error of what players look up, relative to contact's greatest move, from which another joint is looked for and a line
says so. Where one joint folds the surface, it is 0.03 to 0.05, and hidden in the fold."""


def contact_effect(
    words: "ContactWords", identifier: str, columns: Sequence[int], targets: tuple[Target, ...]
) -> Effect:
    """The effect of a fold, of whose shapes with weights in [0, 1] the numbers `columns` have targets.

    In clips that were solved weights are rows. In others a drive looks them up by the joint's angle, or by the tool's
    shortening if no joint bends the fold. They are 0 where they would be further off than none.
    """
    crease, names, signal = words.crease, tuple(each.name for each in targets), words.crease.signal

    def written(signed: Floats) -> Floats:
        return nonnegative(signed / MOST_WEIGHT)[:, list(columns)]

    response = crease.response.mapped(written)
    drive = Drive("", signal, names, response) if signal else tool_drive(crease.fold.patches[0], names, response)
    silent = {name: 0.0 for name, error in words.player_errors.items() if error.silent}
    rows = {name: Rows(each.times, written(each.weights)) for name, each in words.followed.items()}
    drive = replace(drive, strengths={**drive.strengths, **silent}, rows=rows)
    return Effect(identifier, SECTION, identifier, targets, drive, words)


@dataclass(frozen=True, slots=True)
class ContactWords:
    """The words of a fold with contact about itself.

    Attributes:
        crease: The fold with the shapes that resolve contact.
        tools: Names of all tools over the fold.
        followed: By the names of clips, the signed weights of the shapes.
        remaining: The intersections that remain in clips.
        player_errors: How far players that look contact up are off in each clip, by its name.
        heights: By the names of clips, the parts of their height that the tools keep over time; 1 in other clips.
    """

    crease: Crease
    tools: tuple[str, ...]
    followed: Mapping[str, Followed]
    remaining: tuple[Remaining, ...]
    player_errors: Mapping[str, PlayerError]
    heights: Mapping[str, Rows] = field(default_factory=dict)
    remedy: str = "`contact: off`"

    @property
    def left_out(self) -> str | None:
        """The warning that the fold has no contact at all, and why; None if it has some."""
        return None if len(self.crease.shapes) else self._line(self._clip_words())

    def summary(self, effects: int, targets: int) -> str:
        """Count the targets of contact, and the folds."""
        return f"{targets} of contact in {counted(effects, 'fold')}"

    def describe(self, _plan: MeshPlan, targets: tuple[str, ...]) -> Json:
        """The fold's entry in the report; lengths are scene units."""
        crease, hinge, swept = self.crease, self.crease.fold.hinge, self.crease.swept
        # Clips of equal motion share their solution.
        followed = list({id(each): each for each in self.followed.values()}.values())
        return {
            "tools": list(self.tools),
            "clip": None,
            "joint": crease.fold.joint,
            "degrees": [round(float(np.degrees(end)), 1) for end in (hinge.least, hinge.most)]
            if isinstance(hinge, Hinge)
            else None,
            "moved_vertices": len(crease.fold.free_vertices) if len(crease.shapes) else 0,
            "largest_move": significant(crease.largest),
            "volume_lost": significant(max((each.lost for each in swept), default=0.0)),
            "poses": sum(int(np.count_nonzero(each.weights.any(axis=1))) for each in swept),
            "fitted_to_clips": crease.fold.per_clip,
            "unsettled_poses": sum(len(each.faults) for each in swept),
            "error": significant(max((each.error for each in swept), default=0.0)),
            "unsettled_frames": sum(len(each.faults) for each in followed),
            "crossing_frames": sum(len(each.crossing) for each in followed),
            "left": [
                asdict(each) | {key: significant(getattr(each, key)) for key in ("time", "begin", "end", "height")}
                for each in self.remaining
            ],
            "clip_error": significant(max((each.error for each in followed), default=0.0)),
            "player_error": significant(max((each.share for each in self.player_errors.values()), default=0.0)),
            "targets": list(targets),
        }

    def describe_clip(self, _seen: Seen) -> None:
        """Nothing."""
        return

    def warnings(self, _plan: MeshPlan, clips: Sequence[Seen], _up: str) -> list[str]:
        """A line about contact that is not wholly resolved, for the worst clip in each respect."""
        parts = self._clip_words()
        acting = [(motion.clip, motion.times[weights.any(axis=1)]) for motion, _, weights in clips]
        crossing = {node for clip, times in acting for node in self.crease.fold.meshes_crossing_themselves(clip, times)}
        if crossing:
            nodes = listed(sorted(crossing))
            parts.append(f"{nodes} goes through itself there: contact leaves that, and what has no room beneath")
        worst = max(self.player_errors, key=lambda clip: self.player_errors[clip].share, default=None)
        if worst is not None and self.player_errors[worst].share > MOST_APART:
            error = self.player_errors[worst]
            what = (
                "show none of it" if error.silent else f"are up to {100 * error.share:.0f} % of its greatest move off"
            )
            parts.append(
                f"contact depends on more than the turns of two joints in {worst!r}, as where others fold the"
                " surface or skin slides: the baked clip is right, but `track` and players that compute contact"
                f" {what}, by {error.length:.2g}"
            )
        return [self._line(parts)] if parts else []

    def _line(self, parts: Sequence[str]) -> str:
        return f"{', '.join(self.tools)}: {'; '.join(parts)}"

    def _clip_words(self) -> list[str]:
        """Words about the worst clip that is not wholly resolved: for its poses with a fault, and for what crosses."""
        held, left = ([each for each in self.remaining if getattr(each, key)] for key in ("reason", "resolved"))
        parts = [self._held_words(max(held, key=lambda each: each.poses)) + _and_more(held)] if held else []
        parts += [self._remaining_words(max(left, key=lambda each: each.resolved)) + _and_more(left)] if left else []
        return parts

    def _held_words(self, remaining: Remaining) -> str:
        """Words about the poses of a clip in which contact has a fault, and what is shown there."""
        when = _span(f"{remaining.begin:.3g}", f"{remaining.end:.3g}", " s")
        where = ""
        if remaining.degrees is not None:
            turns = _span(f"{remaining.degrees[0]:.0f}", f"{remaining.degrees[1]:.0f}", "°")
            where = f", where {self.crease.fold.joint} turns by {turns}"
        shown = "it fades out there" if remaining.faded else "it keeps its last good state there"
        if not len(self.crease.shapes):
            shown = "it is left out of this fold"
        if remaining.height < 1.0:
            shown += (
                f", and wrinkles are lowered to {100 * remaining.height:.0f} %, to cross no more than the skin does"
            )
        poses = counted(remaining.poses, "pose")
        return f"contact {remaining.reason} in {remaining.clip!r} at {when}{where} ({poses}): {shown}"

    def _remaining_words(self, remaining: Remaining) -> str:
        """Words about the intersections that contact leaves in a clip, with a hint at what may help."""
        counts = (
            f"{counted(remaining.resolved, 'edge passes', 'edges pass')} through triangles at {remaining.time:.3g} s"
        )
        hint = "fewer or lower bumps leave more room"
        if not self.crease.fold.tissue.colliding.any():
            hint = "the surface is degenerate, or touches itself everywhere at rest: mend the mesh there"
        elif not self.crease.fold.per_clip:
            hint = "without `per_clip: false` the targets follow it better"
        return (
            f"contact leaves crossings in {remaining.clip!r}: {counts}, {remaining.before:,} on the skin alone"
            f" ({counted(remaining.frames, 'frame')} in all), and {hint}"
        )


def _and_more(remaining: Sequence[Remaining]) -> str:
    """Words about the other clips."""
    return f"; likewise in {counted(len(remaining) - 1, 'other clip')}" if len(remaining) > 1 else ""


def _span(least: str, greatest: str, unit: str) -> str:
    """Two numbers with a unit in words; one if they are alike."""
    return f"{least}{unit}" if least == greatest else f"{least} to {greatest}{unit}"
