"""Draws pictures/edit.png: the page of `wrinkle edit`, with a tool of the sample wrist and its sliders.

`python samples/edit_picture.py [FILE]`. Needs the extras `edit` and `test`, and Chromium.
"""

import shutil
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / "tests"))

from kit.browser import browsing  # noqa: E402 (found only then)
from touch_picture import skin, textured  # noqa: E402
from wrinklecli.editor.page.page import Page  # noqa: E402
from wrinklecli.editor.session import Session  # noqa: E402

SIZE = (1180, 720)  # CSS pixels
SETTLED = "document.body?.innerText.includes('no warnings')"


def main(out: Path) -> None:
    """Draw the picture."""
    with tempfile.TemporaryDirectory() as name:
        asset = Path(name, "wrist.glb")
        asset.write_bytes(textured((HERE / asset.name).read_bytes(), skin()))
        tools = shutil.copy(HERE.parent / "configs" / "wrist.yaml", name)
        page = Page(Session(asset, tools))
        try:
            with browsing(Path(name), page.address, SIZE) as tab:
                tab.wait(SETTLED)
                # viser's note about drawing without a GPU.
                tab.value("document.querySelectorAll('.mantine-Notifications-root').forEach(each => each.remove())")
                tab.press_button("palm_side")
                tab.wait("document.body.innerText.includes('is tallest')")
                tab.point_at("document.querySelector('canvas')")
                tab.screenshot(out)
        finally:
            page.close()


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else HERE / "pictures" / "edit.png")
