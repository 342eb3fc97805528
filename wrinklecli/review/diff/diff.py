"""Compare two assets for golden tests: by the meaning of their documents, and by posed positions over time."""

import json
import math
import os
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from wrinklecli.character.clip import read_clips
from wrinklecli.character.pose import joint_matrices
from wrinklecli.character.scene import read_scene
from wrinklecli.choices import FPS
from wrinklecli.errors import AssetError, TooMuchError, counted
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.document import Document, read_document
from wrinklecli.gltf.images import read_image
from wrinklecli.numeric.arrays import Floats
from wrinklecli.numeric.guard import Progress, guarded, log_progress
from wrinklecli.numeric.memory import MAX_MEMORY, Memory
from wrinklecli.review.diff.common_clips import AnimatedScene, common_clips
from wrinklecli.review.diff.compare_motion import compare_motion
from wrinklecli.review.diff.difference import ROUNDINGS, Difference, Limits, Sides
from wrinklecli.review.diff.documents import document_differences
from wrinklecli.review.diff.nodes import pair_nodes
from wrinklecli.review.diff.surfaces import Worst, when
from wrinklecli.tools.records import Length

# On one machine the same bake gives the same bytes; between processors it may differ by eight float32 roundings at the
# asset's size, or at its farthest coordinate where that is more.
DEFAULT_TOLERANCE = Length(1e-4, percent=True)


@dataclass(frozen=True, slots=True)
class Comparison:
    """The result of comparing two assets.

    Attributes:
        differences: All beyond the tolerance; none if the assets are the same.
        tolerance: Scene units; None if both have the same content to the byte, and nothing was measured.
        size: Diagonal of the larger asset's bounding box in the stored pose, scene units; None as above.
        times: Number of moments that were compared, with the stored pose.
        worst: The greatest distance, within the tolerance or not; None if no positions could be compared.
        normal: The greatest angle between normals of a vertex, degrees; None if no normals could be compared.
    """

    differences: tuple[Difference, ...]
    tolerance: float | None
    size: float | None
    times: int
    worst: Worst | None
    normal: float | None

    @property
    def same(self) -> bool:
        """True if nothing differs beyond the tolerance."""
        return not self.differences

    def lines(self, most: int | None = None) -> Iterator[str]:
        """A line for each difference, at most so many of a kind, and the summary."""
        shown: Counter[str] = Counter()
        for each in self.differences:
            shown[each.kind] += 1
            if most is None or shown[each.kind] <= most:
                name = f" ({each.name})" if each.name else ""
                yield f"{each.place or '/'}{name}: {each.message}"
        for kind, count in shown.items():
            if most is not None and count > most:
                yield f"... and {count - most} more of kind {kind}"
        yield self.summary

    @property
    def summary(self) -> str:
        """The result in one line."""
        verdict = "same" if self.same else "different"
        if self.size is None:
            return f"{verdict}: to the byte"
        if self.worst is None:
            return f"{verdict}: no positions to compare"
        what = f"at most {self.worst.distance:.3g} apart"
        if self.worst.distance:
            at = when(self.worst.clip, self.worst.time)
            what += f" ({self.worst.name!r} in {self.worst.side}, vertex {self.worst.vertex}, {at})"
        moments = counted(self.times, "moment")
        angle = f", normals at most {self.normal:.3g} degrees" if self.normal else ""
        return f"{verdict}: {what}{angle}; tolerance {self.tolerance:.3g}, {moments}"


@dataclass(frozen=True, slots=True)
class DiffOptions:
    """Options of `diff`.

    Attributes:
        tolerance: The greatest distance at which two assets are the same: scene units, or per cent of the asset's
            size. The same ratio holds for numbers that are not lengths. In per cent it is never below eight float32
            roundings.
        posed: Compare only posed positions.
        clips: Names of the clips to compare; if empty, all clips and the stored pose.
        fps: Frames per second of the times to compare at; the clips' own keys are compared too.
        allow_external: Read buffers and images outside the assets' folders too.
        max_memory: Most bytes that reading both assets may take.
    """

    tolerance: Length = DEFAULT_TOLERANCE
    posed: bool = False
    clips: Sequence[str] = ()
    fps: float = FPS
    allow_external: bool = False
    max_memory: int = MAX_MEMORY


def diff(
    a: str | os.PathLike[str],
    b: str | os.PathLike[str],
    options: DiffOptions | None = None,
    *,
    progress: Progress = log_progress,
    **named: Any,
) -> Comparison:
    """Compare two assets.

    Positions are compared in every clip that both have: meshes with the same triangles in their order, vertex by
    vertex, and all others by the distance of each one's vertices from the other's triangles. `posed` compares nothing
    else, so the documents may differ in everything that a viewer does not see move.

    Args:
        a: The first .gltf or .glb, such as the golden.
        b: The second.
        options: The defaults of `DiffOptions` if None.
        progress: Called with a stage's name, steps done and steps in all.
        named: Single options by their names in `DiffOptions`, in place of those in `options`.

    Raises:
        AssetError: An asset is missing or malformed, or neither has a clip of a name.
        BakeError: A clip has more than 200,000 frames.
        TypeError: `DiffOptions` lacks a name of `named`.

    Examples:
        >>> from wrinklecli import diff
        >>> diff("samples/wrist.glb", "samples/wrist.glb").same
        True
    """
    options = replace(options or DiffOptions(), **named)
    memory = Memory(options.max_memory)
    first, second = (_read(path, allow_external=options.allow_external, memory=memory) for path in (a, b))
    both = f"{first.path} and {second.path}"
    with guarded(both):
        _refuse_unknown(options.clips, (first, second), where=both)
        if _have_same_content(first, second):
            return Comparison((), None, None, 0, None, None)
        # Malformed primitives, which a bake passes through unread, are compared in the documents only.
        one, other = (_read_scene(each, whole=options.posed) for each in (first, second))
        boxes = [_stored_bounds(scene) for scene in (one, other)]
        size = max(float(np.linalg.norm(np.ptp(box, axis=0))) for box in boxes)
        limit = options.tolerance.resolve(size)
        if options.tolerance.percent:
            limit = max(limit, ROUNDINGS * max(float(np.abs(box).max()) for box in boxes))
        # Without positions only other numbers are compared.
        ratio = limit / size if size and limit else DEFAULT_TOLERANCE.value / 100
        found: list[Difference] = []
        if not options.posed:
            nodes, unpaired = pair_nodes(first, second)
            sides = Sides.of(first, second, Limits(limit or ratio, ratio, _scales(one)), nodes)
            found += [*unpaired, *document_differences(sides, clips=options.clips)]
            # Nodes that the documents pair are in one order.
            order = {j: i for i, j in nodes.items()}
            other = replace(
                other, primitives=tuple(sorted(other.primitives, key=lambda each: order.get(each.rig.node, math.inf)))
            )
        clips, of_clips = common_clips(one, other, options.clips, options.fps)
        # The comparison of the documents has found the differences of clips too.
        found += of_clips if options.posed else []
        apart, differences = compare_motion(one, other, clips, limit, progress)
        times = sum(len(common.times) for common in clips)
        worst = max((each.worst for each in apart), key=lambda each: each.distance, default=None)
        normal = max((each.normal for each in apart if each.normal is not None), default=None)
        return Comparison((*found, *differences), limit, size, times, worst, normal)


def _read(path: str | os.PathLike[str], *, allow_external: bool, memory: Memory) -> Document:
    with guarded(os.fspath(path)):
        return read_document(path, allow_external=allow_external, memory=memory)


def _read_scene(document: Document, *, whole: bool) -> AnimatedScene:
    with guarded(document.path):
        return AnimatedScene(read_scene(document, leave_out_malformed=not whole), read_clips(document))


def _refuse_unknown(clips: Sequence[str], documents: tuple[Document, Document], *, where: str) -> None:
    """Check that each clip is in one of the documents."""
    if clips:
        names = list(dict.fromkeys(clip.name for document in documents for clip in read_clips(document)))
        AssetError.unless_known("have no clip", clips, names, where=where)


def _have_same_content(a: Document, b: Document) -> bool:
    """True if two documents have the same JSON and data, to the byte, even if malformed."""
    if a.buffers != b.buffers or json.dumps(a.gltf) != json.dumps(b.gltf):
        return False
    if os.path.realpath(a.path) == os.path.realpath(b.path):
        return True
    try:
        return all(read_image(a, number)[0] == read_image(b, number)[0] for number in range(len(a.items("images"))))
    except (AssetError, TooMuchError):
        return False  # the comparison of images reports the missing file


def _stored_bounds(scene: AnimatedScene) -> Floats:
    """(2, 3) bounds of all visible primitives in the stored pose, scene units; 0 if there are none."""
    stored = [primitive.posed(None, np.zeros(1)) for primitive in scene.primitives]
    shown = [posed.positions[0] for posed in stored if not posed.hidden[0]]
    if not shown:
        return np.zeros((2, 3))
    lows, highs = ([bound(positions, axis=0) for positions in shown] for bound in (np.min, np.max))
    return np.stack([np.min(lows, axis=0), np.max(highs, axis=0)])


def _scales(scene: AnimatedScene) -> dict[int, float]:
    """The mean number of scene units for each bind unit in the stored pose, by mesh."""
    scales: dict[int, float] = {}
    for primitive in scene.primitives:
        matrices = joint_matrices(primitive.rig, None, np.zeros(1), primitive.acting)[0, :, :3, :3]
        shares = primitive.skin.influences.dense().sum(axis=1)
        scale = float(shares @ np.cbrt(np.abs(np.linalg.det(matrices))) / shares.sum())
        if scale > 0:
            scales[primitive.rig.mesh] = max(scale, scales.get(primitive.rig.mesh, 0.0))
    return scales
