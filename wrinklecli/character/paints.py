"""Read the base colours of a surface from materials, vertices and textures, and look textures up between pixels."""

from collections.abc import Sequence
from functools import partial
from itertools import product

import numpy as np

from wrinklecli.character.scene import ScenePrimitive, material_of
from wrinklecli.errors import AssetError, TooMuchError
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.document import Document
from wrinklecli.gltf.images import read_image
from wrinklecli.gltf.pixels import Bytes, linear_rgb, read_alpha, read_pixels
from wrinklecli.gltf.shape import Json
from wrinklecli.numeric.arrays import Array, Floats, Ints
from wrinklecli.numeric.memory import once

Colour = tuple[float, float, float]

# Continuations of a texture, by the numbers of a sampler (glTF 2.0 §5.26); other numbers mean "repeat".
WRAPS = {33071: "clamp", 33648: "mirror", 10497: "repeat"}
# Linear values of the 256 sRGB ones.
_DECODED = linear_rgb(np.arange(256) / 255.0).astype(np.float32)


@dataclass(frozen=True, slots=True, eq=False)
class Texture:
    """A (height, width, channels) image of a surface, as a rule sRGB; equal only to itself.

    `wraps` says how it continues beyond [0, 1], across and down: by "repeat", "mirror" or "clamp".
    """

    pixels: Bytes
    wraps: tuple[str, str] = ("repeat", "repeat")


@dataclass(frozen=True, slots=True)
class Opacity:
    """The visible part of a primitive whose `alphaMode` is MASK or BLEND.

    Attributes:
        alphas: (vertices,).
        cutoff: Alpha from which on a point shows; infinite for BLEND, where alpha is opacity.
        texture: Its one channel multiplies the alpha.
    """

    alphas: Floats
    cutoff: float
    texture: Texture | None


@dataclass(frozen=True, slots=True)
class Paint:
    """The base colours of a primitive: (vertices, 3) linear RGB, times a texture at (vertices, 2) coordinates.

    `opacity` is what shows of it; None for all.
    """

    colours: Floats
    coordinates: Floats
    texture: Texture | None
    opacity: Opacity | None = None


def read_paints(document: Document, primitives: Sequence[ScenePrimitive]) -> tuple[list[Paint], list[str]]:
    """Read the paint of each primitive, and a warning for each one whose texture cannot be read.

    Raises:
        AssetError: Colours of vertices are malformed.
    """
    textures: dict[str, Texture] = {}
    masks: dict[str, Texture | None] = {}
    paints, warnings = [], []
    for source in primitives:
        primitive = document.items("meshes")[source.rig.mesh]["primitives"][source.primitive]
        count = len(source.vertices.positions)
        texture, mask, coordinates = None, None, np.zeros((count, 2))
        cutoff = _cutoff(material_of(document, primitive))
        try:
            info = texture_info(document, primitive)
            if info:
                coordinates = texture_coordinates(document, primitive, info, count)
                key = repr(info)
                texture = once(textures, key, partial(read_texture, document, info))
                mask = once(masks, key, partial(_mask, document, info)) if cutoff > 0 else None
        except (AssetError, TooMuchError, ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
            # Without a texture a picture still shows the wrinkles.
            warnings.append(f"{source.where}: drawn without its texture: {error}")
        opacity = Opacity(_alphas(document, primitive, count), cutoff, mask) if cutoff > 0 else None
        paints.append(Paint(source.colour * vertex_colours(document, primitive, count), coordinates, texture, opacity))
    return paints, warnings


def read_opacity(document: Document, primitive: Json, count: int) -> Opacity | None:
    """Read how opaque a primitive of so many vertices is; None if all shows. Errors are those of `read_texture`."""
    cutoff, info = _cutoff(material_of(document, primitive)), texture_info(document, primitive)
    mask = _mask(document, info) if info and cutoff > 0 else None
    return Opacity(_alphas(document, primitive, count), cutoff, mask) if cutoff > 0 else None


def _mask(document: Document, info: Json) -> Texture | None:
    """Read the alpha of a texture, if it has any, as `read_texture` does."""
    data, wraps = _image(document, info)
    alpha = read_alpha(data)
    return None if alpha is None else Texture(alpha, wraps)


def texture_info(document: Document, primitive: Json, key: str = "baseColorTexture") -> Json:
    """The entry of a texture in a primitive's material, of its base colour if not said; empty if there is none."""
    if "material" not in primitive:
        return {}
    material = document.item("materials", primitive["material"], user=document.path)
    info: Json = material.get("pbrMetallicRoughness", {}).get(key, {})
    return info


def _cutoff(material: Json) -> float:
    """The alpha from which on a material shows; infinite if alpha is its opacity, 0 if all shows."""
    cutoff = material.get("alphaCutoff", 0.5)
    masked = float(cutoff) if isinstance(cutoff, int | float) and cutoff > 0 else 0.0
    return {"MASK": masked, "BLEND": np.inf}.get(str(material.get("alphaMode")), 0.0)


def _alphas(document: Document, primitive: Json, count: int) -> Floats:
    """(vertices,) alpha of a material and of COLOR_0."""
    look = material_of(document, primitive).get("pbrMetallicRoughness")
    factors = look.get("baseColorFactor") if isinstance(look, dict) else None
    alphas = np.ones(count)
    if "COLOR_0" in primitive["attributes"]:
        stored = document.accessor(primitive["attributes"]["COLOR_0"])
        alphas = np.nan_to_num(stored[:, 3].astype(np.float64)) if stored.shape == (count, 4) else alphas
    if isinstance(factors, list) and len(factors) == 4 and isinstance(factors[3], int | float):
        alphas = alphas * factors[3]
    return alphas


def read_texture(document: Document, info: Json) -> Texture:
    """Read the texture of an entry; AssetError if its file may not be read, ValueError if it is malformed."""
    data, wraps = _image(document, info)
    return Texture(read_pixels(data), wraps)


def _image(document: Document, info: Json) -> tuple[bytes | memoryview, tuple[str, str]]:
    """The bytes of a texture's image, and how it continues beyond its borders."""
    where = document.where("textures")
    texture = document.item("textures", info.get("index"), user=where)
    webp = texture.get("extensions", {}).get("EXT_texture_webp", {})
    number = webp.get("source", texture.get("source"))
    document.item("images", number, user=where)
    data, _ = read_image(document, number)
    sampler = document.item("samplers", texture["sampler"], user=where) if "sampler" in texture else {}
    across, down = (WRAPS.get(sampler.get(key, 0), "repeat") for key in ("wrapS", "wrapT"))
    return data, (across, down)


def texture_coordinates(document: Document, primitive: Json, info: Json, count: int) -> Floats:
    """(vertices, 2) texture coordinates; AssetError if the primitive has none."""
    transform = info.get("extensions", {}).get("KHR_texture_transform", {})
    name = f"TEXCOORD_{transform.get('texCoord', info.get('texCoord', 0))}"
    if name not in primitive["attributes"]:
        raise AssetError(f"has no {name}", where=document.path)
    return transformed(_attribute(document, primitive, name, count, 2), transform)


def transformed(coordinates: Floats, transform: Json) -> Floats:
    """(vertices, 2) texture coordinates, scaled, turned and moved, in this order, as KHR_texture_transform says.

    Raises:
        TypeError, ValueError: The extension is malformed.
    """
    offset, scale = (np.array(transform.get(key, (x, x)), float).reshape(2) for key, x in (("offset", 0), ("scale", 1)))
    turn = float(transform.get("rotation", 0.0))
    x, y = (coordinates * scale).T
    turned = np.stack([x * np.cos(turn) + y * np.sin(turn), y * np.cos(turn) - x * np.sin(turn)], axis=1)
    return np.asarray(turned + offset)


def vertex_colours(document: Document, primitive: Json, count: int) -> Floats:
    """(vertices, 3) linear RGB factors; white for a primitive without COLOR_0."""
    if "COLOR_0" not in primitive["attributes"]:
        return np.ones((count, 3))
    return np.clip(_attribute(document, primitive, "COLOR_0", count, 3), 0.0, 1.0)


def _attribute(document: Document, primitive: Json, name: str, count: int, size: int) -> Floats:
    """(vertices, size) first numbers of an attribute; AssetError if it is malformed."""
    values = document.accessor(primitive["attributes"][name])
    if values.ndim != 2 or len(values) != count or values.shape[1] < size or not np.isfinite(values).all():
        raise AssetError(f"{name} must hold {size} finite numbers for {count} vertices", where=document.path)
    return values[:, :size].astype(np.float64)


def look_up(texture: Texture, places: Floats, values: Array = _DECODED) -> Array:
    """(places, channels) of a texture at (places, 2) coordinates, interpolated between the four nearest pixels.

    `values` are those of the 256 stored ones: linear RGB if not said.
    """
    rows, columns = texture.pixels.shape[:2]
    scaled = places * (columns, rows) - 0.5
    floor = np.floor(scaled)
    fractions = (scaled - floor).astype(np.float32)
    mixed = np.zeros((len(places), texture.pixels.shape[2]), np.float32)
    for right, down in product((0, 1), (0, 1)):
        across = fractions[:, 0] if right else 1 - fractions[:, 0]
        weight = across * (fractions[:, 1] if down else 1 - fractions[:, 1])
        x = _wrapped(floor[:, 0] + right, columns, texture.wraps[0])
        y = _wrapped(floor[:, 1] + down, rows, texture.wraps[1])
        mixed += weight[:, None] * values[texture.pixels[y, x]]
    return mixed


def pixels_at(texture: Texture, places: Floats) -> Ints:
    """(places,) numbers, row by row, of the pixels at (places, 2) coordinates."""
    rows, columns = texture.pixels.shape[:2]
    x, y = np.floor(places * (columns, rows)).T
    return np.asarray(columns * _wrapped(y, rows, texture.wraps[1]) + _wrapped(x, columns, texture.wraps[0]))


def _wrapped(indices: Floats, count: int, wrap: str) -> Ints:
    """Pixel indices, where those beyond the border are wrapped."""
    if wrap == "clamp":
        inside = np.clip(indices, 0, count - 1)
    elif wrap == "repeat":
        inside = np.mod(indices, count)
    else:
        turned = np.mod(indices, 2 * count)
        inside = np.minimum(turned, 2 * count - 1 - turned)
    return np.asarray(inside, np.intp)
