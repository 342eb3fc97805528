"""What may be asked of any effect has the same meaning for muscles, flesh, touches, wrinkles and fields."""

import json
from collections.abc import Callable
from functools import cache

import numpy as np
import pytest

from kit.asset import Asset, Json
from kit.bakes import place
from kit.fields import field
from kit.flesh import body, region
from kit.limb import limb_asset, tool
from kit.muscles import ANGLE, muscle
from kit.touch import plate, touch
from wrinklecli.baking.job import BakeOptions, Job, read_job
from wrinklecli.baking.plan import plan_meshes
from wrinklecli.character.clip import KEY_GAP
from wrinklecli.character.pose import blend, joint_matrices, morph_weights, transform
from wrinklecli.choices import EFFECTS
from wrinklecli.effects.effect import MeshPlan, Part, SamplingOptions
from wrinklecli.effects.plan import attach_one, kind_of, patch_parts, sketch, skin_parts
from wrinklecli.effects.sampling import play_parts, reader, sample_effects, seen_at
from wrinklecli.numeric.guard import log_progress
from wrinklecli.surface.ground import read_ground

ASSETS: dict[str, tuple[Callable[[], Asset], Json]] = {
    "muscles": (lambda: limb_asset(rings=41, sides=24, angle=ANGLE), muscle()),
    "flesh": (body, region()),
    "touches": (lambda: plate(size=0.36, cells=36), touch()),
    "tools": (lambda: limb_asset(rings=21, sides=16), tool(bumps=2)),
    # It bends so little that no fold is lowered where the limb meets itself.
    "fields": (lambda: limb_asset(rings=21, sides=16, angle=30), field()),
}
EACH = pytest.mark.parametrize("section", ASSETS)
WITH_REGIONS = pytest.mark.parametrize("section", [key for key in ASSETS if key != "flesh"])
# A field has no middle.
WITH_PATHS = pytest.mark.parametrize("section", [key for key in ASSETS if key not in ("flesh", "fields")])


@cache
def planned(section: str) -> tuple[Job, MeshPlan]:
    made, entry = ASSETS[section]
    path = place(made())
    file = path.with_suffix(".yaml")
    file.write_text(json.dumps({"version": 1, section: [entry]}))
    job = read_job(path, file, BakeOptions(max_levels=2))
    (plan,) = plan_meshes(job)
    return job, plan


def part_of(section: str) -> Part:
    (layer,) = planned(section)[1].layers
    (part,) = layer.parts
    assert layer.section == section
    return part


def test_each_kind_has_its_own_section_and_says_if_it_can_be_baked_here() -> None:
    assert {*EFFECTS} == {*ASSETS, "folds"}
    assert all(kind_of(section).is_installed for section in ASSETS)


@pytest.mark.quick(1)
@EACH
def test_one_tool_is_attached_as_among_all(section: str) -> None:
    job, _ = planned(section)
    (effect,), part = job.settings.effects, part_of(section)
    alone = attach_one(effect, read_ground(job.document, 0, [effect], job.settings, job.every_clip), job.settings)
    assert alone.tool == part.attached.tool
    assert alone.greatest_height == pytest.approx(part.attached.greatest_height, rel=1e-12)
    assert alone.span == part.attached.span > 0


@pytest.mark.quick(1)
@EACH
def test_only_what_moves_the_skin_and_not_the_rig_is_on_the_skin(section: str) -> None:
    _, plan = planned(section)
    assert len(skin_parts(plan)) == (section in ("tools", "fields"))
    assert (part_of(section).attached.moves is None) == (section in ("tools", "fields"))
    assert len(patch_parts(plan)) == (section == "tools")


@EACH
def test_the_share_of_a_vertex_is_that_of_its_greatest_move(section: str) -> None:
    (_, plan), part = planned(section), part_of(section)
    assert (np.diff(part.vertices) > 0).all()
    assert len(part.shares) == len(part.us) == len(part.vertices)
    assert part.shares.max() == 1.0
    assert (part.shares > 0).all()
    clip = planned(section)[0].clips[0]
    moved = part.displacements(plan.fine, plan.rig, clip, np.linspace(clip.start, clip.end, 9))
    assert moved.shape == (9, len(part.vertices), 3)
    # No vertex moves that has hardly any share in the effect.
    sizes = np.sqrt((moved**2).sum(axis=2)).max(axis=0)
    assert sizes.max() > 0
    assert sizes[part.shares < 1e-3].max(initial=0.0) < 1e-2 * sizes.max()


@EACH
def test_numbers_that_are_known_give_the_same_displacements(section: str) -> None:
    (job, plan), part = planned(section), part_of(section)
    clip = job.clips[0]
    times = np.linspace(clip.start, clip.end, 7)
    numbers = reader(part, plan.rig, clip)(times)
    assert len(numbers) == len(times)
    moved = part.displacements(plan.fine, plan.rig, clip, times)
    assert np.abs(part.displacements(plan.fine, plan.rig, clip, times, numbers) - moved).max() == 0.0
    assert np.abs(part.displacements(plan.fine, plan.rig, clip, times[3:4], numbers[3:4])[0] - moved[3]).max() < 1e-12


@EACH
def test_the_greatest_height_in_a_clip_is_at_the_time_that_is_told(section: str) -> None:
    (job, plan), part = planned(section), part_of(section)
    clip = job.clips[0]
    times = np.linspace(clip.start, clip.end, 21)
    seen = seen_at(part, plan.rig, clip, times)
    told = part.facts_in(plan, seen)
    assert told["name"] == clip.name
    assert part.facts(plan, "y")["name"] == part.attached.tool.name
    heights = part.heights(plan.fine, clip, part.numbers(clip, seen.reading))
    (at,) = np.flatnonzero(np.abs(times - told["time"]) < 1e-6)
    assert heights[at] == pytest.approx(heights.max(), rel=1e-6)
    # What features and folds leave of a wrinkle is lower than its curve.
    assert 0 < told["height"] <= 1.0001 * heights.max()


@EACH
def test_a_clip_is_played_at_times_between_which_moves_are_straight(section: str) -> None:
    (job, plan), part = planned(section), part_of(section)
    ((seen,),) = play_parts(plan, [part], job.clips, SamplingOptions(30.0, "morph", job.document.memory, log_progress))
    times = seen.motion.times
    assert (np.diff(times) > 0).all()
    assert part.strengths(seen).max() > 0
    between = (times[1:] + times[:-1]) / 2.0
    true = seen_at(part, plan.rig, job.clips[0], between).weights
    off = np.abs(true - (seen.weights[1:] + seen.weights[:-1]) / 2.0) * part.sizes(plan.fine)
    # Nobody sees what is between keys that are closer together.
    assert off[np.diff(times) > 2.0 * KEY_GAP].max() < plan.max_error


@pytest.mark.quick(1)
@EACH
def test_a_part_says_of_itself_what_its_effect_says(section: str) -> None:
    (job, plan), part = planned(section), part_of(section)
    effects, motions = sample_effects(
        plan, job.clips, SamplingOptions(30.0, "morph", job.document.memory, log_progress)
    )
    (effect,), seen = effects, [motion.seen(0) for motion in motions]
    words = part.words(plan)
    assert words.describe(plan, effect.target_names) == effect.words.describe(plan, effect.target_names)
    assert words.warnings(plan, seen, "y") == effect.words.warnings(plan, seen, "y")


def test_a_body_moves_as_its_rig_says() -> None:
    """The rig has the targets of a muscle: its part adds nothing to them, and tells what they add."""
    (job, plan), part = planned("muscles"), part_of("muscles")
    clip, times = job.clips[0], np.array([0.7])
    fine = plan.fine
    blended = blend(
        fine.dense_weights(np.arange(len(fine.positions)), len(plan.rig.joints)), joint_matrices(plan.rig, clip, times)
    )
    weights = morph_weights(plan.rig, clip, times)[0]
    before = transform(blended, fine.positions)[0]
    after = transform(blended, fine.positions + np.tensordot(weights, fine.morph_deltas, axes=1))[0]
    moved = np.zeros_like(fine.positions)
    moved[part.vertices] = part.displacements(fine, plan.rig, clip, times)[0]
    assert np.abs(after - before).max() > 1e-3
    assert np.abs(transform(blended, fine.positions + moved)[0] - after).max() < 1e-12


@WITH_PATHS
def test_the_path_of_a_region_runs_from_u_0_to_u_1_on_its_middle(section: str) -> None:
    for found in part_of(section).attached.regions:
        path = found.at_rest.path
        u, v = found.at_rest.coordinates(path.middle)
        assert (float(u), float(v)) == pytest.approx((0.5, 0.0), abs=1e-6)
        # A bulge is round, and its path touches it in the middle.
        near = path.middle + 0.01 * found.span * path.along
        assert float(found.at_rest.coordinates(near)[0]) == pytest.approx(0.51, abs=1e-3)
        assert np.linalg.norm(path.normal) == pytest.approx(1.0)
        assert abs(float(path.normal @ path.along)) < 1e-9


@WITH_REGIONS
def test_only_a_region_with_bumps_has_crests(section: str) -> None:
    found = part_of(section).attached.regions[0]
    u, v = np.linspace(0.0, 1.0, 300).reshape(100, 3), np.zeros((100, 3))
    phases = found.crests(u, v)
    assert phases.shape == u.shape
    if section == "tools":
        shown = phases[np.isfinite(phases)]
        assert (shown.min(), shown.max()) == pytest.approx((0.0, 2.0), abs=1e-6)
        assert (np.diff(shown) >= 0).all()
    else:
        assert np.isnan(phases).all()


def test_only_a_touch_is_dragged_and_it_says_when_skin_folds() -> None:
    assert [section for section in ASSETS if part_of(section).attached.drag is not None] == ["touches"]
    drag = part_of("touches").attached.drag
    assert drag is not None
    assert drag.reach > drag.drive.pad
    assert drag.folding > 0


@EACH
def test_a_tissue_takes_a_part_of_the_shortening_only_where_bumps_are_limited(section: str) -> None:
    attached = part_of(section).attached
    lengths = np.full(3, 1.0 if attached.segment is None else attached.segment.rest_length.constant)
    shortened = [(np.array([1.0, 0.6, 0.3]) * lengths, lengths)]
    fitting = attached.fitting_compressible(shortened, 1e-3 * attached.span)
    assert (fitting > 0) == (section == "tools")
    assert attached.fitting_compressible([(lengths, lengths)]) == 0.0


@EACH
def test_a_tool_that_is_drawn_is_carried_at_once_or_comes_with_the_rig(section: str) -> None:
    (_, plan), part = planned(section), part_of(section)
    pinned = np.zeros(len(plan.fine.surface.positions), np.bool_)
    made = sketch(part.attached, part.region, plan.fine, pinned)
    assert (made is not None) == (section in ("tools", "fields"))
    assert made is None or np.array_equal(part.vertices, made.vertices)
