"""The morph targets of a face that move together: both sides, as nobody raises one brow alone for long."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace

from wrinklecli.character.clip import Clip
from wrinklecli.tools.mirror import split_side

# What is between the names of motions in the name of the one that joins them.
JOINED = " + "


def joined_expressions(clips: Sequence[Clip]) -> Iterator[Clip]:
    """Join motions that raise morph targets if their names differ by the side, or if all raise brows; others stay."""
    groups: dict[str, list[Clip]] = {}
    for clip in clips:
        if clip.channels[0].path != "weights":
            yield clip
            continue
        raises = re.search("brow|brw", clip.name, re.IGNORECASE) and re.search("up|raise", clip.name, re.IGNORECASE)
        groups.setdefault("brows up" if raises else split_side(clip.name)[0], []).append(clip)
    for group in groups.values():
        first = group[0]
        channels = {channel.node: channel for channel in first.channels}
        for clip in group[1:]:
            for channel in clip.channels:
                known = channels.get(channel.node)
                added = channel.values - channel.values[:1]
                values = channel.values if known is None else known.values + added
                channels[channel.node] = replace(known or channel, values=values)
        name = JOINED.join(clip.name for clip in group)
        yield replace(first, name=name, channels=tuple(channels.values()))
