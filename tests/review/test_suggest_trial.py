"""Meshes are refined as finely as suggested tools need, and tools that no mesh shows are told."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from kit.limb import limb_asset
from kit.sheet import sheet
from kit.suggested import squeezed
from wrinklecli.character.clip import read_clips
from wrinklecli.character.scene import read_scene
from wrinklecli.errors import AssetError
from wrinklecli.gltf.document import read_document
from wrinklecli.review.suggest.fitted_tools import Suggestion
from wrinklecli.review.suggest.trial import Trial, TriedAsset
from wrinklecli.review.suggest.worth import Judge
from wrinklecli.surface.refine import Refinement, refine
from wrinklecli.tools.records import Length, RefinementSettings, WrinkleTool

FACETED = RefinementSettings(scheme="midpoint")


def suggestion(half: float, width: float, top: float, name: str = "fold") -> Suggestion:
    """A tool about the middle of a sheet."""
    tool = WrinkleTool(name=name, origin=(-half, top, 0.0), target=(half, 0.0, 0.0), width=Length(width))
    return squeezed(tool, 2.0 * half)


def test_a_mesh_that_needs_more_levels_than_usual_gets_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    document = read_document(sheet(tmp_path / "a.glb", [(-0.5, 0.0), (0.0, 0.0), (0.5, 0.0)]))
    levels: list[int] = []

    def counted(*mesh: Any, settings: RefinementSettings, **named: Any) -> Refinement:
        levels.append(settings.max_levels)
        return refine(*mesh, settings=settings, **named)

    monkeypatch.setattr("wrinklecli.effects.plan.refine", counted)
    tried = TriedAsset(document, read_clips(document))
    (trial,) = Trial.of(tried, suggestion(0.08, 0.2, 0.0))
    refinement, placed = trial.placed(FACETED)
    assert list(placed) == ["fold"]
    assert not placed["fold"].coarse
    assert refinement.max_levels > FACETED.max_levels
    assert levels == [4, 6]


def test_a_malformed_mesh_is_left_out_and_others_cover_what_they_come_near(tmp_path: Path) -> None:
    asset = limb_asset(rings=7, sides=6)
    indices = asset.gltf["meshes"][0]["primitives"][0]["indices"]
    mesh = asset.append("meshes", {"primitives": [{"attributes": {"POSITION": indices}}]})
    asset.gltf["scenes"][0]["nodes"].append(asset.append("nodes", {"mesh": mesh}))
    document = read_document(asset.write(tmp_path / "limb.glb"))
    with pytest.raises(AssetError):
        read_scene(document)
    (clip,), (limb,) = read_clips(document), read_scene(document, leave_out_malformed=True)
    layers, here = TriedAsset(document, [clip]).layers, np.array([1.0, 1.0, 1.0])
    for time in (0.0, 1.0):
        places = limb.positions_at(clip, time)
        middle = places.mean(axis=0)
        (found,) = layers.near(clip, time, middle - here, middle + here, node=-1)
        assert found == pytest.approx(places[limb.triangles])
        for beside in 4.0 * np.concatenate([np.eye(3), -np.eye(3)]):
            assert not [*layers.near(clip, time, middle + beside - here, middle + beside + here, node=-1)]
        assert not [*layers.near(clip, time, middle - here, middle + here, node=limb.rig.node)]


@pytest.mark.slow
def test_a_fold_much_shorter_than_its_triangles_is_left_out(tmp_path: Path) -> None:
    document = read_document(sheet(tmp_path / "a.glb", [(-0.5, 0.0), (0.0, 0.0), (0.5, 0.0)], smooth=True))
    both = [suggestion(0.4, 0.3, 0.0), suggestion(0.02, 0.05, 0.0, "short")]
    tried = TriedAsset(document, read_clips(document))
    found = Judge(tried, everything=True).worthwhile(both, FACETED, count=2)
    assert [each.tool.name for each in found.kept] == ["fold"]
    assert [(each.name, each.reason) for each in found.dropped] == [("short", "coarse")]
