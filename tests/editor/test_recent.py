"""The list of assets that were edited before: a damaged one is none, and one that cannot be written is no error."""

import json
from pathlib import Path

import pytest

from wrinklecli.editor.recent import recent, remember

LISTED = {f"/a/{number}.glb": f"/a/{number}.yaml" for number in range(20)}


def test_the_last_ones_are_listed_first(tmp_path: Path) -> None:
    path = str(tmp_path / "wrinkle" / "recent.json")
    assert recent(path) == {}
    for asset, tools in LISTED.items():
        remember(path, {asset: tools})
    remember(path, {"/a/12.glb": "/b/others.yaml"})
    assert [*recent(path).items()][:2] == [("/a/12.glb", "/b/others.yaml"), ("/a/19.glb", "/a/19.yaml")]
    assert len(recent(path)) == 12


@pytest.mark.parametrize(
    "text", ["", "{", "[]", '{"recent": 1}', '{"recent": [["a"]]}', '{"recent": [[1, 2]]}', "[" * 9999]
)
def test_a_damaged_list_is_none_and_is_written_anew(text: str, tmp_path: Path) -> None:
    path = tmp_path / "recent.json"
    path.write_text(text)
    assert recent(str(path)) == {}
    remember(str(path), LISTED)
    assert len(json.loads(path.read_text())["recent"]) == 12


def test_a_folder_that_cannot_be_written_is_no_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    remember(str(tmp_path / "file" / "recent.json"), LISTED)
    remember(str(tmp_path), LISTED)
    assert recent(str(tmp_path)) == {}
