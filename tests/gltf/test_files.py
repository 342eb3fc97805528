"""The files that an asset names, without a look at its content."""

import json
from pathlib import Path

import pytest

from kit.limb import limb_asset
from wrinklecli.gltf.files import files_named, path_beside


@pytest.mark.parametrize("suffix", [".gltf", ".glb"])
def test_an_asset_names_its_buffers_and_images(suffix: str, tmp_path: Path) -> None:
    asset = limb_asset(rings=3, sides=3)
    asset.gltf["images"] = [{"uri": "tex/my%20skin.png"}, {"uri": "data:,"}, {"bufferView": 0}, {"uri": "../up.png"}]
    path = asset.write(tmp_path / f"limb{suffix}")
    named = {path, tmp_path / "tex" / "my skin.png", tmp_path / ".." / "up.png"}
    named |= {tmp_path / "limb.bin"} if suffix == ".gltf" else set()
    assert set(map(Path, files_named([path]))) == named


@pytest.mark.parametrize(
    "content",
    [b"", b"glTF", b"[1]", b"{", b'{"buffers": 3, "uri": 1}', b'{"buffers": [{"uri": 3}]}', b"[" * 10**5 + b'"uri"'],
)
def test_a_damaged_asset_names_only_itself(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "a.gltf"
    path.write_bytes(content)
    assert list(files_named([path, tmp_path / "none.glb"])) == [str(path), str(tmp_path / "none.glb")]


def test_an_escape_does_not_hide_a_reference(tmp_path: Path) -> None:
    path = tmp_path / "a.gltf"
    path.write_text(r'{"buffers": [{"\u0075ri": "b.bin"}]}')
    assert list(files_named([path])) == [str(path), str(tmp_path / "b.bin")]


@pytest.mark.parametrize("uri", ["http://example.com/a.png", "file:///etc/passwd", "memory:x", "C:/a.png", "a%00b"])
def test_a_url_names_no_file(uri: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A name that is a URL would be read as one in the current folder, where nothing stands before it."""
    monkeypatch.chdir(tmp_path)
    Path("a.gltf").write_text(json.dumps({"images": [{"uri": uri}]}))
    assert path_beside("a.gltf", uri, external=True) is None
    assert list(files_named(["a.gltf"])) == ["a.gltf"]
