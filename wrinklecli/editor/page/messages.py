"""Checks the messages that tabs send, before viser acts on them.

viser sets every property of a control that a message names, even whether it was removed, and takes any number. A tab of
this page sends few kinds of messages, with values that its controls offer; all other messages are dropped.
"""

import math
from collections.abc import Mapping
from typing import Any

import msgspec
import viser
import viser.infra

MAX_BYTES = 1_000_000  # of a message; the longest holds a line that someone types
_MAX_TEXT = 100_000  # characters of a line; the longest value of a key that anybody wrote has a few thousand
_MAX_NUMBER = 1e12  # greatest magnitude of a number: a place of the scene, pixels, or a key's value
_MAX_DEPTH = 4  # levels of nesting; the positions of a click on the screen take 3
_SENT = (
    "CommandTriggerMessage",
    "GuiUpdateMessage",
    "SceneNodeDragMessage",
    "ScenePointerMessage",
    "ViewerCameraMessage",
)
_KINDS = {kind.__name__: kind for kind in viser.infra.Message.get_subclasses() if kind.__name__ in _SENT}


def is_sent(data: str | bytes, controls: Mapping[str, Any]) -> bool:
    """True for a message that a tab of a page sends, if the page has some controls, by their ids."""
    try:
        fields = msgspec.msgpack.decode(data) if isinstance(data, bytes) else None
        if not isinstance(fields, dict) or not _is_plain(fields, _MAX_DEPTH):
            return False
        kind = _KINDS[fields.pop("type")]
        msgspec.convert(fields, kind)
    except (msgspec.MsgspecError, KeyError, TypeError, ValueError, RecursionError):
        return False
    if kind.__name__ != "GuiUpdateMessage":
        return True
    control, updates = controls.get(fields["uuid"]), fields["updates"]
    return control is not None and [*updates] == ["value"] and _is_offered(control, updates["value"])


def _is_plain(value: Any, depth: int) -> bool:
    """True for texts, truth values and finite numbers, and lists and mappings of these, all of usual size."""
    match value:
        case None | bool():
            return True
        case int() | float():
            return math.isfinite(value) and abs(value) <= _MAX_NUMBER
        case str():
            return len(value) <= _MAX_TEXT
        case list():
            return depth > 0 and all(_is_plain(each, depth - 1) for each in value)
        case dict():
            return depth > 0 and all(isinstance(key, str) and _is_plain(each, depth - 1) for key, each in value.items())
    return False


def _is_offered(control: Any, value: Any) -> bool:
    """True for a value that a control may have. A number may be beyond the ends of a slider, as it can be typed."""
    if isinstance(control, viser.GuiDropdownHandle | viser.GuiButtonGroupHandle):
        return value in control.options
    if isinstance(control.value, bool):
        return isinstance(value, bool)
    if isinstance(control.value, int | float):
        return isinstance(value, int | float) and not isinstance(value, bool)
    return isinstance(control.value, str) and isinstance(value, str)
