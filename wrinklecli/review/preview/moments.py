"""Choose the moments that a preview shows: times of clips."""

from collections.abc import Sequence

from wrinklecli.character.clip import Clip, clip_named, read_clips
from wrinklecli.errors import WrinkleError
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.document import Document
from wrinklecli.review.preview.preview_options import PreviewOptions

# The greatest number of moments of one picture.
MOST_MOMENTS = 10_000
# Moments of a clip on a sheet; an odd number, because many clips are at their greatest in their middle.
_SHEET_MOMENTS = 5
# Seconds within which a time is a clip's end, as people write times with few digits.
_ROUNDING = 0.01
# Frames per second of an animation.
_ANIMATION_FPS = 15.0


@dataclass(frozen=True, slots=True)
class Moment:
    """A time in seconds of a clip, or the stored pose if `clip` is None."""

    clip: str | None
    time: float

    @property
    def label(self) -> str:
        """The moment in words."""
        return "as stored" if self.clip is None else f"{self.clip} {self.time:.2f} s"


def plan_moments(document: Document, options: PreviewOptions, *, animated: bool) -> list[Moment]:
    """Choose the moments to show of an asset.

    Without a clip in the options this is the asset's first clip, or the stored pose of an asset without clips. An
    animation (`animated`) gets more moments than a sheet.

    Raises:
        AssetError: The asset lacks a clip that the options name.
        WrinkleError: There are too many moments, or one that no clip has.
    """
    fps = options.fps or _ANIMATION_FPS
    clips = read_clips(document)
    named = [clip_named(clips, name, where=document.path) for name in options.clips]
    if options.rest or not clips:
        return [Moment(None, 0.0)]
    chosen, found = named or clips[:1], []
    for time in options.times:
        if not any(_has(clip, time) for clip in chosen):
            last = max(chosen, key=lambda clip: clip.end)
            span = f"{last.name!r} from {last.start:.4g} to {last.end:.4g} s"
            raise WrinkleError(f"no clip that is shown has a moment at {time:.4g} s: {span}", where=document.path)
    for clip in chosen:
        length = clip.end - clip.start
        if options.times:
            spread = [float(time) for time in options.times if _has(clip, time)]
        elif options.frames is None and (options.fps is not None or animated):
            count = length * fps
            if count > MOST_MOMENTS:
                raise WrinkleError(
                    f"clip {clip.name!r} of {length:.4g} s would have {count:.6g} moments; at most {MOST_MOMENTS}",
                    where=document.path,
                )
            # The last moment is left out, because it is the first one again if the clip is a cycle.
            spread = [clip.start + number / fps for number in range(max(round(count), 1))]
        else:
            count = options.frames or _SHEET_MOMENTS
            steps = count if animated else count - 1
            spread = [clip.start + length * number / max(steps, 1) for number in range(count)]
        found += [Moment(clip.name, time) for time in (spread if length > 0 else spread[:1])]
    if len(found) > MOST_MOMENTS:
        raise WrinkleError(f"{len(found)} moments are too many; at most {MOST_MOMENTS}", where=document.path)
    return found


def _has(clip: Clip, time: float) -> bool:
    """True if a clip has a moment at some seconds."""
    return clip.start - _ROUNDING <= time <= clip.end + _ROUNDING


def frame_seconds(document: Document, moments: Sequence[Moment], options: PreviewOptions) -> float:
    """Seconds from one frame of an animation to the next, so that `frames` of a clip last as long as the clip."""
    if options.fps:
        return 1 / options.fps
    if options.frames is None or options.times or moments[0].clip is None:
        return 1 / _ANIMATION_FPS
    shown = {moment.clip for moment in moments}
    lengths = [clip.end - clip.start for clip in read_clips(document) if clip.name in shown]
    return max(sum(lengths) / len(moments), 0.01)
