"""What a file is that stands where an asset belongs: said in a line, whatever its name or its bytes tell it by."""

from pathlib import Path

import pytest

from wrinklecli.errors import AssetError
from wrinklecli.gltf.document import read_document


@pytest.mark.parametrize(
    ("name", "data", "words"),
    [
        ("a.fbx", b"Kaydara FBX Binary  \0\x1a\0", ["an FBX file", "export glTF"]),
        ("a.glb", b"Kaydara FBX Binary  \0\x1a\0", ["an FBX file", "export glTF"]),
        ("A.FBX", b"; FBX 7.3.0 project file\n", ["an FBX file"]),
        ("a.blend", b"\x28\xb5\x2f\xfd", ["a Blender file", "File > Export > glTF 2.0"]),
        ("a.usdz", b"PK\x03\x04", ["a USD file", "export glTF"]),
        ("a.glb", b"#usda 1.0\n", ["a USD file"]),
        ("a.zip", b"PK\x03\x04", ["a ZIP archive; unpack it first"]),
        ("character", b"PK\x03\x04", ["a ZIP archive; unpack it first"]),
        ("a.obj", b"# a cube\nv 0 0 0\n", ["an OBJ file", "neither skin nor clips"]),
        ("a.glb", b"\n <!doctype HTML>", ["a web page"]),
        ("a.glb", b"version https://git-lfs.github.com/spec/v1\n", ["Git LFS", "git lfs pull"]),
        ("tools.yaml", b"version: 1\n", ["a tools file (YAML), where a glTF asset (.glb, .gltf) belongs"]),
        ("tools.txt", b"# mine\nversion: 1\ntools:\n", ["a tools file (YAML)"]),
        ("fields.txt", b"version: 1\nfields:\n", ["a tools file (YAML)"]),
        ("a.glb", b"hello", ["neither a .glb nor JSON"]),
    ],
)
def test_a_file_that_is_no_gltf_is_named(name: str, data: bytes, words: list[str], tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_bytes(data)
    with pytest.raises(AssetError) as caught:
        read_document(path)
    (line,) = caught.value.lines
    assert line.startswith(f"{path}: is ")
    assert all(each in line for each in words)
