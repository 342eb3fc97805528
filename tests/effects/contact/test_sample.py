"""Contact over clips: a clip of one moment is a pose."""

from pathlib import Path

import pytest

pytest.importorskip("ipctk", reason="needs the extra `contact`")

import wrinklecli
from kit.asset import Json
from kit.bakes import folding_limb
from kit.limb import posed_limb, tool, write_tools
from kit.player import Gltf
from wrinklecli.effects.contact import sample
from wrinklecli.errors import TooMuchError
from wrinklecli.numeric.memory import Memory
from wrinklecli.review.crossings import crossings

TOP = {"refinement": {"max_levels": 1}}


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize(
    "more",
    [
        {"contact": "resolve"},
        {"contact": {"per_clip": False}, "lag": {"frequency": 6, "damping": 0.5}},
        {"contact": "resolve", "rest_length": {"keys": {"pose": [[0, 0.6], [0.5, 0.9]]}}},
    ],
)
def test_contact_is_resolved_in_a_clip_of_one_key(more: Json, tmp_path: Path) -> None:
    asset = posed_limb(tmp_path / "limb.glb", degrees=75.0)
    tools = write_tools(tmp_path / "tools.yaml", tool(bumps=3, max_height="10%", **more), **TOP)
    report = wrinklecli.bake(asset, tools, tmp_path / "out.glb")
    clip, *_ = crossings(tmp_path / "out.glb").data["clips"]
    assert clip["totals"][0] > clip["totals"][1] == 0
    (fold,) = report.data["folds"]
    file = Gltf(tmp_path / "out.glb")
    names = file.mesh("limb")["extras"]["targetNames"]
    times, values = file.keys("pose", "limb")
    assert times.tolist() == [0.5]
    assert values[0, [names.index(name) for name in fold["targets"]]].any()


def test_what_contact_needs_is_known_before_anything_is_solved(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Solving takes minutes, after which memory would be refused."""
    monkeypatch.setattr(sample, "_solved_system", lambda *_, **__: pytest.fail("is solved"))
    claimed: list[int] = []

    def check(_: Memory, size: int, what: str, *, where: str) -> None:
        if what.endswith("solved for contact,"):
            claimed.append(size)
            raise TooMuchError(what, where=where)

    monkeypatch.setattr(Memory, "check", check)
    tools = write_tools(tmp_path / "tools.yaml", tool(bumps=3, max_height="10%", contact="resolve"))
    with pytest.raises(TooMuchError, match=r"^limb: [\d,]+ poses of the folds 'crease', solved for contact,$"):
        wrinklecli.bake(folding_limb(), tools, tmp_path / "out.glb")
    (size,) = claimed
    assert 10**5 < size < 10**9
