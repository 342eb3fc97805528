"""Reviews: every tool of an asset on a sheet, each where its wrinkles are tallest."""

import dataclasses
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import wrinklecli
from kit.asset import Asset
from kit.fields import bake_field, field, sleeve_and_field
from kit.limb import RADIUS, limb_asset, sleeved_limb, tool, write_tools
from kit.muscles import arm, muscle
from kit.pictures import BUMPY, draw, limb, near, picture
from kit.touch import plate, touch
from wrinklecli.baking.job import BakeOptions
from wrinklecli.errors import AssetError
from wrinklecli.gltf.document import Document, read_document
from wrinklecli.review.check import check
from wrinklecli.review.preview import review as reviewing
from wrinklecli.review.preview.apply import plan_tools
from wrinklecli.review.preview.overlay import RED
from wrinklecli.review.preview.peaks import Peak, baked_peaks, planned_peaks
from wrinklecli.review.preview.preview import is_reviewed
from wrinklecli.review.preview.preview_options import PreviewOptions
from wrinklecli.review.preview.shown import INKS, read_shown

Json = dict[str, Any]

UNDER: Json = {"name": "under (1).*", "origin": [-0.4, -RADIUS, 0.0], "target": [0.4, -RADIUS, 0.0], "bumps": 2}
SMALL: Json = {"size": (64, 48)}


def unfolding(**options: Any) -> Asset:
    """A limb with a clip that bends it down."""
    asset = limb_asset(**options)
    animation: Json = {"name": "unfold"}
    turn = np.radians(60.0) / 2.0
    turns = [[0.0, 0.0, 0.0, 1.0], [0.0, 0.0, -np.sin(turn), np.cos(turn)], [0.0, 0.0, 0.0, 1.0]]
    asset.channel(animation, 2, "rotation", [0.0, 1.5, 2.0], turns)
    asset.append("animations", animation)
    return asset


def two_ways(folder: Path) -> tuple[Path, Path]:
    """A limb that one clip bends up, and another, later and less, down; and tools on both sides."""
    asset = unfolding(rings=17, sides=12)
    return asset.write(folder / "limb.glb"), write_tools(folder / "tools.yaml", tool(**BUMPY), tool(**UNDER))


def peaks_of(asset: Path, tools: Path) -> list[Peak]:
    planned = plan_tools(asset, tools, BakeOptions())
    assert planned.job is not None
    return planned_peaks(planned.plans, planned.job.clips, fps=30.0)


def words(peak: Peak) -> str:
    return " / ".join(fact.text for row in peak.facts for fact in row)


@pytest.mark.slow
def test_each_tool_has_its_own_peak_and_a_bake_has_the_same(tmp_path: Path) -> None:
    asset, tools = two_ways(tmp_path)
    fold, under = peaks_of(asset, tools)
    assert (fold.moment.clip, under.moment.clip) == ("fold", "unfold")
    assert (fold.moment.time, under.moment.time) == pytest.approx((1.0, 1.5))
    wrinklecli.bake(asset, tools, tmp_path / "baked.glb")
    shown, _ = read_shown(read_document(tmp_path / "baked.glb"), "", ())
    for planned, baked in zip((fold, under), baked_peaks(shown, shown.clips), strict=True):
        assert (baked.name, baked.moment.clip) == (planned.name, planned.moment.clip)
        assert baked.moment.time == pytest.approx(planned.moment.time, abs=0.01)
        (shorter,) = re.findall(r"\d+ % shorter", words(planned))
        assert shorter in words(baked)
        # Of an attenuated wrinkle no vertex need be quite as tall as its control curve, and in a crease none is.
        heights = [float(*re.findall(r"([\d.]+)(?: of [\d.]+)? tall", words(each))) for each in (planned, baked)]
        assert 0.6 * heights[0] < heights[1] <= 1.01 * heights[0]


@pytest.mark.slow
def test_what_is_known_of_a_tool_is_that_of_check(tmp_path: Path) -> None:
    asset, tools = two_ways(tmp_path)
    for peak, data in zip(peaks_of(asset, tools), check(asset, tools).data["tools"], strict=True):
        assert f"{data['triangles']:,} triangles + {data['edges_split']:,} vertices" in words(peak)
        assert f"{data['bumps']} bumps, everywhere" in words(peak)
        clip = next(each for each in data["clips"] if each["name"] == peak.moment.clip)
        assert f"{clip['height']:.3g} of {data['height_limit']:.3g} tall" in words(peak)
        lost = [fact.text for row in peak.facts for fact in row if fact.alarming]
        assert lost == [f"{100 * clip['unabsorbed']:.0f} % not absorbed"]


@pytest.mark.slow
@pytest.mark.long
def test_a_sheet_is_a_review_where_there_is_more_than_one_tool_or_clip(tmp_path: Path) -> None:
    asset, tools = two_ways(tmp_path)
    single = read_document(limb(tmp_path, name="single"))
    document = read_document(asset)

    def reviewed(document: Document, *, animated: bool = False, **options: Any) -> bool:
        planned = plan_tools(document.path, tools, BakeOptions(only=options.get("only", ())))
        return is_reviewed([document], planned, PreviewOptions(**options), animated=animated)

    assert reviewed(document)
    assert reviewed(single)
    assert reviewed(document, only=["fold"]), "as there are two clips"
    assert not reviewed(single, only=["fold"])
    assert not reviewed(document, animated=True)
    shots: list[Json] = [
        {"times": (0.5,)},
        {"rest": True},
        {"views": ["front"]},
        {"labels": ["x"]},
        {"clips": ["fold"]},
    ]
    assert not any(reviewed(document, **shot) for shot in shots)
    assert reviewed(document, review=True, views=["front"])
    assert not is_reviewed([document], None, PreviewOptions(), animated=False)


@pytest.mark.slow
def test_tools_are_marked_before(tmp_path: Path) -> None:
    asset, tools = two_ways(tmp_path)
    out = tmp_path / "a.png"
    one = draw([asset], out, tools=tools, **SMALL)
    assert (one.shown, one.warnings) == ("2 tools", ())
    shown = picture(out)
    assert near(shown, INKS[0], within=5) > 20
    assert near(shown, INKS[1], within=5) > 20


@pytest.mark.slow
def test_of_many_tools_the_first_are_shown_and_the_others_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asset, tools = two_ways(tmp_path)
    wrinklecli.bake(asset, tools, tmp_path / "baked.glb")
    monkeypatch.setattr(reviewing, "MOST_REVIEWED", 1)
    made = draw([tmp_path / "baked.glb"], tmp_path / "a.png", **SMALL)
    assert made.shown == "1 tool"
    assert made.warnings == (f"1 of 2 tools is not shown: {UNDER['name']}; --tool NAME shows one",)
    made = draw([tmp_path / "baked.glb"], tmp_path / "a.png", review=True, only=[UNDER["name"]], **SMALL)
    assert (made.shown, made.warnings) == ("1 tool", ())
    with pytest.raises(AssetError, match="has no tool 'fo'; did you mean 'fold'"):
        draw([tmp_path / "baked.glb"], tmp_path / "a.png", review=True, only=["fo"], **SMALL)


@pytest.mark.slow
@pytest.mark.long
def test_a_tool_of_a_baked_file_is_shown_at_its_own_moments(tmp_path: Path) -> None:
    asset, tools = two_ways(tmp_path)
    baked = tmp_path / "baked.glb"
    wrinklecli.bake(asset, tools, baked)
    with pytest.raises(AssetError, match="has no tool 'fo'; did you mean 'fold'"):
        draw([asset, baked], tmp_path / "a.png", only=["fo"], **SMALL)
    for name in (BUMPY["name"], UNDER["name"]):
        moment = next(peak.moment for peak in peaks_of(asset, tools) if peak.name == name)
        made = draw([asset, baked], tmp_path / "a.png", only=[name], views=["facing"], **SMALL)
        assert made.shown == "3 moments"
        times = [part * moment.time for part in (0.0, 0.5, 1.0)]
        draw([asset, baked], tmp_path / "b.png", clips=[moment.clip], times=times, views=made.views, **SMALL)
        moved = draw([baked], tmp_path / "a.webp", only=[name], frames=2, **SMALL)
        assert moved.shown == "2 moments"
    with pytest.raises(AssetError, match="no wrinkles to show"):
        draw([asset], tmp_path / "a.png", only=["fold"], views=["front"], **SMALL)


def test_a_tool_that_no_clip_raises_is_shown_at_its_full_height(tmp_path: Path) -> None:
    asset = unfolding(rings=13, sides=10, clip=None).write(tmp_path / "limb.glb")
    tools = write_tools(tmp_path / "tools.yaml", tool(**BUMPY))
    made = draw([asset], tmp_path / "a.png", tools=tools, review=True, hide_tools=True, size=(160, 120), views=["top"])
    assert made.shown == "1 tool"
    shown = picture(tmp_path / "a.png").astype(int)
    # Between the words at the top and the small picture of the whole limb.
    before, after = shown[72:112, 14:170], shown[72:112, 176:332]
    assert before.std(axis=1).max() < 2
    assert np.abs(before - after).mean() > 2
    (peak,) = peaks_of(asset, tools)
    assert "no clip raises it" in words(peak)


@pytest.mark.quick(1)
@pytest.mark.parametrize(("angle", "hidden"), [(60.0, False), (120.0, True)])
def test_what_a_fold_hides_at_its_peak_is_shown_before_it(tmp_path: Path, angle: float, hidden: bool) -> None:
    asset = limb_asset(rings=33, sides=12, angle=angle).write(tmp_path / "limb.glb")
    long = tool(**BUMPY) | {"origin": [-0.9, RADIUS, 0.0], "target": [0.9, RADIUS, 0.0]}
    wrinklecli.bake(asset, write_tools(tmp_path / "tools.yaml", long), tmp_path / "baked.glb")
    after, _ = read_shown(read_document(tmp_path / "baked.glb"), "", ())
    (peak,) = baked_peaks(after, after.clips)
    assert peak.moment.time == pytest.approx(1.0)
    ((moment, view),) = reviewing.moments_and_views(after, peak, PreviewOptions())
    assert (moment.time < 0.9) == hidden
    assert view.visible > 0.55


@pytest.mark.slow
def test_a_card_tells_where_it_is_and_what_clip_however_long_its_name(tmp_path: Path) -> None:
    asset = limb_asset(rings=33, sides=12)
    asset.gltf["animations"][0]["name"] = name = "browInnerUp + " * 8 + "browOuterUpRight"
    small = tool(**BUMPY) | {"origin": [-0.1, RADIUS, 0.0], "target": [0.1, RADIUS, 0.0], "width": 0.1}
    path = asset.write(tmp_path / "limb.glb")
    large = tool(**BUMPY) | {"origin": [-0.9, RADIUS, 0.0], "target": [0.9, RADIUS, 0.0]}
    out = tmp_path / "a.png"
    for each, framed in ((small, True), (large, False)):
        tools = write_tools(tmp_path / "tools.yaml", each)
        draw([path], out, tools=tools, review=True, hide_tools=True, size=(160, 120))
        assert (near(picture(out), np.array(RED), within=5) > 10) == framed
    (peak,) = peaks_of(path, tmp_path / "tools.yaml")
    rows = " ".join(fact.text for row in reviewing.card_facts(peak) for fact in row)
    assert f"in clip {name}" in rows


def test_what_carries_no_wrinkles_has_no_review(tmp_path: Path) -> None:
    with pytest.raises(AssetError, match="no wrinkles to show"):
        draw([limb(tmp_path)], tmp_path / "a.png", review=True, **SMALL)


@pytest.mark.slow
def test_muscles_alone_are_shown_at_their_greatest_move(tmp_path: Path) -> None:
    """Before the bake and after it, at the same moment."""
    tools = tmp_path / "tools.yaml"
    tools.write_text(json.dumps({"version": 1, "muscles": [muscle()]}))
    (planned,) = peaks_of(arm(), tools)
    assert (planned.name, planned.moment.time, planned.raised) == ("biceps", pytest.approx(1.0), True)
    wrinklecli.bake(arm(), tools, tmp_path / "baked.glb")
    after, _ = read_shown(read_document(tmp_path / "baked.glb"), "", ())
    (peak,) = baked_peaks(after, after.clips)
    assert peak.moment == planned.moment
    for asset, options in ((arm(), {"tools": tools}), (tmp_path / "baked.glb", {})):
        made = draw([asset], tmp_path / "a.png", review=True, views=["top"], **options, **SMALL)
        assert made.shown == "1 muscle"


@pytest.mark.slow
@pytest.mark.long
def test_a_vertex_that_moves_alone_is_seen_with_what_is_around_it(tmp_path: Path) -> None:
    """A region of flesh smaller than the triangles; "all is at one point" is not true of the asset."""
    tools = tmp_path / "tools.yaml"
    region = {"name": "dot", "at": [0.25, 0.2, 0.0], "radius": 0.1, "frequency": 4}
    tools.write_text(json.dumps({"version": 1, "flesh": [region]}))
    asset = limb(tmp_path, rings=9, sides=8)
    (found,) = check(asset, tools).data["flesh"]
    assert found["moved_vertices"] == 1
    assert draw([asset], tmp_path / "a.png", tools=tools, review=True, **SMALL).shown == "1 region of flesh"


def test_names_of_tools_are_told_from_each_other() -> None:
    peak = Peak("a.(b", 0, None, raised=True, facts=())  # type: ignore[arg-type]
    assert peak.owns("wrinkle_a__b_1")
    assert not peak.owns("wrinkle_a__b_1_1")
    assert not dataclasses.replace(peak, name="a").owns("wrinkle_a__b_1")


@pytest.mark.slow
@pytest.mark.long
def test_a_touch_is_seen_from_above_with_a_checker(tmp_path: Path) -> None:
    """Before the bake and after it; without a slide in any clip, at its greatest slide."""
    asset = plate().write(tmp_path / "plate.glb")
    top: Json = {"version": 1, "refinement": {"max_levels": 0}}
    tools, still = tmp_path / "tools.yaml", tmp_path / "still.yaml"
    tools.write_text(json.dumps({**top, "touches": [touch()]}))
    still.write_text(json.dumps({**top, "touches": [touch(keys={})]}))
    wrinklecli.bake(asset, tools, tmp_path / "baked.glb")
    for path, options in ((asset, {"tools": tools}), (tmp_path / "baked.glb", {}), (asset, {"tools": still})):
        out = tmp_path / "a.png"
        made = draw([path], out, review=True, size=(160, 120), **options)
        assert [each.split(":")[1] for each in made.views] == ["89"]
        assert made.shown == "1 touch"
        shown = picture(out).astype(int)
        row = int(np.flatnonzero((shown[:, 20] != shown[5, 20]).any(axis=1))[0])
        before, after = (shown[row + 4 : row + 116, x : x + 150].sum(axis=2) for x in (16, 178))
        # The cells are straight before: along the picture and across it, a line changes its tone often.
        for lines in (before, before.T):
            steps = (np.abs(np.diff(lines, axis=1)) > 60).sum(axis=1)
            assert np.median(steps) >= 8
        assert (np.abs(before - after) > 60).mean() > 0.1, "the cells have slid"
    (peak,) = peaks_of(asset, still)
    assert "no clip slides it" in words(peak)
    shown, _ = read_shown(read_document(tmp_path / "baked.glb"), "", ())
    (baked,) = baked_peaks(shown, shown.clips)
    assert baked.forward == pytest.approx(peak.forward, abs=1e-6)
    assert sum(weight > 1e-6 for weight in peak.forward.values()) == 1 + 3, (
        "of slides one, and the rings that lie ahead"
    )


def test_a_muscle_that_clips_leave_alone_is_shown_at_its_full_height(tmp_path: Path) -> None:
    """Rounding errors of its length raise no bulge, before the bake and after it."""
    tools, asset = write_tools(tmp_path / "tools.yaml", muscles=[muscle()]), arm(rings=9, sides=8, angle=1e-4)
    planned = peaks_of(asset, tools)
    wrinklecli.bake(asset, tools, tmp_path / "baked.glb")
    after, _ = read_shown(read_document(tmp_path / "baked.glb"), "", ())
    for peak in (*planned, *baked_peaks(after, after.clips)):
        assert ("no clip bulges it" in words(peak)) == (peak.name == "biceps")
        assert not peak.raised


@pytest.mark.slow
@pytest.mark.long
def test_a_field_is_shown_where_it_folds_most_and_covers_nothing(tmp_path: Path) -> None:
    """Before the bake and after it; no colour marks a whole garment, but what compresses it and its crests below."""
    asset, tools = sleeve_and_field(tmp_path)
    for path, options in ((asset, {"tools": tools}), (bake_field().path, {})):
        out = tmp_path / "a.png"
        made = draw([path], out, review=True, size=(160, 120), **options)
        assert made.shown == "1 field"
        assert not made.warnings
        shown = picture(out).astype(int)
        folds, measured = np.array_split(shown, 2)
        assert np.ptp(folds, axis=2).max() < 80, "no ink"
        compression, crests = (half[..., 0] - half[..., 2] for half in np.array_split(measured, 2, axis=1))
        assert compression.max() > 80
        assert compression.min() > -40, "warm alone"
        assert (crests.max(), -crests.min()) > (80, 60)
    (peak,) = peaks_of(asset, tools)
    assert peak.raised
    assert "folds by " in words(peak)
    still = limb(tmp_path, rings=16, sides=10, joints=3, clip=None)
    (peak,) = peaks_of(still, tools)
    assert not peak.raised
    assert "no clip folds it" in words(peak)


@pytest.mark.slow
def test_a_card_has_the_colour_of_its_mark(tmp_path: Path) -> None:
    """Behind a field on another mesh, too, which has no mark."""
    asset, out = sleeved_limb(rings=24, sides=12).write(tmp_path / "limb.glb"), tmp_path / "a.png"
    sleeve = tool(**BUMPY, node="sleeve") | {"origin": [-0.3, RADIUS + 0.04, 0.0], "target": [0.3, RADIUS + 0.04, 0.0]}
    tools = write_tools(tmp_path / "tools.yaml", sleeve, fields=[field()], refinement={"max_levels": 0})
    assert draw([asset], out, tools=tools, review=True, **SMALL).shown == "1 tool, 1 field"
    shown = picture(out)
    assert near(shown, INKS[0], within=5) > 20
    assert near(shown, INKS[1], within=5) == 0


@pytest.mark.slow
def test_a_field_is_chosen_by_its_name(tmp_path: Path) -> None:
    """Beside a tool, whose colour it does not take."""
    asset, tools = sleeve_and_field(tmp_path)
    tools.write_text(json.dumps(yaml.safe_load(tools.read_text()) | {"tools": [tool(**BUMPY, node="limb")]}))
    out = tmp_path / "a.png"
    assert draw([asset], out, tools=tools, review=True, **SMALL).shown == "1 tool, 1 field"
    assert draw([asset], out, tools=tools, review=True, only=[field()["name"]], **SMALL).shown == "1 field"
    with pytest.raises(AssetError, match="no tool 'fold'; did you mean 'folds'"):
        draw([bake_field().path], out, review=True, only=["fold"], **SMALL)


@pytest.mark.slow
@pytest.mark.long
def test_a_touch_says_how_far_it_slides() -> None:
    """The card says the slide that `check` says too; a displacement would count its rings and dent in."""
    root = Path(__file__).parents[3]
    asset, tools = root / "samples" / "touch.glb", root / "configs" / "touch.yaml"
    (peak,) = peaks_of(asset, tools)
    (touch,) = check(asset, tools).data["touches"]
    assert f"slides by {touch['clips'][0]['largest_slide']:.3g}" in words(peak)
    assert "dented by" in words(peak)
    assert "tall" not in words(peak)
