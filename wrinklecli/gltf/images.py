"""Finds and reads the images of a document, and copies those with relative URIs beside a written file."""

import hashlib
import os
from collections.abc import Iterator

from wrinklecli.errors import BakeError
from wrinklecli.files.outputs import Outputs
from wrinklecli.gltf.document import Document
from wrinklecli.gltf.files import leaves_folder, path_of, read_file, uri_of
from wrinklecli.gltf.shape import Json


def lies_beside(document: Document, out: str) -> bool:
    """True if OUT is in the document's folder, so that relative URIs still work."""
    folder = os.path.realpath(os.path.dirname(document.path))
    return document.resources is None and os.path.realpath(os.path.dirname(out)) == folder


def image_files(document: Document, out: str | os.PathLike[str]) -> list[str]:
    """The image files that writing to `out` reads."""
    if document.resources is not None or lies_beside(document, os.fspath(out)):
        return []
    folder = os.path.dirname(document.path)
    return [os.path.join(folder, path_of(image["uri"])) for image in document.items("images") if _is_a_file(image)]


def files_of(document: Document) -> list[str]:
    """Every file that an asset consists of, read or not, which must not be overwritten.

    Images whose bytes the document has itself are not read from files.
    """
    folder, held = os.path.dirname(document.path), document.resources or {}
    images = [image for image in document.items("images") if _is_a_file(image) and image["uri"] not in held]
    return [*document.files, *(os.path.join(folder, path_of(image["uri"])) for image in images)]


def read_image(document: Document, number: int) -> tuple[memoryview, str | None]:
    """Read the bytes of an image, and give their file, if any; AssetError if the image cannot be read."""
    image, where = document.items("images")[number], document.where("images", number)
    if "uri" not in image:
        return document.view(image.get("bufferView"), user=where), None
    if document.resources is not None and image["uri"] in document.resources:
        return document.resources[image["uri"]], None
    return document.read_uri(image["uri"], where)


def images_to_bring(document: Document, out: str) -> Iterator[tuple[int, memoryview]]:
    """Give index and bytes of each image that a relative URI names but that is not beside OUT.

    Raises:
        AssetError: An image cannot be read.
    """
    if lies_beside(document, out):
        return
    for number, image in enumerate(document.items("images")):
        if _is_a_file(image):
            yield number, read_image(document, number)[0]


def put_image(uri: str, data: memoryview, out: str, outputs: Outputs) -> str:
    """Write an image beside OUT as its URI says, and give this URI, or a new one for an image outside the folder.

    Raises:
        BakeError: Another file has this name, or the image cannot be written.
    """
    folder, stem = os.path.dirname(out), os.path.splitext(os.path.basename(out))[0]
    if leaves_folder(uri):
        digest = hashlib.sha256(data).hexdigest()[:12]
        uri = uri_of(f"{stem}-{digest}{os.path.splitext(path_of(uri))[1]}")
    path = os.path.join(folder, path_of(uri))
    there, refusal = outputs.found(path), "is there already and is another image; choose another folder"
    if there is not None and os.path.getsize(there) == len(data) and read_file(there) == data:
        outputs.protect([there])
    elif there is None:
        outputs.make_folders(os.path.dirname(path))
        outputs.add_new(path, data, refusal)
    elif outputs.is_own(path):
        outputs.add_bytes(path, data)
    else:
        raise BakeError(refusal, where=path)
    return uri


def image_type(head: bytes) -> str:
    """The MIME type, of glTF 2.0 and its texture extensions, of an image with these first 16 bytes."""
    if head.startswith(b"\x89PNG"):
        return "image/png"
    if head[:4] == b"RIFF" and head[8:12] == b"WEBP":
        return "image/webp"
    return "image/ktx2" if head[1:4] == b"KTX" else "image/jpeg"


def _is_a_file(image: Json) -> bool:
    return isinstance(image.get("uri"), str) and not image["uri"].startswith("data:")
