"""Bytes of a changed document: spans of the source's buffers, and new data in memory or, if there is much, on disk.

Source: glTF 2.0 specification, §3.6 (binary data storage).
"""

import io
import weakref
from collections.abc import Iterator
from typing import IO

from wrinklecli.errors import BakeError
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.shape import Json

# Bytes: the size of the largest component, and of the padding of GLB chunks.
ALIGNMENT = 4
# Bytes that stay in memory; more data goes to a temporary file.
_SPOOL_BYTES = 2**26
# Bytes that are read back at a time.
_CHUNK_BYTES = 2**20


class NewData:
    """Data appended piece by piece, and `zeros` bytes of zeros, which may grow meanwhile, behind it."""

    def __init__(self) -> None:
        self.zeros = 0
        self._appended = 0
        self._file: IO[bytes] = io.BytesIO()

    def __len__(self) -> int:
        return self.zeros_start + self.zeros if self.zeros else self._appended

    @property
    def zeros_start(self) -> int:
        """Offset of the zeros."""
        return aligned(self._appended)

    def append(self, data: bytes) -> int:
        """Append data at a multiple of 4 bytes, and give its offset; BakeError if the disk is full."""
        start = aligned(self._appended)
        try:
            if start + len(data) > _SPOOL_BYTES and isinstance(self._file, io.BytesIO):
                self._go_to_disk(self._file.getbuffer())
            self._file.seek(self._appended)
            self._file.write(bytes(start - self._appended) + data)
        except OSError as error:
            from tempfile import gettempdir

            raise BakeError(f"cannot be written: {error.strerror or error}", where=gettempdir()) from error
        self._appended = start + len(data)
        return start

    def _go_to_disk(self, data: memoryview) -> None:
        """Go on in a temporary file, as per-frame geometry may be gigabytes."""
        from tempfile import TemporaryFile  # it imports all kinds of archives, and most documents are small

        self._file = TemporaryFile()  # noqa: SIM115
        weakref.finalize(self, self._file.close)
        self._file.write(data)

    def pieces(self) -> Iterator[bytes]:
        """All data in pieces, as there may be more than memory holds."""
        self._file.seek(0)
        while piece := self._file.read(_CHUNK_BYTES):
            yield piece
        yield bytes(len(self) - self._appended)


def aligned(size: int) -> int:
    """The next multiple of the alignment."""
    return size + -size % ALIGNMENT


@dataclass(frozen=True, slots=True)
class KeptBytes:
    """The spans of a buffer that a written file keeps, one after another.

    Attributes:
        data: The whole buffer.
        spans: Sorted ranges [low, high) of bytes.
    """

    data: memoryview
    spans: tuple[tuple[int, int], ...]

    @property
    def parts(self) -> list[memoryview]:
        """The bytes of each span."""
        return [self.data[low:high] for low, high in self.spans]

    @property
    def whole(self) -> bool:
        """True if all bytes are kept."""
        return sum(high - low for low, high in self.spans) == len(self.data)

    def moved(self, offset: int) -> int:
        """Offset among the kept bytes of the byte at an offset in the buffer; 0 if this byte is not kept."""
        start = 0
        for low, high in self.spans:
            if low <= offset < high:
                return start + offset - low
            start += high - low
        return 0


@dataclass(frozen=True, slots=True)
class PlacedViews:
    """Copies of a document's buffer views, whose offsets the writer sets to those in the file.

    Attributes:
        views: All views, for the file's JSON.
        of_source: For each buffer of the source, the views, or the extensions that compress them, which show its bytes.
        of_new: Views of new data; `byteOffset` counts from the start of the new data.
    """

    views: list[Json]
    of_source: tuple[list[Json], ...]
    of_new: list[Json]
