"""Find the clips that two assets have in common, and the times at which to compare them."""

from collections.abc import Sequence

import numpy as np

from wrinklecli.character.clip import Clip, clip_grid
from wrinklecli.character.scene import ScenePrimitive
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Floats
from wrinklecli.review.diff.difference import ROUNDINGS, Difference


@dataclass(frozen=True, slots=True)
class AnimatedScene:
    """The scene of an asset, and its clips."""

    primitives: tuple[ScenePrimitive, ...]
    clips: tuple[Clip, ...]


@dataclass(frozen=True, slots=True)
class CommonClip:
    """A clip of both assets, or the stored pose of both, and the times (times,) at which to compare them, seconds."""

    clips: tuple[Clip | None, Clip | None]
    times: Floats

    @property
    def name(self) -> str | None:
        """The clip's name; None for the stored pose."""
        return self.clips[0].name if self.clips[0] else None


def common_clips(
    a: AnimatedScene, b: AnimatedScene, chosen: Sequence[str], fps: float
) -> tuple[list[CommonClip], list[Difference]]:
    """The stored pose and the clips that both assets have, and the differences between their clips.

    Only the chosen clips are compared; without names, all and the stored pose. Times are those of a grid of `fps`
    frames per second, and the clips' own keys.

    Raises:
        BakeError: A clip has more than 200,000 frames.
    """
    found_clips: list[CommonClip] = []
    found: list[Difference] = []
    others = {clip.name: clip for clip in b.clips if not chosen or clip.name in chosen}
    one_switches = False
    for clip in a.clips:
        if chosen and clip.name not in chosen:
            continue
        other = others.pop(clip.name, None)
        place = f"/animations/{clip.index}"
        if other is None:
            found.append(Difference("structure", place, clip.name, "only in A"))
            continue
        spans = np.array([[clip.start, clip.end], [other.start, other.end]])
        # Times are stored in float32.
        if (np.abs(spans[0] - spans[1]) > ROUNDINGS * np.maximum(1.0, np.abs(spans[0]))).any():
            shown = " -> ".join(f"{start:.6g} to {end:.6g} s" for start, end in spans.tolist())
            found.append(Difference("animation", place, clip.name, shown))
        switches = [each for each in (_switch_times(a, clip), _switch_times(b, other)) if len(each)]
        if len(switches) == 1:
            # A file whose meshes are shown one after another is right at their own times only, and its stored pose is
            # the first of them.
            one_switches = True
            times = switches[0]
        else:
            grids = [clip_grid(each, None, fps=fps) for each in (clip, other)]
            times = np.unique(np.concatenate([*grids, clip.key_times(), other.key_times()]))
        found_clips.append(CommonClip((clip, other), times))
    found += [Difference("structure", f"/animations/{clip.index}", clip.name, "only in B") for clip in others.values()]
    if not chosen and not one_switches:
        found_clips.insert(0, CommonClip((None, None), np.zeros(1)))
    return found_clips, found


def _switch_times(scene: AnimatedScene, clip: Clip) -> Floats:
    """(times,) at which a clip shows or hides a mesh by scaling its node in steps."""
    scales = {channel.node: channel for channel in clip.channels if channel.path == "scale"}
    switching = {
        node: channel
        for node, channel in scales.items()
        if channel.interpolation == "STEP" and (channel.values == 0).all(axis=1).any() and channel.values.any()
    }
    times = [np.zeros(0)]
    seen: set[int] = set()
    for primitive in scene.primitives if switching else ():
        node = -1 if primitive.rig.skinned else primitive.rig.node
        while node >= 0 and node not in seen:
            seen.add(node)
            if node in switching:
                times.append(switching[node].times)
            node = int(primitive.rig.parents[node])
    return np.unique(np.concatenate(times))
