"""Pair the animations of two documents, and compare the values that their channels play."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from wrinklecli.character.clip import Channel, Clip, read_clips, sample
from wrinklecli.gltf.animated import Channels
from wrinklecli.gltf.document import Document
from wrinklecli.gltf.shape import Json
from wrinklecli.review.diff.difference import (
    Difference,
    Findings,
    Limits,
    Link,
    Place,
    Sides,
    brief,
    differ,
    only_in_one,
    pairs_by_key,
    without,
)
from wrinklecli.review.diff.values import dict_differences, gaps, property_gaps


def animation_differences(sides: Sides, chosen: Sequence[str]) -> Findings:
    """Pair animations by name and compare them; only the chosen names, or all without names."""
    first, second = sides.a.items("animations"), sides.b.items("animations")
    clips_a, clips_b = ({clip.index: clip for clip in read_clips(each)} for each in (sides.a, sides.b))
    names_a, names_b = (
        {
            index: name
            for index, each in enumerate(animations)
            if (name := clips[index].name if index in clips else each.get("name")) in chosen or not chosen
        }
        for animations, clips in ((first, clips_a), (second, clips_b))
    )
    # An animation that moves the same properties under another name was renamed.
    pairs = pairs_by_key(
        {i: frozenset((sides.nodes.get(node), path) for node, path in _properties(first[i])) for i in names_a},
        {j: frozenset(_properties(second[j])) for j in names_b},
        pairs_by_key(names_a, names_b),
    )
    for i, j in pairs.items():
        if names_a[i] != names_b[j]:
            message = f"{brief(names_a[i])} -> {brief(names_b[j])}"
            yield differ("structure", ("animations", i, "name"), message, name=names_a[i])
    yield from only_in_one("animations", names_a, names_b, pairs)
    skip = {"name", "channels", "samplers"}
    for i, j in sorted(pairs.items()):
        yield from dict_differences(first[i], second[j], ("animations", i), "animations", sides.limits, skip=skip)
        if i in clips_a and j in clips_b:
            yield from _clip_differences(sides, clips_a[i], clips_b[j])
        yield from _other_channel_differences(sides, i, j)


def _properties(animation: Json) -> set[tuple[Any, Any]]:
    """The nodes and paths that an animation moves."""
    targets = [channel.get("target", {}) for channel in animation.get("channels", [])]
    return {(target.get("node"), target.get("path")) for target in targets}


def _clip_differences(sides: Sides, first: Clip, second: Clip) -> Findings:
    place: Place = ("animations", first.index)
    spans = [(clip.start, clip.end) for clip in (first, second)]
    if gaps(np.array(spans[0]), np.array(spans[1])).max() > sides.limits.slack(np.array(spans[0])):
        message = " -> ".join(f"{start:.6g} to {end:.6g} s" for start, end in spans)
        yield differ("animation", place, message, name=first.name)
    nodes_a, nodes_b = sides.names
    # Only an invalid file has two channels of one property; they are paired in their order.
    pairs = pairs_by_key(
        {k: (sides.nodes.get(channel.node, -1), channel.path) for k, channel in enumerate(first.channels)},
        {k: (channel.node, channel.path) for k, channel in enumerate(second.channels)},
    )
    for number, channel in enumerate(first.channels):
        what = f"{channel.path} of {nodes_a[channel.node]!r}"
        at = (*place, "channels", channel.index)
        if number not in pairs:
            yield differ("animation", at, f"{what}: only in A", name=first.name)
            continue
        other = second.channels[pairs[number]]
        yield from _channel_differences(channel, other, at, sides.limits, what=what, clip=first.name)
        stored_a, stored_b = (
            document.items("animations")[clip.index]["channels"][each.index]
            for document, clip, each in ((sides.a, first, channel), (sides.b, second, other))
        )
        skip = {"sampler", "target"}
        yield from dict_differences(stored_a, stored_b, at, "animations", sides.limits, name=first.name, skip=skip)
    for number in without(range(len(second.channels)), pairs.values()):
        channel = second.channels[number]
        at = ("animations", second.index, "channels", channel.index)
        what = f"{channel.path} of {nodes_b[channel.node]!r}"
        yield differ("animation", at, f"{what}: only in B", name=first.name)


def _channel_differences(
    first: Channel, second: Channel, place: Place, limits: Limits, *, what: str, clip: str
) -> Iterator[Difference]:
    """Compare the values of two channels, at and between the keys of both."""
    widths = [channel.values.shape[-1] for channel in (first, second)]
    if widths[0] != widths[1]:
        yield differ("animation", place, f"{what}: {widths[0]} -> {widths[1]} numbers a key", name=clip)
        return
    if first.interpolation == second.interpolation and all(
        np.array_equal(getattr(first, key), getattr(second, key)) for key in ("times", "values")
    ):
        return
    keys = np.union1d(first.times, second.times)
    between = keys[:-1, None] + np.array([0.0, 0.25, 0.5, 0.75]) * np.diff(keys)[:, None]
    times = np.append(between.reshape(-1), keys[-1])
    one, other = sample(first, times), sample(second, times)
    apart = property_gaps(first.path, one, other, limits)
    if apart.max() > 0.0:
        worst = int(apart.argmax())
        column = int(gaps(one[worst], other[worst]).argmax())
        part = f" (number {column})" if first.path == "weights" else ""
        message = f"{what}{part} differs by {apart[worst]:.3g} at {times[worst]:.6g} s"
        yield differ("animation", place, message, name=clip)


def _other_channel_differences(sides: Sides, i: int, j: int) -> Findings:
    """Compare the channels that move no node, as some of KHR_animation_pointer do, in their order."""
    others_a, others_b = _other_channels(sides.a, i), _other_channels(sides.b, j)
    place: Place = ("animations", i, "channels")
    name = sides.a.items("animations")[i].get("name")
    if len(others_a) != len(others_b):
        message = f"{len(others_a)} -> {len(others_b)} channels that move no node"
        yield differ("animation", place, message, name=name)
    for (number, first), (_, second) in zip(others_a, others_b, strict=False):
        at = (*place, number)
        target_a, target_b = (dict(channel.get("target", {})) for channel in (first, second))
        if not sides.have_same_node(target_a.pop("node", None), target_b.pop("node", None)):
            yield differ("animation", (*at, "target", "node"), "another node", name=name)
        yield from dict_differences(target_a, target_b, (*at, "target"), "animations", sides.limits, name=name)
        sampler_a, sampler_b = _sampler(sides.a, i, first), _sampler(sides.b, j, second)
        for key in ("input", "output"):
            one, other = sampler_a.pop(key, None), sampler_b.pop(key, None)
            if one is not None and other is not None:
                yield Link("accessors", one, other, (*at, key), name)
        yield from dict_differences(sampler_a, sampler_b, at, "animations", sides.limits, name=name)


def _other_channels(document: Document, animation: int) -> list[tuple[int, Json]]:
    """The channels of an animation that move no node, with their numbers."""
    known = Channels(document.gltf)
    channels = document.items("animations")[animation].get("channels", [])
    return [(number, channel) for number, channel in enumerate(channels) if known.moved(channel) is None]


def _sampler(document: Document, animation: int, channel: Json) -> Json:
    """A copy of a channel's sampler; empty if it has none."""
    samplers = document.items("animations")[animation].get("samplers", [])
    number = channel.get("sampler", len(samplers))
    return dict(samplers[number]) if number < len(samplers) else {}
