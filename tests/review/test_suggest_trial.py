"""Suggested tools that reach across a fold of the refined mesh become narrower if that helps."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from kit.sheet import line, sheet
from kit.suggested import squeezed
from wrinklecli.character.clip import read_clips
from wrinklecli.gltf.document import read_document
from wrinklecli.review.suggest.fitted_tools import Suggestion
from wrinklecli.review.suggest.trial import TriedAsset, try_on_refined_meshes
from wrinklecli.surface.refine import Refinement, refine
from wrinklecli.tools.records import Length, RefinementSettings, WrinkleTool

FACETED = RefinementSettings(scheme="midpoint")
FLAT = [line(-0.5, 0.5)]
# Forward on top, back below it, forward again below that.
FOLDED = [line(-0.5, 0.1, 0.1), line(0.1, -0.1, 0.05), line(-0.1, 0.5, 0.0)]


def suggestion(half: float, width: float, top: float, name: str = "fold") -> Suggestion:
    """A tool about the middle of a sheet."""
    tool = WrinkleTool(name=name, origin=(-half, top, 0.0), target=(half, 0.0, 0.0), width=Length(width))
    return squeezed(tool, 2.0 * half)


@pytest.mark.parametrize(
    ("profile", "half", "width", "kept"),
    [(FLAT, 0.4, 0.3, 0.3), (FLAT, 0.03, 0.7, 0.52), (FOLDED, 0.4, 0.3, 0.3)],
    ids=["well", "narrower", "no help"],
)
def test_a_tool_that_check_warns_of_for_its_place_is_narrower_where_that_helps(
    profile: list[np.ndarray], half: float, width: float, kept: float, tmp_path: Path
) -> None:
    document = read_document(sheet(tmp_path / "a.glb", np.concatenate(profile)))
    made = suggestion(half, width, 0.1 if profile is FOLDED else 0.0)
    found = try_on_refined_meshes(TriedAsset(document, read_clips(document)), [made], FACETED)
    assert [each.tool.width.value for each in found.tools] == [kept]
    assert not found.notes


def test_a_mesh_that_needs_more_levels_than_usual_is_refined_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    document = read_document(sheet(tmp_path / "a.glb", [(-0.5, 0.0), (0.0, 0.0), (0.5, 0.0)]))
    levels: list[int] = []

    def counted(*mesh: Any, settings: RefinementSettings, **named: Any) -> Refinement:
        levels.append(settings.max_levels)
        return refine(*mesh, settings=settings, **named)

    monkeypatch.setattr("wrinklecli.effects.plan.refine", counted)
    tried = TriedAsset(document, read_clips(document))
    found = try_on_refined_meshes(tried, [suggestion(0.08, 0.2, 0.0)], FACETED)
    assert [each.tool.name for each in found.tools] == ["fold"]
    assert found.refinement.max_levels > FACETED.max_levels
    assert [each for each in levels if each > 0] == [6]


def test_a_fold_much_shorter_than_its_triangles_is_left_out(tmp_path: Path) -> None:
    document = read_document(sheet(tmp_path / "a.glb", [(-0.5, 0.0), (0.0, 0.0), (0.5, 0.0)]))
    short = suggestion(0.02, 0.05, 0.0, "short")
    tried = TriedAsset(document, read_clips(document))
    found = try_on_refined_meshes(tried, [suggestion(0.4, 0.3, 0.0), short], FACETED)
    assert [each.tool.name for each in found.tools] == ["fold"]
    (note,) = found.notes
    assert "left out a fold that squeeze makes" in note
