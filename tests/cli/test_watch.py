"""`wrinkle preview --watch`: drawn again whenever a file has changed, whatever is wrong with it meanwhile."""

import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from kit.command import Wrinkle
from kit.limb import limb, write_tools


@pytest.mark.slow
def test_a_picture_is_drawn_again_when_tools_change(
    wrinkle: Wrinkle, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    pytest.importorskip("embreex")
    asset, tools = limb(tmp_path / "limb.glb", rings=8, sides=6), write_tools(tmp_path / "tools.yaml")
    text, drawn = tools.read_text(), []

    def meanwhile() -> Iterator[None]:
        for change in (text.replace("0.3", "0.1"), "tools: [", text):
            drawn.append((tmp_path / "sheet.png").stat().st_mtime_ns)
            tools.write_text(change)
            yield
            yield
        drawn.append((tmp_path / "sheet.png").stat().st_mtime_ns)
        raise KeyboardInterrupt

    changes = meanwhile()
    monkeypatch.setattr(time, "sleep", lambda _seconds: next(changes))
    options = ("--tools", tools, "--rest", "--views", "top", "--size", "64x48", "-o", "sheet.png", "--watch")
    ran = wrinkle("preview", asset, *options)
    assert ran.code == 130
    assert len(drawn) == 4
    assert drawn[0] < drawn[1] == drawn[2] < drawn[3]
    assert sum("YAML" in line for line in ran.lines) == 1
    assert ran.lines.count("watches for changes; Ctrl-C ends it") == 4
