"""Meshes are refined as finely as suggested tools need, and tools that no mesh shows are told."""

from pathlib import Path
from typing import Any

import pytest

from kit.sheet import sheet
from kit.suggested import squeezed
from wrinklecli.character.clip import read_clips
from wrinklecli.gltf.document import read_document
from wrinklecli.review.suggest.fitted_tools import Suggestion
from wrinklecli.review.suggest.trial import Trial, TriedAsset
from wrinklecli.review.suggest.worth import worthwhile
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


@pytest.mark.slow
def test_a_fold_much_shorter_than_its_triangles_is_left_out(tmp_path: Path) -> None:
    document = read_document(sheet(tmp_path / "a.glb", [(-0.5, 0.0), (0.0, 0.0), (0.5, 0.0)], smooth=True))
    both = [suggestion(0.4, 0.3, 0.0), suggestion(0.02, 0.05, 0.0, "short")]
    tried = TriedAsset(document, read_clips(document))
    found = worthwhile(tried, both, FACETED, count=2, everything=True)
    assert [each.tool.name for each in found.tools] == ["fold"]
    assert [(each.name, each.reason) for each in found.dropped] == [("short", "coarse")]
