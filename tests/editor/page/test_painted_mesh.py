"""The browser's meshes: what is put into a .glb is read from it again, and the file is valid."""

import io
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from kit.clients import assert_valid
from kit.player import Gltf
from wrinklecli.character.paints import Texture
from wrinklecli.editor.page.painted_mesh import PaintedMesh

POSITIONS = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.25], [0.0, 2.0, 0.5], [1.0, 2.0, -0.75]])
NORMALS = np.tile([0.0, 0.6, 0.8], (4, 1))
COLOURS = np.array([[0.0, 0.2, 0.4], [1.0, 1.5, -0.5], [0.6, 0.8, 1.0], [0.1, 0.3, 0.5]])
PLACES = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [0.25, 0.75]])
TRIANGLES = np.array([[0, 1, 2], [1, 3, 2]])


@pytest.mark.parametrize("texture", [None, Texture(np.full((3, 5, 3), 99, np.uint8), ("mirror", "clamp"))])
def test_a_mesh_is_read_from_its_file_as_it_was(tmp_path: Path, texture: Texture | None) -> None:
    path = tmp_path / "mesh.glb"
    path.write_bytes(PaintedMesh(TRIANGLES, PLACES, texture).glb(POSITIONS, NORMALS, COLOURS))
    assert_valid(path)
    file = Gltf(path)
    assert np.array_equal(file.triangles(0), TRIANGLES)
    assert np.array_equal(file.attribute(0, "POSITION"), POSITIONS)
    assert file.attribute(0, "NORMAL") == pytest.approx(NORMALS)
    shades = file.attribute(0, "COLOR_0")
    assert shades[:, :3] == pytest.approx(COLOURS.clip(0.0, 1.0), abs=0.5 / 255)
    assert (shades[:, 3] == 1.0).all()
    (material,) = file.json["materials"]
    assert material["doubleSided"]
    assert material["pbrMetallicRoughness"]["metallicFactor"] == 0.0
    if texture is not None:
        assert np.array_equal(file.attribute(0, "TEXCOORD_0"), PLACES)
        assert file.json["samplers"] == [{"wrapS": 33648, "wrapT": 33071}]
        (image,) = file.json["images"]
        assert file.view_bytes(image["bufferView"])[:3] == b"\xff\xd8\xff", "a JPEG"


@pytest.mark.parametrize(
    ("height", "width", "sent"), [(1024, 3, (1024, 3)), (2048, 1500, (1024, 750)), (1025, 1, (512, 1))]
)
def test_a_large_texture_is_averaged_for_the_browser(height: int, width: int, sent: tuple[int, int]) -> None:
    rows = np.arange(height, dtype=np.uint8)[:, None, None] % 200
    pixels = np.broadcast_to(rows, (height, width, 3)).copy()
    mesh = PaintedMesh(TRIANGLES, PLACES, Texture(pixels, ("repeat", "repeat")))
    found = np.array(Image.open(io.BytesIO(mesh.image)))
    assert found.shape == (*sent, 3)
    step = height // sent[0]
    means = rows[: sent[0] * step, 0, 0].reshape(-1, step).mean(axis=1)
    assert np.median(np.abs(found[:, 0, 0] - means)) < 4
