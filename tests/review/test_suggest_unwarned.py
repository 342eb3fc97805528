"""A file that `suggest` writes passes `check --strict`, on characters as others make them."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from kit import characters
from kit.asset import Asset
from wrinklecli import check, suggest
from wrinklecli.character.clip import read_clips
from wrinklecli.gltf.document import read_document
from wrinklecli.review.suggest.trial import TriedAsset
from wrinklecli.review.suggest.unwarned import unwarned
from wrinklecli.review.suggest.worth import Dropped, Worthwhile
from wrinklecli.tools.records import Length, RefinementSettings

BUILT: dict[str, Callable[[], Asset]] = {
    "dressed": characters.dressed,
    "avatar": characters.avatar,
    "tubes": characters.tubes,
}


@pytest.mark.slow
@pytest.mark.parametrize("name", BUILT)
def test_a_suggested_file_has_no_warnings(name: str, tmp_path: Path) -> None:
    asset = BUILT[name]().write(tmp_path / f"{name}.glb")
    found = suggest(asset)
    assert found.tools
    (tmp_path / "tools.yaml").write_text(found.text)
    assert check(asset, tmp_path / "tools.yaml").warnings == ()


@pytest.mark.slow
def test_a_tool_is_made_to_fit_or_left_out(tmp_path: Path) -> None:
    asset = characters.tubes().write(tmp_path / "tubes.glb")
    document = read_document(asset)
    clips = read_clips(document)
    best = suggest(asset).tools[-1]
    # What it lacks is given to it ...
    stiff = replace(best, tool=replace(best.tool, compressible=0.0, max_height="auto"), lower=None)
    found = unwarned(TriedAsset(document, clips), Worthwhile([stiff], RefinementSettings(), [], []), clips)
    assert found.dropped == []
    assert found.tools[0].tool.compressible > 0.3
    # ... and what no key mends is left out, with the line of `check`.
    wide = replace(best, tool=replace(best.tool, width=Length(11.0 * best.span)), lower=None)
    found = unwarned(TriedAsset(document, clips), Worthwhile([wide], RefinementSettings(), [], []), clips)
    assert found.tools == []
    (dropped,) = found.dropped
    assert (dropped.name, dropped.reason) == (best.tool.name, "warned")
    assert "its width of" in dropped.line


def test_the_reason_of_a_warned_tool_is_the_line_of_check() -> None:
    dropped = Dropped("knee", "body", "warned", 0.0, "knee: it reaches across a fold")
    assert dropped.line == "body: left out knee: `check` would warn: it reaches across a fold"
