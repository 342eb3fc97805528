"""`wrinkle edit` in a real browser: what is made by clicks, tuned and saved bakes as if written by hand."""

import json
import os
import resource
import shutil
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import numpy as np
import pytest
import viser
import yaml
from numpy.typing import NDArray

import wrinklecli
from kit.browser import Page as Tab
from kit.browser import browsing, until
from kit.folds import CLIP, elbow
from kit.limb import limb, tool, write_tools
from kit.places import ROOT
from wrinklecli.editor.page.access import Access
from wrinklecli.editor.page.page import Page
from wrinklecli.editor.page.viewport import axes_of
from wrinklecli.editor.recent import recent, remember
from wrinklecli.editor.session import Session
from wrinklecli.tools.read import load_tools

SCREENSHOTS = os.environ.get("WRINKLE_SCREENSHOTS")
# Behind the left knee of the sample trousers, at rest, and where a camera looks at it from.
KNEE = np.array([(0.115, 0.55, -0.078), (0.115, 0.40, -0.078)])
CAMERA, SEEN = np.array([0.115, 0.46, -1.0]), np.array([0.115, 0.435, -0.078])

Floats = NDArray[np.float64]
in_browser = partial(browsing, size=(900, 600), drawn=bool(SCREENSHOTS))


def on_screen(page: Page, place: Floats) -> tuple[float, float]:
    """Where a tab shows a (3,) place, CSS pixels."""
    (client,) = page.server.get_clients().values()
    camera = client.camera
    backwards = (camera.position - camera.look_at) / np.linalg.norm(camera.position - camera.look_at)
    right = np.cross(camera.up_direction, backwards)
    right /= np.linalg.norm(right)
    relative = place - camera.position
    scale = camera.image_height / 2 / np.tan(camera.fov / 2) / -(relative @ backwards)
    up = np.cross(backwards, right)
    return camera.image_width / 2 + scale * (relative @ right), camera.image_height / 2 - scale * (relative @ up)


def hold_end(tab: Tab, page: Page, session: Session, lower: Floats) -> None:
    """Drag the target of the only tool to a (3,) place and hold it there, once the session has it there.

    A dot is drawn later than the text that speaks of its tool, and a press beside it would turn the view. A busy tab
    hands over some moves only.
    """
    dots = page._viewport._scene._dots
    until(lambda: ("anchor", 1) in dots, "a dot on the target")
    dot = np.array(dots["anchor", 1].position)
    until(lambda: not tab.can_be_dragged(on_screen(page, lower)), "a place beside the dot")
    until(lambda: tab.can_be_dragged(on_screen(page, dot)), "a dot that can be dragged")
    tab.hold([on_screen(page, place) for place in (dot, (dot + lower) / 2, lower)])

    def dragged() -> bool:
        tab.move(on_screen(page, lower))
        return abs(session.tools()[0].values["target"][1] - lower[1]) < 0.005

    until(dragged, "a dot that follows the mouse")


def take_picture(tab: Tab, name: str) -> None:
    """Keep what the tab shows, where somebody wants to look at it."""
    if SCREENSHOTS:
        tab.screenshot(Path(SCREENSHOTS, f"{name}.png"))


@pytest.mark.slow
@pytest.mark.long
def test_a_browser_opens_the_page_by_its_token_alone_and_lets_no_site_in(tmp_path: Path) -> None:
    page = Page(Session(shutil.copy(ROOT / "samples" / "wrist.glb", tmp_path)), Access.to("0.0.0.0"))
    start = f"http://127.0.0.1:{page.port}"
    attack = f"""<iframe src="{start}/"></iframe><script>
    const socket = new WebSocket("{start.replace("http", "ws")}", ["viser-v{viser.__version__}"]);
    socket.onopen = () => document.title = "let in"; socket.onerror = () => document.title = "kept out";
    </script>"""
    (tmp_path / "index.html").write_text(attack)
    site = ThreadingHTTPServer(("127.0.0.1", 0), partial(SimpleHTTPRequestHandler, directory=str(tmp_path)))
    threading.Thread(target=site.serve_forever, daemon=True).start()
    try:
        with in_browser(tmp_path, f"{start}/") as tab:
            tab.wait("document.body?.innerText.includes('with its token')")
            assert tab.value("cancelAnimationFrame === clearTimeout"), "a page that is drawn seldom, as all pages here"
            assert not page.server.get_clients()
            by_token = page.address.replace("0.0.0.0", "127.0.0.1")
            for number, address in enumerate((by_token, f"{start}/")):  # the second by the cookie
                tab.call("Page.navigate", url=address)
                tab.wait("document.body?.innerText.includes('wrist.yaml')")
                until(lambda number=number: max(page.server.get_clients(), default=-1) >= number, "a connected tab")  # type: ignore[misc]
            # Another site of the same browser, which has the cookie.
            connected = set(page.server.get_clients())
            tab.call("Page.navigate", url=f"http://127.0.0.1:{site.server_port}/")
            tab.wait("document.title === 'kept out'")
            (frame,) = tab.call("Page.getFrameTree")["frameTree"]["childFrames"]
            assert frame["frame"]["unreachableUrl"] == f"{start}/"
            assert set(page.server.get_clients()) <= connected
    finally:
        site.shutdown()
        site.server_close()
        page.close()


@pytest.mark.slow
@pytest.mark.long
def test_a_field_is_made_and_a_tool_is_drawn_tuned_and_saved(tmp_path: Path) -> None:
    asset = Path(shutil.copy(ROOT / "samples" / "trousers.glb", tmp_path))
    session = Session(asset)
    page = Page(session)
    try:
        # The tab begins there. One that is turned later may turn to where it begins once more.
        page.server.initial_camera.position, page.server.initial_camera.look_at = CAMERA, SEEN
        with in_browser(tmp_path, page.address) as tab:
            until(page.server.get_clients, "a connected tab")
            (client,) = page.server.get_clients().values()
            until(lambda: np.allclose(client.camera.position, CAMERA), "a view of the knee")
            take_picture(tab, "opened")

            tab.press_button("Field")
            tab.click(*on_screen(page, KNEE[0]))
            tab.wait("document.body.innerText.includes('field_1 is new')")
            tab.press("h", code=72)
            tab.wait("document.body.innerText.includes('compressed by')")
            take_picture(tab, "field")
            tab.press("h", code=72)
            tab.press_button("Delete")
            until(lambda: not session.tools(), "a deleted field")

            tab.press_button("Muscle")
            until(lambda: page._pointer._new == "muscles", "a muscle that is begun")
            tab.press("Escape", code=27)
            until(lambda: page._pointer._new is None, "none any more")
            tab.press("?", code=191, modifiers=8)
            tab.wait("document.body.innerText.includes('B: Before or after')")
            tab.press_button("Tool")
            tab.wait("document.body.innerText.includes('Click where the tool begins')")
            tab.click(*on_screen(page, KNEE[0]))
            tab.wait("document.body.innerText.includes('Now click where it ends')")
            tab.click(*on_screen(page, KNEE[0]))
            tab.wait("document.body.innerText.includes('Click another place, or Cancel')")
            tab.move(on_screen(page, KNEE[1]))
            scene = page._viewport._scene
            until(lambda: scene._line is not None and scene._line.visible, "a line to the mouse")
            line = scene._line
            assert line is not None
            until(lambda: np.allclose(line.points[[0, -1], [0, 1]], KNEE, atol=0.01), "its end where the mouse is")
            take_picture(tab, "pointed")
            tab.click(*on_screen(page, KNEE[1]))
            tab.wait("document.body.innerText.includes('wrinkle_1 is new')")
            assert not line.visible
            take_picture(tab, "drawn")

            drawn, lower = session.text, KNEE[1] - [0.0, 0.02, 0.0]
            hold_end(tab, page, session, lower)
            tab.release(on_screen(page, lower))
            until(lambda: KNEE[1][1] - yaml.safe_load(session.text)["tools"][0]["target"][1] > 0.015, "a dragged end")
            tab.press("z", code=90, modifiers=2)
            until(lambda: session.text == drawn, "an undone drag")

            tab.fill("× bumps", "20")
            until(lambda: session.text.count("bumps: 20"), "more bumps than the slider goes to")
            tab.press_text("× bumps")
            until(lambda: not session.text.count("bumps"), "bumps that are taken away")
            tab.press("z", code=90, modifiers=2)
            until(lambda: session.text.count("bumps: 20"), "bumps that are there again")
            tab.fill("× bumps", "5")
            until(lambda: session.text.count("bumps: 5"), "five bumps")
            tab.fill("time (s)", "0.65")
            take_picture(tab, "scrubbed")

            tab.press_button("Save")
            tab.wait("document.body.innerText.includes('saved as')")
            take_picture(tab, "saved")
    finally:
        page.close()

    saved = asset.with_suffix(".yaml")
    (tool,) = load_tools(saved).tools
    np.testing.assert_allclose(np.array([tool.origin, tool.target]), KNEE, atol=0.02)
    (edited,) = session.tools()
    assert {"bumps", "origin", "target", "width"} < edited.own
    numbers = {key: edited.values[key] for key in edited.own}
    by_hand = tmp_path / "by_hand.yaml"
    by_hand.write_text(f"version: 1\ntools:\n  - {json.dumps(numbers)}\n")
    outputs = [tmp_path / "edited.glb", tmp_path / "by_hand.glb"]
    for tools, out in zip((saved, by_hand), outputs, strict=True):
        wrinklecli.bake(asset, tools, out, clips=["squat"], max_levels=1)
    assert outputs[0].read_bytes() == outputs[1].read_bytes()


@pytest.mark.slow
@pytest.mark.long
def test_a_row_switches_its_tool_a_place_shows_its_compression_and_shift_turns_the_light(
    folder: Path, tmp_path: Path
) -> None:
    session = Session(folder / "limb.glb", folder / "tools.yaml")
    page = Page(session)
    viewport = page._viewport
    try:
        with in_browser(tmp_path, page.address) as tab:
            until(page.server.get_clients, "a connected tab")
            (client,) = page.server.get_clients().values()
            greatest = session.greatest_moves()["a"]
            tab.wait(f"document.body.innerText.includes('{100 * greatest:.0f} %')")
            take_picture(tab, "rows")
            for label, enabled in (("on", False), ("off", True)):
                tab.press_button(label)
                until(lambda enabled=enabled: session.tools()[0].enabled is enabled, label)  # type: ignore[misc]

            tab.press_button("Tool")
            place = np.array([0.0, 0.0, 0.25])
            (mesh,) = viewport.shown
            compressed = session.compressed(mesh.source)
            assert compressed is not None
            (loss,), _ = compressed.at(place[None])

            def hovered() -> bool:
                tab.move(on_screen(page, place))
                return f"Here {100 * loss:.0f} %, at" in viewport._here

            until(hovered, "the compression under the mouse")
            take_picture(tab, "compression")
            start = client.camera.position.copy()
            tab.press_button("a")
            until(lambda: viewport._compressed is None and page.chosen == "a", "a row ends what was begun")
            until(lambda: not np.allclose(client.camera.position, start), "a view of the tool")
            tab.press("Escape", code=27)

            width, height = client.camera.image_width, client.camera.image_height
            eye, middle, side = client.camera.position.copy(), (width / 2, height / 2), (width - 20, height / 2)
            tab.drag([middle, side], shift=True)
            until(lambda: [light.visible for light in viewport._lights] == [True, False, False], "one light")
            until(lambda: axes_of(client.camera)[:, 0] @ viewport._lights[0].position > 0.8e6, "light from the right")
            take_picture(tab, "light")
            assert np.allclose(client.camera.position, eye), "the view is not turned"
            tab.press("l", code=76)
            until(lambda: all(light.visible for light in viewport._lights), "light from all sides")
            assert tab.errors == []
    finally:
        page.close()


@pytest.mark.slow
@pytest.mark.long
def test_a_mask_is_painted_on_the_skin_and_named_by_the_tool(tmp_path: Path) -> None:
    asset, tools = (shutil.copy(ROOT / each, tmp_path) for each in ("samples/wrist.glb", "configs/wrist.yaml"))
    session = Session(asset, tools)
    page = Page(session)
    try:
        with in_browser(tmp_path, page.address) as tab:
            until(page.server.get_clients, "a connected tab")
            (client,) = page.server.get_clients().values()
            tab.press_button("palm_side")
            tab.wait("document.body.innerText.includes('is tallest')")
            assert not page._materials._waiting
            tab.press_text("Materials")
            until(lambda: page._materials._pictures, "materials that are drawn as their folder opens")
            tab.press("Escape", code=27)
            until(lambda: not page._materials._waiting, "no more of them")
            tab.press_text("Materials")
            # viser's note about drawing without a GPU has its button over the tool.
            closes = "document.querySelector('.mantine-Notification-root button')"
            tab.press_element(closes)
            tab.wait(f"!{closes}")
            tab.press_button("Paint mask")
            tab.wait("!!document.querySelector('[data-brush]')")
            eye = client.camera.position.copy()
            places = page._viewport._scene._dots
            ends = [np.array(places["anchor", number].position) for number in (0, 1)]
            tab.drag([on_screen(page, place) for place in (ends[0], ends.pop())])
            canvas = page._brush._canvas
            assert canvas is not None
            until(lambda: (canvas.pixels < 128).any(), "what is painted")
            take_picture(tab, "mask")
            assert np.allclose(client.camera.position, eye), "the view is not turned"
            tab.press_button("Mask is done")

            def named() -> object:
                tools = {each["name"]: each for each in yaml.safe_load(session.text)["tools"]}
                return tools["palm_side"].get("mask")

            until(lambda: named() == {"image": "wrist.palm_side_1.png"}, "a mask that the tool names")
            assert (tmp_path / "wrist.palm_side_1.png").exists()
            tab.press("z", code=90, modifiers=2)
            until(lambda: named() is None, "a mask that is taken away")
            take_picture(tab, "mask_undone")
    finally:
        page.close()


@pytest.mark.slow
@pytest.mark.long
def test_a_proposal_is_pictured_pointed_at_taken_and_compared(tmp_path: Path) -> None:
    session = Session(limb(tmp_path / "limb.glb"))
    page = Page(session)
    card = "document.querySelector('[data-over] img')"
    try:
        with in_browser(tmp_path, page.address) as tab:
            until(page.server.get_clients, "a connected tab")
            tab.wait("document.body.innerText.includes('Find places proposes tools')")
            tab.press_button("Find places")
            tab.wait(f"{card}?.complete && {card}.naturalWidth > 0")
            tab.point_at(card)
            take_picture(tab, "suggested")
            until(lambda: "(suggested)" in page._viewport._scene._lines, "an outline of what is under the mouse")
            tab.point_at("document.querySelector('canvas')")
            until(lambda: "(suggested)" not in page._viewport._scene._lines, "no outline any more")

            tab.press_button("Take")
            until(session.tools, "a tool")
            name = session.tools()[0].name
            tab.wait(f"document.body.innerText.includes('{name} is tallest at')")
            raised = session.raised(name)
            assert raised is not None
            assert page.player.clip == raised.clip.name
            take_picture(tab, "taken")
            (client,) = page.server.get_clients().values()
            eye = client.camera.position.copy()
            tab.press_text("Materials")
            tab.press_text("Skin")
            until(lambda: "material: skin" in session.text, "a material by a press on its picture")
            tab.wait(f"document.body.innerText.includes('{name}: Skin')")
            assert np.allclose(client.camera.position, eye)
            wrinkled = page._viewport.shown
            tab.press("b", code=66)
            until(lambda: page._viewport.shown is not wrinkled and not page._viewport._wrinkled.value, "no wrinkles")
            take_picture(tab, "before")
    finally:
        page.close()


@pytest.mark.slow
@pytest.mark.long
def test_a_bake_with_contact_is_cancelled_and_shown(tmp_path: Path) -> None:
    pytest.importorskip("ipctk", reason="needs the extra `contact`")
    session = Session(*elbow().write(tmp_path, contact="resolve"))
    page = Page(session)
    try:
        with in_browser(tmp_path, page.address) as tab:
            until(page.server.get_clients, "a connected tab")
            tab.press_button("elbow")
            tab.wait("document.body.innerText.includes('is tallest')")
            tab.wait("document.body.innerText.includes('which Bake resolves')")
            tab.press_button("Bake")
            tab.wait("document.body.innerText.includes('Escape cancels it')")
            tab.press("Escape", code=27)
            tab.wait("document.body.innerText.includes('the bake was cancelled')")
            tab.press_button("Bake")
            tab.wait("document.body.innerText.includes('shows it in place')")
            tab.press_text("View")
            tab.press_text("baked file")
            until(lambda: page._viewport._is_baked, "the baked file")
            take_picture(tab, "contact")
            # What is shown touches, where the edited tools go through each other.
            page.work.put("go", lambda: page.player.go(CLIP, 1.0))
            until(lambda: page.player.time == 1.0, "the deepest moment")
            (shown,) = page._viewport.shown
            (edited,) = session.meshes(CLIP, 1.0)
            assert np.abs(shown.positions[: len(edited.positions)] - edited.positions).max() > 0.005
            take_picture(tab, "contact_deepest")
            # An edit withdraws it.
            tab.fill("× bumps", "3")
            until(lambda: page._viewport.shown[0].source.ground.rig is not shown.source.ground.rig, "withdrawn")
    finally:
        page.close()


@contextmanager
def started(folder: Path, *, browser: str = "true") -> Iterator[tuple[subprocess.Popen[str], str]]:
    """`wrinkle edit` of a limb in a process of its own, and the address that it prints."""
    command = [sys.executable, "-m", "wrinklecli", "edit", "limb.glb", "tools.yaml", "--port", "0"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "BROWSER": browser, "XDG_CONFIG_HOME": f"{folder}_own"}
    server = subprocess.Popen(
        command, cwd=folder, env=environment, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    )
    assert server.stdout
    try:
        yield server, server.stdout.readline().strip()
    finally:
        server.terminate()
        server.wait()
        server.stdout.close()


@pytest.mark.slow
@pytest.mark.long
def test_another_asset_of_the_folder_or_edited_before_is_opened_at_the_same_address(
    folder: Path, tmp_path: Path
) -> None:
    shutil.copy(ROOT / "samples" / "wrist.glb", folder)
    write_tools(folder / "wrist.yaml", tool(name="over", origin=[-0.03, -0.02, 0], target=[0.03, -0.02, 0]))
    (folder / "broken.glb").write_bytes(b"no glTF")
    far = str(limb(tmp_path / "far.glb", rings=8, sides=6))
    remember(f"{folder}_own/wrinkle/recent.json", {far: str(tmp_path / "its.yaml")})
    with started(folder) as (_, address), in_browser(tmp_path, address) as tab:
        here = [("broken.glb", "broken.glb: "), ("wrist.glb", "wrist.yaml"), ("limb.glb", "tools.yaml")]
        for name, words in (*here, (far, "its.yaml"), (str(folder / "wrist.glb"), "wrist.yaml")):
            tab.press_field("open")
            tab.press_text(name)
            tab.wait(f"document.body.innerText.includes({words!r})")
            take_picture(tab, f"opened_{Path(name).name}")
        # The page connects anew until the other asset is served.
        assert [each for each in tab.errors if "ERR_CONNECTION_REFUSED" not in each] == []
    assert [*recent(f"{folder}_own/wrinkle/recent.json")][:2] == [str(folder / "wrist.glb"), far]


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("size", [(1280, 720), (800, 600), (480, 800)], ids=lambda size: str(size[0]))
def test_nothing_covers_the_view_the_panel_or_the_strip_below_however_small_the_page_is(
    size: tuple[int, int], tmp_path: Path
) -> None:
    asset, tools = (shutil.copy(ROOT / each, tmp_path) for each in ("samples/wrist.glb", "configs/wrist.yaml"))
    page = Page(Session(asset, tools))
    try:
        with browsing(tmp_path, page.address, size, drawn=bool(SCREENSHOTS)) as tab:
            tab.wait("document.body?.innerText.includes('no warnings')")
            take_picture(tab, f"page_{size[0]}")
            # viser's note about drawing without a GPU leaves the view to the mouse.
            middle = "(each => { const {x, y, width, height} = each.getBoundingClientRect(); "
            middle += "return document.elementFromPoint(x + width / 2, y + height / 2); })"
            notes = f"[...document.querySelectorAll('.mantine-Notification-root')].map({middle})"
            tab.wait(f"{notes}.every(each => !each.closest('.mantine-Notification-root'))")
            tab.value("document.querySelectorAll('.mantine-Notifications-root').forEach(each => each.remove())")
            box = "(each => { const {left, top, right, bottom} = each.getBoundingClientRect(); "
            box += "return [left, top, right, bottom]; })"
            said = tab.value(f"{box}(document.querySelector('[style*=\"z-index:5\"]'))")
            button = "[...document.querySelectorAll('button')].find(each => each.innerText === {!r})"
            for label in ("Save", "Redo", "Touch", "Find places"):
                place = tab.value(f"{box}({button.format(label)})")
                assert said[2] <= place[0] or said[3] <= place[1], label
                assert min(place[:2]) >= 0, label
                assert place[2] <= size[0], label
            tab.press_button("palm_side")
            tab.wait("document.body.innerText.includes('is tallest')")
            assert tab.value("document.documentElement.scrollWidth") <= size[0]
            # The scroll bar, of 10 pixels, leaves the widgets free.
            ends = f"[...document.querySelectorAll('button, input')].map(each => {box}(each)[2])"
            assert max(tab.value(ends)) <= size[0] - 10
            # The strip spans the view's width below it, and the curve lies in the strip.
            view = tab.value(f"{box}(document.querySelector('canvas[data-engine]'))")
            strip = "document.querySelector('[data-strip]').closest('[data-floating-window], .mantine-Tabs-root')"
            place = tab.value(f"{box}({strip})")
            assert (place[0], view[2] - place[2] <= 10) == (view[0], True)
            assert view[3] <= place[1] < place[3] == size[1]
            assert view[3] > size[1] / 3
            tab.wait(f"{strip}.querySelectorAll('.uplot').length === 1")
            # A click in the view, down to its last line, and on whatever the strip holds, reaches what it should.
            shown = f"[...{strip}.querySelectorAll('button, input')].filter(each => each.getClientRects().length)"
            covered = f"{shown}.filter(each => !each.parentElement.contains({middle}(each)))"
            tabs = f"[...{strip}.querySelectorAll('[data-dock-tab], [role=tab]')]"
            for title in ("View", "Pose", "Play"):
                tab.press_element(f"{tabs}.find(each => each.innerText.trim() === {title!r})")
                mark = f"{strip}.querySelector('[data-strip={title.lower()}]')"
                tab.wait(f"{mark}?.parentElement.parentElement.getClientRects().length === 1")
                tab.wait(f"{covered}.length === 0")
                take_picture(tab, f"page_{size[0]}_{title}")
            tab.wait(f"document.elementFromPoint({(view[0] + view[2]) / 2}, {view[3] - 2}).tagName === 'CANVAS'")
            assert tab.errors == []
    finally:
        page.close()


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A limb and a tools file of one tool."""
    made = tmp_path / "made"
    made.mkdir()
    limb(made / "limb.glb", rings=8, sides=6)
    write_tools(made / "tools.yaml", tool(name="a", width=0.3, bumps=3))
    return made


@pytest.mark.slow
@pytest.mark.long
def test_a_full_disk_is_said_and_edits_of_a_server_that_was_killed_are_there_again(
    folder: Path, tmp_path: Path
) -> None:
    """A browser is led to the second server by a file, and that browser's command line has no token."""
    tools, own = folder / "tools.yaml", Path(f"{folder}_own")
    old = tools.read_text()
    program, called = tmp_path / "program", tmp_path / "called"
    program.write_text(f'#!/bin/sh\necho "$@" > {called}.part\nmv {called}.part {called}\n')
    program.chmod(0o700)
    with started(folder) as (server, address), in_browser(tmp_path, address) as tab:
        tab.press_button("a")
        most = resource.prlimit(server.pid, resource.RLIMIT_FSIZE, (10, resource.RLIM_INFINITY))
        tab.fill("× bumps", "5")
        tab.wait("document.body.innerText.includes('unsaved edits are not kept there, and a crash loses them')")
        tab.press_button("Save")
        tab.wait("document.body.innerText.includes('tools.yaml: cannot be written: File too large')")
        assert tools.read_text() == old
        assert sorted(each.name for each in folder.iterdir() if each.is_file()) == ["limb.glb", "tools.yaml"]
        resource.prlimit(server.pid, resource.RLIMIT_FSIZE, most)
        tab.press_button("Save")
        tab.wait("document.body.innerText.includes('saved as')")
        saved = tools.read_text()
        assert load_tools(tools).tools[0].bumps == 5

        tab.fill("× bumps", "6")
        until(lambda: [*own.rglob("tools.yaml.*.unsaved")], "unsaved edits")
        server.kill()
        server.wait()
        assert tools.read_text() == saved
        with started(folder, browser=str(program)) as (_, again):
            until(called.exists, "an opened browser")
            opened = called.read_text().strip()
            assert again.partition("token=")[2] not in opened
            tab.call("Page.navigate", url=opened)
            tab.wait("document.body?.innerText.includes('unsaved edits of an earlier session are here again')")
            tab.press_button("Save")
            tab.wait("document.body.innerText.includes('saved as')")
    assert load_tools(tools).tools[0].bumps == 6
    assert sorted(each.name for each in folder.iterdir()) == ["limb.glb", "tools.yaml"]
