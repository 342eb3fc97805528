"""The parts of a YAML text: between which characters each value stands, its anchor, and what it is made of.

Source: the events and tokens of PyYAML, which know their places.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import yaml

from wrinklecli.errors import ConfigError


@dataclass(frozen=True, slots=True)
class Part:
    """A value in the text.

    Attributes:
        start: Its first character, that of its anchor or tag where it has one.
        end: Behind its last; of a block neither the comments nor the empty lines that follow.
        kind: What it is.
        flow: Whether it stands in brackets.
        anchor: Name by which others repeat it, or by which this alias repeats another.
        keys: Of a mapping, one for each of its items.
        items: Values of a mapping or a sequence.
    """

    start: int
    end: int
    kind: str
    flow: bool = False
    anchor: str | None = None
    keys: tuple["Part", ...] = ()
    items: tuple["Part", ...] = ()

    def within(self) -> Iterator["Part"]:
        """Itself and all below it, in the order of the text."""
        yield self
        for number, item in enumerate(self.items):
            if self.keys:
                yield from self.keys[number].within()
            yield from item.within()


def read_parts(text: str, name: str) -> Part:
    """The value that a text is, with all of its parts.

    Args:
        text: The YAML.
        name: What messages call it.

    Raises:
        ConfigError: It cannot be read, or is empty.
    """
    events = yaml.parse(text, Loader=yaml.SafeLoader)
    try:
        for event in events:
            if isinstance(event, yaml.DocumentStartEvent):
                return _part(next(events), events)
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise ConfigError(f"cannot be read as YAML: {error}", where=name) from None
    raise ConfigError("the file is empty", where=name)


def dashes(text: str) -> list[int]:
    """Where the items of block sequences begin, rising."""
    tokens = yaml.scan(text, Loader=yaml.SafeLoader)
    return [token.start_mark.index for token in tokens if isinstance(token, yaml.BlockEntryToken)]


def _part(event: yaml.Event, events: Iterator[yaml.Event]) -> Part:
    """The value that begins with an event; takes its other events."""
    assert event.start_mark is not None
    assert event.end_mark is not None
    start, end = event.start_mark.index, event.end_mark.index
    if isinstance(event, yaml.AliasEvent):
        return Part(start, end, "alias", anchor=event.anchor)
    if isinstance(event, yaml.ScalarEvent):
        return Part(start, end, "scalar", anchor=event.anchor)
    assert isinstance(event, yaml.SequenceStartEvent | yaml.MappingStartEvent)
    mapping, parts = isinstance(event, yaml.MappingStartEvent), []
    for each in events:
        if isinstance(each, yaml.CollectionEndEvent):
            end = each.end_mark.index if each.end_mark is not None else end
            break
        parts.append(_part(each, events))
    keys, items = (parts[::2], parts[1::2]) if mapping else ([], parts)
    flow = bool(event.flow_style)
    if not flow and parts:
        end = parts[-1].end
    return Part(start, end, "map" if mapping else "seq", flow, event.anchor, tuple(keys), tuple(items))
