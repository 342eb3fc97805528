"""A file that `suggest` writes passes `check --strict`, on characters as others make them."""

from dataclasses import replace
from pathlib import Path

import pytest

from kit import characters
from kit.samples import sample
from kit.suggested import in_assets, squeezed, suggest_once
from wrinklecli import check, suggest
from wrinklecli.character.clip import read_clips
from wrinklecli.gltf.document import read_document
from wrinklecli.review.suggest.trial import TriedAsset
from wrinklecli.review.suggest.worth import Dropped, Judge, Worthwhile
from wrinklecli.tools.records import Length, RefinementSettings, WrinkleTool

# The built characters that get tools, and a garment over plates that gets a field. What the dressed one gets, in any
# colours, is the same as on its low-poly mesh.
BUILT = ("tubes", "cartoon", "knight_tabard", "low_poly_smooth")
SAMPLES = ("wrist", "trousers", "head", "body")
# The assets of others that get tools.
REAL = ("cesium_man.glb", "hand.glb", "head_male.glb", "trousers.glb")


def unwarned_file(asset: Path, folder: Path) -> bool:
    found = suggest_once(asset)
    assert found.text
    (folder / "tools.yaml").write_text(found.text)
    return check(asset, folder / "tools.yaml").warnings == ()


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("name", BUILT)
def test_a_suggested_file_has_no_warnings(name: str, tmp_path: Path) -> None:
    assert unwarned_file(characters.CHARACTERS[name]().write(tmp_path / f"{name}.glb"), tmp_path)


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("name", SAMPLES)
def test_a_file_suggested_for_a_sample_has_no_warnings(name: str, tmp_path: Path) -> None:
    assert unwarned_file(sample(name), tmp_path)


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("name", REAL)
def test_a_file_suggested_for_a_real_asset_has_no_warnings(name: str, tmp_path: Path) -> None:
    assert unwarned_file(in_assets(name), tmp_path)


@pytest.mark.slow
@pytest.mark.long
def test_a_tool_is_made_to_fit_or_left_out() -> None:
    asset = sample("wrist")
    document = read_document(asset)
    clips = read_clips(document)
    best = suggest(asset).tools[0]

    # What it lacks is given to it ...
    def tried(tool: WrinkleTool) -> Worthwhile:
        made = replace(best, tool=tool, others=())
        asset = TriedAsset(document, clips)
        return Judge(asset, False, clips).worthwhile([made], RefinementSettings(), count=1)

    found = tried(replace(best.tool, compressible=0.0, max_height="auto"))
    assert found.dropped == []
    assert found.kept[0].tool.compressible > 0.3
    # ... and what no key mends is left out, with the line of `check`.
    found = tried(replace(best.tool, strength=3.0))
    assert found.kept == []
    (dropped,) = found.dropped
    assert (dropped.name, dropped.reason) == (best.tool.name, "warned")
    assert "strength 3 does not keep the length" in dropped.line


def test_what_fits_a_place_is_tried_one_after_another() -> None:
    tool = WrinkleTool(name="knee", origin=(0.0, 0.0, 0.0), target=(1.0, 0.0, 0.0), width=Length(1.0))
    path, straight, low, lower = (
        squeezed(replace(tool, max_height=Length(height)), 1.0) for height in (0.4, 0.3, 0.2, 0.1)
    )
    found = replace(path, others=(replace(straight, others=(low,)), lower))
    heights = []
    while found is not None:
        heights.append(found.tool.max_height)
        found = found.mended(0.0)
    assert heights == [Length(height) for height in (0.4, 0.3, 0.2, 0.1)]


def test_the_reason_of_a_warned_tool_is_the_line_of_check() -> None:
    dropped = Dropped("knee", "body", "warned", 0.0, "knee: it reaches across a fold")
    assert dropped.line == "body: left out knee: `check` would warn: it reaches across a fold"
