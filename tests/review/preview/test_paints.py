"""Base colours of materials, of vertices and from textures."""

import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from kit.asset import ARRAY_BUFFER, Asset, attribute
from kit.limb import limb_asset
from kit.pictures import SIZE, covered, draw, picture
from wrinklecli.errors import AssetError

Bytes = NDArray[np.uint8]
Json = dict[str, Any]


def test_a_material_shows_its_colour_its_texture_and_the_colours_of_vertices(tmp_path: Path) -> None:
    def drawn(name: str, material: Json, *, colors: bool = False, image: bytes = b"") -> tuple[Bytes, tuple[str, ...]]:
        asset = limb_asset(rings=9, sides=12, colors=colors)
        textured(asset, material, image)
        made = draw([asset.write(tmp_path / f"{name}.glb")], tmp_path / "a.png", rest=True, size=SIZE)
        shown = picture(tmp_path / "a.png")[22:]
        return shown[covered(shown)].mean(axis=0), made.warnings

    green = io.BytesIO()
    Image.new("RGB", (8, 8), (20, 220, 20)).save(green, "PNG")
    plain, _ = drawn("plain", {})
    assert np.ptp(plain) < 15
    red, _ = drawn("red", {"baseColorFactor": [0.8, 0.05, 0.05, 1.0]})
    assert red.argmax() == 0
    assert red[0] > 1.5 * red[1]
    leafy, warnings = drawn("leafy", {"baseColorTexture": {"index": 0}}, image=green.getvalue())
    assert leafy[1] > 1.5 * leafy[0]
    assert warnings == ()
    bare, warnings = drawn("damaged", {"baseColorTexture": {"index": 0}}, image=b"\x89PNG\r\n\x1a\n nothing")
    assert np.abs(bare - plain).max() < 1
    assert len(warnings) == 1
    assert "without its texture" in warnings[0]
    assert np.abs(drawn("vertices", {}, colors=True)[0] - plain).max() > 5


def test_a_masked_material_shows_where_its_alpha_reaches_the_cutoff(tmp_path: Path) -> None:
    lace = Image.new("RGBA", (64, 64), (200, 200, 200, 255))
    lace.paste((0, 0, 0, 100), (0, 0, 64, 32))
    file = io.BytesIO()
    lace.save(file, "PNG")

    def share(*, factor: float = 1.0, **more: Any) -> float:
        asset = limb_asset(rings=9, sides=12)
        look = {"baseColorTexture": {"index": 0}, "baseColorFactor": [1.0, 1.0, 1.0, factor]}
        textured(asset, look, file.getvalue())
        asset.gltf["materials"][0] |= more
        # Seen from the side, half of the limb: the two halves of the texture lie along it.
        uvs = attribute(asset, 0, "TEXCOORD_0")
        uvs[:] = np.stack([uvs[:, 0], (attribute(asset, 0, "POSITION")[:, 0] + 1.0) / 2.0], axis=1)
        draw([asset.write(tmp_path / "a.glb")], tmp_path / "a.png", rest=True, size=SIZE)
        return float(covered(picture(tmp_path / "a.png")[22:]).mean())

    whole = share()
    assert share(alphaMode="BLEND") == whole
    assert share(alphaMode="MASK", alphaCutoff=0.25) == whole
    assert share(alphaMode="MASK", alphaCutoff=0) == whole
    nothing = share(alphaMode="MASK", factor=0.4)  # but for what is written below the picture
    assert share(alphaMode="BLEND", factor=0.0) == nothing
    # The half that stays is the nearer one.
    assert 0.5 < (share(alphaMode="MASK") - nothing) / (whole - nothing) < 0.8


def textured(asset: Asset, material: Json, image: bytes) -> None:
    if image:
        asset.append("images", {"bufferView": asset.view(image, target=ARRAY_BUFFER), "mimeType": "image/png"})
        asset.append("textures", {"source": 0})
    asset.append("materials", {"pbrMetallicRoughness": material})
    for primitive in asset.gltf["meshes"][0]["primitives"]:
        primitive["material"] = 0


@pytest.mark.parametrize(
    "change",
    [
        {"materials": [{"pbrMetallicRoughness": 7}]},
        {"materials": [{"pbrMetallicRoughness": {"baseColorFactor": "red"}}]},
        {"materials": [{"pbrMetallicRoughness": {"baseColorFactor": [{}, 1, 1]}}]},
        {"materials": [{"pbrMetallicRoughness": {"baseColorTexture": []}}]},
        {"materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 9}}}]},
        {"materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0, "texCoord": 7}}}]},
        {"materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0, "extensions": 3}}}]},
        {"textures": [{"source": "x"}]},
        {"images": [{"uri": "../../etc/passwd"}]},
    ],
)
def test_odd_looks_do_not_hide_a_shape(tmp_path: Path, change: Json) -> None:
    asset = limb_asset(rings=5, sides=6)
    textured(asset, {"baseColorTexture": {"index": 0}}, b"\x89PNG\r\n\x1a\n")
    asset.gltf |= change
    draw([asset.write(tmp_path / "a.glb")], tmp_path / "a.png", rest=True, size=(32, 24))
    assert covered(picture(tmp_path / "a.png")).sum() > 30


@pytest.mark.parametrize("kind", ["materials", "textures", "samplers"])
def test_looks_that_are_no_objects_are_refused_by_name(tmp_path: Path, kind: str) -> None:
    asset = limb_asset(rings=5, sides=6)
    textured(asset, {"baseColorTexture": {"index": 0}}, b"\x89PNG\r\n\x1a\n")
    asset.gltf[kind] = [4]
    with pytest.raises(AssetError, match=f"{kind}/0: is 4, not an object"):
        draw([asset.write(tmp_path / "a.glb")], tmp_path / "a.png", rest=True, size=(32, 24))
