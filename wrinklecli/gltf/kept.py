"""What a written file keeps of its source: spans of buffers, and the buffer views that show them.

Source: glTF 2.0 specification, §3.6 (binary data storage).
"""

from dataclasses import dataclass

from wrinklecli.gltf.shape import Json


@dataclass(frozen=True, slots=True)
class KeptBytes:
    """What is kept of a buffer: spans of it, laid one after another.

    Attributes:
        data: The whole buffer.
        spans: Bytes [low, high) that are kept, rising.
    """

    data: memoryview
    spans: tuple[tuple[int, int], ...]

    @property
    def parts(self) -> list[memoryview]:
        """The kept bytes, a part for each span."""
        return [self.data[low:high] for low, high in self.spans]

    @property
    def whole(self) -> bool:
        """Whether all is kept."""
        return sum(high - low for low, high in self.spans) == len(self.data)

    def moved(self, offset: int) -> int:
        """Where among the kept bytes the byte at an offset is; 0 where it is not kept."""
        start = 0
        for low, high in self.spans:
            if low <= offset < high:
                return start + offset - low
            start += high - low
        return 0


@dataclass(frozen=True, slots=True)
class PlacedViews:
    """Copies of a document's buffer views, to be given the places that a written file has for their bytes.

    Attributes:
        views: All of them, for the file's JSON.
        of_source: For each buffer of the source what still shows its bytes: views, or the extensions that compress
            them.
        of_new: Views of new data; `byteOffset` is that in the new data.
    """

    views: list[Json]
    of_source: tuple[list[Json], ...]
    of_new: list[Json]
