"""The mouse on the mesh: a tool comes of two clicks, and no click, drag or typed value takes a tool away."""

import html
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from kit.browser import until
from kit.limb import limb
from kit.touch import GRIP, PAD, plate, touch
from wrinklecli.editor.clicked import NEW_KINDS
from wrinklecli.editor.free_pose import POSE
from wrinklecli.editor.page.page import _SLIDE_SECONDS, Page
from wrinklecli.editor.page.tab import one_of
from wrinklecli.editor.page.viewpoints import clear_time
from wrinklecli.editor.page.widgets import BAD
from wrinklecli.editor.session import Session
from wrinklecli.errors import ConfigError, WrinkleError

TOOLS = """\
version: 1
tools:
  - {name: a, origin: [-0.4, 0.25, 0], target: [0.4, 0.25, 0], width: 0.3, bumps: 3}
  - {name: bent, path: [[-0.4, -0.25, 0], [0, -0.25, 0], [0.4, -0.25, 0]], width: 0.2}
"""
EYE = 3.0  # scene units above the axis of the limb
DOWN = np.array([0.0, -1.0, 0.0])


@pytest.fixture(scope="module")
def opened(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    """A page of a limb of four sides, too few for a field, with two tools, on the thread of the test."""
    folder = tmp_path_factory.mktemp("page")
    (folder / "limb.yaml").write_text(TOOLS)
    page = Page(Session(limb(folder / "limb.glb", rings=8, sides=4)))
    page.stop_work()
    page.player.go(None, 0.0)
    yield page
    page.close()


@pytest.fixture
def page(opened: Page) -> Iterator[Page]:
    """The page as it was opened."""
    yield opened
    opened._pending = None
    opened._pointer._end()
    while opened.session.undo():
        pass
    opened.choose(None, look=False)


def do(page: Page, action: Any) -> None:
    """Do what a click or a drag asks for, as the thread of the page does."""
    try:
        action()
    except WrinkleError as error:
        page._fail(error)


def click(page: Page, x: float, z: float = 0.0) -> str:
    """Click from above, and give the message."""
    do(page, lambda: page._pointer._click(np.array([x, EYE, z]), DOWN))
    return said(page)


def drag(page: Page, number: int, *xs: float, below: bool = False) -> str:
    """Drag an end of the chosen tool to some places, let go, and give the message."""
    side = -1.0 if below else 1.0
    for x in xs:
        ray = (np.array([x, side * EYE, 0.0]), side * DOWN)
        do(page, lambda ray=ray: page._pointer._move(str(page.chosen), "anchor", number, *ray))  # type: ignore[misc]
    message = said(page)
    do(page, page.commit)
    return message


def said(page: Page) -> str:
    return page._said[0]


def tools_of(page: Page) -> dict[str, Any]:
    return {tool["name"]: tool for tool in yaml.safe_load(page.session.text)["tools"]}


@pytest.mark.slow
def test_nothing_is_said_of_warnings_before_the_check(page: Page) -> None:
    page._checked = ""
    page.refresh()
    assert "checking" in page._found
    page._warn()
    page.work._asked.pop("warned")()
    assert "checking" not in page._found


def test_a_message_repeats_no_warning_that_stands_below_it(page: Page) -> None:
    page._warnings = {"a": ["a: it is wide & low"]}
    page.refresh()
    page.say("a.glb: 1 tool\na: it is wide & low\nb: it is high")
    shown = html.unescape(page._message.content)
    assert [shown.count(each) for each in ("a.glb: 1 tool", "it is wide & low", "b: it is high")] == [1, 1, 1]
    page._warnings = {}
    page.say("")
    page.refresh()


@pytest.mark.quick(1)
@pytest.mark.parametrize("nearly", [0.0, 1e-9, 1e-3, -5e-3])
def test_two_clicks_on_one_spot_leave_one_end(page: Page, nearly: float) -> None:
    page._pointer.press("tools")
    assert "where it ends" in click(page, -0.3)
    assert click(page, -0.3 + nearly) == "It began there. Click another place, or Cancel."
    assert click(page, -0.3, nearly) == "It began there. Click another place, or Cancel."
    assert page.session.text == TOOLS
    assert "wrinkle_1 is new" in click(page, 0.3)
    added = tools_of(page)["wrinkle_1"]
    assert (added["origin"][0], added["target"][0]) == pytest.approx((-0.3, 0.3), abs=1e-3)
    assert not page.session.tools()[-1].problem


def test_a_click_beside_the_mesh_leaves_the_new_tool_as_it_is(page: Page) -> None:
    page._pointer.press("tools")
    assert click(page, 9.0) == "There is no mesh. Click where the tool begins. It runs across the wrinkles."
    click(page, -0.3)
    assert click(page, 9.0) == "There is no mesh. Now click where it ends."
    assert "wrinkle_1 is new" in click(page, 0.3)


def test_a_tool_that_is_refused_leaves_its_first_end(page: Page, monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: object, **__: object) -> str:
        raise ConfigError("same as origin", where="tools[2].target")

    page._pointer.press("tools")
    click(page, -0.3)
    with monkeypatch.context() as patched:
        patched.setattr(page.session, "add", refused)
        assert click(page, 0.3) == "tools[2].target: same as origin\nClick another place, or Cancel."
    assert "wrinkle_1 is new" in click(page, 0.3)


@pytest.mark.slow
def test_a_typed_value_that_is_refused_takes_no_click_away(page: Page) -> None:
    page.choose("a", look=False)
    page._pointer.press("tools")
    click(page, -0.3)
    page._commit_later("bumps", 9.0, lambda: page.session.set_value("a", ("bumps",), 99))
    assert "found 99" in click(page, 0.3)
    assert "wrinkle_1 is new" in click(page, 0.3)
    assert tools_of(page)["a"]["bumps"] == 3


@pytest.mark.slow
@pytest.mark.parametrize(
    ("tool", "number", "ways"),
    [
        ("a", 0, [(-0.1, 0.4)]),
        ("a", 1, [(0.1, -0.4)]),
        ("bent", 1, [(-0.1, -0.4), (0.1, 0.4)]),
        ("bent", 2, [(0.35, 0.0)]),
    ],
)
def test_a_point_that_is_dragged_onto_its_neighbour_stays_where_it_was(
    page: Page, tool: str, number: int, ways: list[tuple[float, float]]
) -> None:
    page.choose(tool, look=False)
    for half_way, end in ways:
        for nearly in (0.0, 1e-9, 4e-3):
            message = drag(page, number, half_way, end + nearly, below=tool == "bent")
            assert message == "Points next to each other lie apart: the point stays where it was."
            points = tools_of(page)[tool].get("path") or [tools_of(page)[tool][key] for key in ("origin", "target")]
            assert points[number][0] == pytest.approx(half_way, abs=2e-3)
    assert [each.problem for each in page.session.tools()] == [None, None]


def test_an_end_that_is_dragged_to_where_the_tool_does_not_fit_is_dragged_back(page: Page) -> None:
    page.choose("a", look=False)
    page.session.move_point("a", 0, [9, 9, 9])
    page.refresh()
    assert "a" not in page.session.attached_tools()
    assert drag(page, 0, -0.3) == ""
    assert tools_of(page)["a"]["origin"][0] == pytest.approx(-0.3, abs=2e-2)
    assert page.session.tools()[0].problem is None


@pytest.mark.slow
def test_a_drag_that_pauses_is_one_step_to_undo(tmp_path: Path) -> None:
    (tmp_path / "limb.yaml").write_text(TOOLS)
    page = Page(Session(limb(tmp_path / "limb.glb", rings=8, sides=4)))
    try:
        page.work.put("choose", lambda: page.choose("a", look=False))
        until(lambda: page.chosen == "a", "a chosen tool")
        for x in (-0.3, -0.2):
            page._pointer.drag("anchor", 0, np.array([x, EYE, 0.0]), DOWN, "update")
            until(lambda x=x: abs(page.session.tools()[0].values["origin"][0] - x) < 2e-2, "a draft")  # type: ignore[misc]
            time.sleep(2.0 * _SLIDE_SECONDS)
        page._pointer.drag("anchor", 0, np.array([-0.2, EYE, 0.0]), DOWN, "end")
        until(lambda: page.session.text != TOOLS, "a moved end")
        assert page.session.undo()
        assert page.session.text == TOOLS
    finally:
        page.close()


@pytest.mark.slow
def test_a_draft_that_is_refused_leaves_the_one_before_it(page: Page) -> None:
    page.choose("a", look=False)
    for bumps in (5, 99, 98):
        do(
            page,
            lambda bumps=bumps: page.slide(
                "bumps", lambda draft: page.session.set_value("a", ("bumps",), bumps, draft=draft)
            ),
        )  # type: ignore[misc]
    assert said(page) == f"{page.session.path}: a.bumps: found 98, expected a whole number from 1 to 64"
    do(page, page.commit)
    assert tools_of(page)["a"]["bumps"] == 5
    assert page.session.undo()
    assert page.session.text == TOOLS


@pytest.mark.quick(1)
@pytest.mark.parametrize(
    ("steps", "value"),
    [
        (("width",), "0%"),
        (("width",), None),
        (("bumps",), float("nan")),
        (("clips",), {"fold": "x"}),
        (("clips",), "walk: 1"),
        (("lag",), '{"frequency": -1}'),
        (("node",), "\ud800"),
        (("seed",), 10**30),
    ],
)
def test_a_value_that_is_refused_leaves_the_tool(page: Page, steps: tuple[str, ...], value: Any) -> None:
    page.choose("a", look=False)
    for mode in ("typed", "at once", "slides"):
        page._changed(steps, value, mode)  # type: ignore[arg-type]
        do(page, page.work._asked.pop(("set", steps)))
        do(page, page.commit)
        assert page._said[1] == BAD
        assert page.session.text == TOOLS
        assert page.chosen == "a"
        assert page.session.tools()[0].problem is None
        page.say("")


@pytest.mark.slow
def test_a_tool_of_the_list_is_shown_where_it_is_tallest(page: Page) -> None:
    page.player.go(None, 0.0)
    page.choose("a", look=True)
    raised = page.session.raised("a")
    assert raised is not None
    assert (page.player.clip, page.player.time) == ("fold", pytest.approx(clear_time(raised), abs=1e-3))
    assert "a is tallest at" in said(page)
    page.player.go(POSE, 0.0)
    page.choose("bent", look=True)
    assert page.player.clip == POSE
    page.player.go("fold", 0.0)
    page.session.set_value("a", ("strength",), 0.0)
    page.session.set_value("a", ("clips",), {"none": 1.0})
    page.choose("a", look=True)
    assert (page.player.clip, page.player.time) == ("fold", 0.0)


@pytest.mark.slow
def test_two_clicks_make_a_muscle(page: Page) -> None:
    page._pointer.press("muscles")
    assert "Click the skin above where the muscle begins" in said(page)
    assert "There is no mesh" in click(page, 5.0)
    click(page, -0.8)
    assert "muscle_1 is new" in click(page, 0.3)
    (entry,) = yaml.safe_load(page.session.text)["muscles"]
    assert [entry[key]["joint"] for key in ("origin", "insertion")] == ["joint_0", "joint_1"]
    assert page._pointer._new is None
    # The next new tool is a tool again.
    page._pointer.press("tools")
    click(page, -0.3)
    click(page, 0.3)
    assert len(yaml.safe_load(page.session.text)["tools"]) == 3


def test_one_click_is_for_a_field_and_cancel_ends_what_does_not_fit(page: Page) -> None:
    page._pointer.press("fields")
    assert page._pointer.buttons.content.count("Cancel") == 1
    assert click(page, 9.0) == "There is no mesh. Click the garment that folds."
    for x in (-0.3, 0.3):
        message = click(page, x)
        assert "limb is faceted" in message
        assert message.endswith("\nClick another place, or Cancel.")
    page._pointer.give_up()
    assert "Cancel" not in page._pointer.buttons.content
    begun, press = [], one_of(lambda: [*NEW_KINDS], page._pointer.press)
    for number in ("2", "0", "0", "9", "x"):  # a muscle, a tool in its place, the tool's button again, and no button
        press(number, None)  # type: ignore[arg-type]
        begun.append(page._pointer._new)
    assert begun == ["muscles", "tools", None, None, None]
    click(page, -0.3)
    assert page.chosen == "a"
    assert page.session.text == TOOLS


@pytest.mark.slow
@pytest.mark.long
def test_two_clicks_make_flesh(page: Page) -> None:
    page._pointer.press("flesh")
    assert "Click the middle of flesh" in said(page)
    click(page, -0.5)
    assert "flesh_1 is new: play a clip that moves the body" in click(page, -0.2)
    (entry,) = yaml.safe_load(page.session.text)["flesh"]
    assert entry["radius"] == pytest.approx(0.3, rel=0.05)


@pytest.mark.slow
@pytest.mark.long
def test_two_clicks_make_a_touch_that_the_shown_clip_drags(page: Page) -> None:
    page.player.go("fold", 0.0)
    page._pointer.press("touches")
    assert "Click the skin that a tip touches" in said(page)
    click(page, -0.6)
    assert "touch_1 is new: play the clip" in click(page, -0.5)
    (entry,) = yaml.safe_load(page.session.text)["touches"]
    assert entry["pad"] == pytest.approx(0.1 / 0.6, rel=0.05)
    ((clip, rows),) = entry["keys"].items()
    assert clip == "fold"
    assert rows[1][1] == pytest.approx(0.1, rel=0.05)
    still, moved = (page.session.meshes("fold", time)[0].positions for time in (rows[0][0], rows[1][0]))
    page.session.undo()
    without = page.session.meshes("fold", rows[1][0])[0].positions
    assert len(moved) == len(still)
    assert np.abs(moved[: len(without)] - without).max() > 0.08


@pytest.mark.slow
def test_a_touch_needs_no_clip(tmp_path: Path) -> None:
    """A tip that only a player moves."""
    session = Session(limb(tmp_path / "limb.glb", clip=None), tmp_path / "tools.yaml")
    session.add("touches", [[-0.6, 0.25, 0.0], [-0.5, 0.25, 0.0]])
    (entry,) = yaml.safe_load(session.text)["touches"]
    assert "keys" not in entry


def test_the_dot_of_a_touch_drags_its_skin_which_springs_back(tmp_path: Path) -> None:
    (tmp_path / "tools.yaml").write_text(
        yaml.safe_dump({"version": 1, "refinement": {"max_levels": 0}, "touches": [touch(keys={})]})
    )
    page = Page(Session(plate().write(tmp_path / "plate.glb"), tmp_path / "tools.yaml"))
    try:
        page.stop_work()
        page.player.go(None, 0.0)
        assert not page._viewport._scene._dots, "of a touch that is not chosen"
        page.choose("spot", look=True)
        assert "Drag its dot: the skin slides" in said(page)
        (dot,) = page._viewport._scene._dots.values()
        assert np.linalg.norm(dot.position) < 0.1 * PAD
        still = page._viewport.shown[0].positions
        do(page, lambda: page._pointer._hold("spot", np.array([0.5 * GRIP, 1.0, 0.0]), DOWN))
        assert "spot slides by 0.005 forward and 0 sideways" in said(page)
        moved = page._viewport.shown[0].positions - still
        assert 0.5 * GRIP < moved[:, 0].max() < 0.75 * GRIP
        assert dot.position[0] == pytest.approx(moved[:, 0].max(), rel=0.1), "it goes with the skin"
        page._pointer.drag("skin", 0, np.array([0.0, 1.0, -GRIP]), DOWN, "end")
        sideways = []
        while page.work._asked:
            page.work._asked.pop(next(iter(page.work._asked)))()
            sideways.append((page._viewport.shown[0].positions - still)[:, 2].min())
        assert min(sideways) < -GRIP, "the skin goes where the mouse lets it go"
        until(lambda: (page.work._due["let go"][1](), page.session.hand is None)[1], "the skin comes to rest")
        assert page._viewport.shown[0].positions == pytest.approx(still, abs=1e-12)
        assert not page.session.changed
    finally:
        page.close()
