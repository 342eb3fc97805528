"""`wrinkle edit` opens a browser by a file that its user alone may read."""

import stat
import tempfile
import webbrowser
from pathlib import Path
from urllib.parse import urlsplit
from urllib.request import url2pathname

import click
import pytest

from kit.limb import limb
from wrinklecli.cli.edit import _browser_at, edit
from wrinklecli.editor.page import page as pages
from wrinklecli.editor.recent import recent, remember

ADDRESS = "http://127.0.0.1:8765/?token=secret&more"


@pytest.mark.parametrize(("folder", "temporary"), [("a #%20ä", "tmp"), ("absent", "tmp"), ("absent", "absent")])
def test_a_file_that_nobody_else_reads_leads_to_the_page(
    folder: str, temporary: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in {folder, temporary} - {"absent"}:
        (tmp_path / name).mkdir()
    opened: list[str] = []
    monkeypatch.setattr(webbrowser, "open", opened.append)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / temporary))
    with _browser_at(ADDRESS, str(tmp_path / folder)):
        assert len(opened) == (temporary != "absent")  # else the user opens the printed address
        for address in opened:
            assert "secret" not in address
            path = Path(url2pathname(urlsplit(address).path))
            assert 'content="0; url=http://127.0.0.1:8765/?token=secret&amp;more"' in path.read_text()
            assert [stat.S_IMODE(each.stat().st_mode) for each in (path, path.parents[1])] == [0o600, 0o700]
            assert path.parents[2].name == (temporary if folder == "absent" else folder)
    assert not [each for each in tmp_path.rglob("*") if each.name not in (folder, temporary)]


class OpenedError(Exception):
    """Ends the command where its page would be served."""


@pytest.mark.parametrize(("host", "listed"), [("127.0.0.1", True), ("localhost", True), ("0.0.0.0", False)])
def test_only_a_page_of_this_machine_opens_what_was_edited_elsewhere(
    host: str, listed: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    kept = Path(click.get_app_dir("wrinkle"), "recent.json")
    remember(str(kept), {"/elsewhere/a.glb": "/elsewhere/b.yaml"})

    def opened(*_: object, known: dict[str, str], **_options: object) -> None:
        assert known == ({"/elsewhere/a.glb": "/elsewhere/b.yaml"} if listed else {})
        raise OpenedError

    monkeypatch.setattr(pages, "Page", opened)
    with pytest.raises(OpenedError):
        edit.main([str(limb(tmp_path / "limb.glb", rings=3, sides=4)), "--host", host], standalone_mode=False)
    assert [*recent(str(kept))] == ["/elsewhere/a.glb"]
