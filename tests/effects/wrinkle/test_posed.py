"""Displacements of vertices that are projected anew in each frame."""

from typing import Any

import numpy as np
import pytest

from kit.carried import MORE, ROOTS, carry_patch, moved, placed, scattered
from kit.limb import limb_asset, tool
from kit.prepared import prepare


@pytest.mark.quick(1)
@pytest.mark.parametrize("root", ROOTS[:4], ids=str)
@pytest.mark.parametrize("profile", ["smooth", "polyline"])
def test_projected_anew_at_rest_is_carried_by_the_skin(root: Any, profile: str) -> None:
    """An unrefined mesh under a similarity, for which area-weighted normals are equal before and after skinning."""
    results = []
    for attachment in ("skin", "patch"):
        prepared = prepare(
            limb_asset(rings=25, sides=24, root=root),
            placed(root, rest_length=MORE, attachment=attachment, profile=profile),
            refinement={"max_levels": 0},
        )
        carried, fine = carry_patch(prepared)
        results.append(scattered(carried, fine, moved(prepared, carried, fine, [0.0])))
    assert np.abs(results[0]).max() > 0.01, "the case is one"
    assert results[1] == pytest.approx(results[0], abs=1e-12)


def test_a_path_laid_anew_at_rest_is_carried_by_the_skin_and_bends_with_it() -> None:
    points = [[-0.4, 0.25, 0.0], [-0.1, 0.24, 0.07], [0.1, 0.24, 0.07], [0.4, 0.25, 0.0]]
    keys = {"name": "fold", "path": points, "width": 0.3, "bumps": 3, "rest_length": "110%"}
    results = []
    for attachment in ("skin", "patch"):
        prepared = prepare(
            limb_asset(rings=25, sides=24), {**keys, "attachment": attachment}, refinement={"max_levels": 0}
        )
        carried, fine = carry_patch(prepared)
        results.append(scattered(carried, fine, moved(prepared, carried, fine, [0.0, 0.1])))
    carried_by_skin, laid_anew = results
    assert np.abs(carried_by_skin).max() > 0.01, "the case is one"
    assert laid_anew[0] == pytest.approx(carried_by_skin[0], abs=1e-9)
    # Bent by 10 degrees, the wrinkle is about there, and as high.
    assert laid_anew[1] == pytest.approx(carried_by_skin[1], abs=0.2 * np.abs(carried_by_skin[1]).max())
    assert not np.allclose(laid_anew[1], carried_by_skin[1], atol=1e-4)


def test_projected_anew_a_pinned_vertex_stays_too() -> None:
    prepared = prepare(limb_asset(rings=15, sides=12), tool(rest_length=MORE, attachment="patch"))
    pinned = np.zeros(len(prepared.surface.positions), bool)
    free, fine = carry_patch(prepared)
    pinned[free.vertices[free.vertices < len(pinned)]] = True
    held, _ = carry_patch(prepared, pinned=pinned)
    every = scattered(held, fine, moved(prepared, held, fine, [0.0, 0.5]))
    assert every.any()
    assert not every[:, : len(pinned)][:, pinned].any()


@pytest.mark.quick(0, 1)
@pytest.mark.parametrize("strategy", ["everywhere", "origin"])
def test_projected_anew_a_frame_depends_on_no_other(strategy: str, monkeypatch: pytest.MonkeyPatch) -> None:
    asset = limb_asset(rings=9, sides=8, morphs=1, morph_clip="LINEAR")
    prepared = prepare(asset, tool(attachment="patch", strategy=strategy))
    carried, fine = carry_patch(prepared)
    times = np.linspace(0.0, 2.0, 12)
    together = moved(prepared, carried, fine, times)
    assert together.any()
    alone = np.concatenate([moved(prepared, carried, fine, [time]) for time in times])
    assert alone == pytest.approx(together, abs=1e-12)
    monkeypatch.setattr("wrinklecli.numeric.portions.AT_ONCE", 1)
    assert moved(prepared, carried, fine, times) == pytest.approx(together, abs=1e-12)
