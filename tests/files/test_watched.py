"""Files that others write are read when they are written, not before."""

from pathlib import Path

from wrinklecli.files.watched import Watched


def test_a_change_counts_once_it_has_stayed(tmp_path: Path) -> None:
    path = tmp_path / "limb.glb"
    watched = Watched([path, tmp_path / "tools.yaml"])
    assert not watched.changed()
    path.write_text("a")
    assert not watched.changed()
    path.write_text("abc")
    assert not watched.changed()
    assert watched.changed()
    assert not watched.changed()
    # What has changed since is not lost where more is watched.
    path.write_text("abcd")
    (tmp_path / "limb.bin").write_text("a")
    more = watched.instead([tmp_path / "limb.bin", path])
    assert more.changed()
    assert not more.changed()
    watched.changed()
    assert watched.changed()
    path.unlink()
    assert [watched.changed() for _ in range(3)] == [False, True, False]
