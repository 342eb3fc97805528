"""Relative URIs of a document, and the paths of files that they name.

Source: glTF 2.0 §2.8 (URIs); RFC 3986 §2.1. Differs: bytes of a name that are no UTF-8 are percent-encoded too.
"""

import os
from urllib.parse import quote, unquote_to_bytes


def path_of(uri: str) -> str:
    """The path that a relative URI names.

    Raises:
        UnicodeEncodeError: It holds half a character, which no name has.
    """
    return os.fsdecode(unquote_to_bytes(os.fsencode(uri)))


def uri_of(path: str) -> str:
    """The URI that names a path."""
    return quote(os.fsencode(path))
