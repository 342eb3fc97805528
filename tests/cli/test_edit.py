"""`wrinkle edit` opens a browser by a file that its user alone may read."""

import stat
import tempfile
import webbrowser
from pathlib import Path
from urllib.parse import urlsplit
from urllib.request import url2pathname

import pytest

from wrinklecli.cli.edit import _browser_at

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
