"""Goldens: folds are to the solver as they were, before it takes a step, whose rounding differs between processors."""

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("ipctk", reason="needs the extra `contact`")

from kit.folds import FOLDS
from kit.golden import Golden, summed
from wrinklecli.baking.job import BakeOptions, read_job
from wrinklecli.baking.plan import plan_meshes
from wrinklecli.effects.contact.layer import ContactLayer
from wrinklecli.effects.contact.system import with_crossings


@pytest.mark.parametrize("kind", ["elbow", "groin"])
def test_a_fold_is_seen_by_the_solver_as_before(kind: str, tmp_path: Path, golden: Golden) -> None:
    """Its vertices, what may move and collide, gaps, pressures, and how it resists pushes at some vertices."""
    asset, tools = FOLDS[kind]().write(tmp_path, contact="resolve")
    job = read_job(str(asset), [str(tools)], BakeOptions())
    (plan,), (clip,) = plan_meshes(job), job.clips
    layer = plan.layer(ContactLayer)
    assert layer is not None
    described = []
    for fold in (with_crossings(each, []) for each in layer.folds):
        tissue, times = fold.tissue, np.linspace(clip.start, clip.end, 7)
        forces = np.sin(np.arange(3.0 * tissue.free.sum())).reshape(-1, 3)
        posed = np.array([places for places, _ in fold.poses(clip, times)])
        arrays = {
            "rest": tissue.rest, "triangles": tissue.triangles, "colliding": tissue.colliding, "free": tissue.free,
            "own": tissue.own, "apart": tissue.apart, "crossed": fold.crossed, "border": fold.border,
            "raised": fold.raised, "pressures": tissue.pressures, "moves": tissue.moves_under(forces[None]),
            "strides": fold.strides(clip, times), "posed": posed,
            "crossing": fold.crossings.vertices_at(posed[3], fold.own),
        }  # fmt: skip
        sweeps = [[len(times), times[-1]] for _, times in fold.hinge.sweeps]
        sums = {name: summed(np.asarray(each)) for name, each in arrays.items()}
        described.append({**sums, "gaps": tissue.gaps, "radius": fold.radius, "sweeps": sweeps})
    golden(described, f"fold_{kind}.json")
