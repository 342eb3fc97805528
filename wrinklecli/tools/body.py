"""The records of effects below the skin, as `tools.records` has them of wrinkles: muscles.

`configs/README.md` is the reference of the keys.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, Literal, TypeAlias, get_args

from wrinklecli.choices import Axis
from wrinklecli.tools.json_schema import (
    FLAG,
    LENGTH,
    LENGTHS,
    TEXT,
    any_keys,
    expects,
    if_mapping,
    key,
    list_of,
    number,
    one_of,
    read_record,
    schema_of,
)
from wrinklecli.tools.materials import Preset
from wrinklecli.tools.records import END, SECONDS, Length, Point, identifier, parse_length, read_end

AUTO_LENGTH = expects(f"auto, {LENGTHS}", anyOf=[{"enum": ["auto"]}, LENGTH])


def read_auto_length(value: Any) -> Literal["auto"] | Length:
    """A length, or `auto`."""
    return "auto" if value == "auto" else parse_length(value)


@dataclass(frozen=True, slots=True)
class ActivationKeys:
    """Activations keyed by hand in some clips; a muscle is relaxed in all others.

    Attributes:
        keys: Each clip's keys: seconds, ascending, and the activation at that time, 0 to 1.
    """

    keys: Mapping[str, tuple[tuple[float, float], ...]] = key(
        any_keys(
            list_of(
                expects(
                    "[seconds, activation from 0 to 1]",
                    type="array",
                    prefixItems=[SECONDS, number(0, 1)],
                    minItems=2,
                    maxItems=2,
                ),
                1,
                None,
                "a list of one or more [seconds, activation]",
            ),
            "a mapping of clip names to lists of [seconds, activation]",
            low=1,
        ),
        "For each clip a list of [seconds, activation], times rising.",
        read=lambda value: {clip: tuple((float(t), float(a)) for t, a in keys) for clip, keys in value.items()},
        hashed=False,
    )


@dataclass(frozen=True, slots=True)
class ActivationMorph:
    """An activation that is the weight of a morph target, held within 0 and 1."""

    morph: str = key(TEXT, "Name of the morph target.")


Activation: TypeAlias = ActivationKeys | ActivationMorph


def _read_activation(value: Any) -> Activation | None:
    if not isinstance(value, dict):
        return None
    return read_record(ActivationKeys, value) if "keys" in value else read_record(ActivationMorph, value)


@dataclass(frozen=True, slots=True, kw_only=True)
class BodyEffect:
    """The keys that all effects below the skin share.

    Attributes:
        mirrored: True if `mirror` made it.
        where: Its place in the file for later errors, such as `tools.yaml:12: muscles[0]`.
        places: The places of its keys; see `place`.
    """

    name: str = key(TEXT, "Unique name; also when all but letters, digits and _ is replaced by _.")
    node: str | None = key(
        {**TEXT, "type": ["string", "null"]}, "Node of the mesh; may be left out where one mesh deforms.", None
    )
    mirrored: bool = key(
        one_of(*get_args(Axis), "none", none=True),
        "Also make the one of the other side: this coordinate, as the file writes it, negated, left and right "
        "exchanged in names. Default none.",
        None,
        name="mirror",
        absent=False,
    )
    enabled: bool = key(FLAG, "false: checked but not baked. Default true.", True)
    optional: bool = key(FLAG, "true: an absent node or clip is a note, not an error. Default false.", False)
    where: str = ""
    places: Mapping[tuple[str, ...], str] = field(default_factory=dict, hash=False, compare=False)

    @classmethod
    def fields_of(cls, values: Mapping[str, Any], _known: Mapping[str, Preset]) -> dict[str, Any]:
        """The fields that the keys of a file give."""
        return {name: each for name, each in values.items() if name != "mirror"}

    def place(self, *keys: str) -> str:
        """The place of a key, for later errors."""
        return self.places.get(keys, self.where)

    @property
    def identifier(self) -> str:
        """The name in letters, digits and `_`, as in the morph targets `wrinkle_IDENTIFIER_1`; unique too."""
        return identifier(self.name)

    @property
    def idle(self) -> bool:
        """False: it has no strength that could be 0."""
        return False


@dataclass(frozen=True, slots=True, kw_only=True)
class Muscle(BodyEffect):
    """One muscle; mirrored ones are muscles of their own.

    Attributes:
        origin: The end that hardly moves: world space at rest, Y-up, scene units; or a marker, or a joint with an
            offset. `insertion`, the end on the bone that the muscle turns, is alike.
        activation: None for a muscle that its length alone thickens.
    """

    origin: Point = key(
        END,
        "Where the muscle begins, below the skin: world space at rest in scene units, {marker: NODE}, or {joint: NODE, "
        "offset: [x, y, z]}.",
        read=read_end,
    )
    insertion: Point = key(
        END, "Where it ends, as a rule just beyond the joint that it bends. Written as `origin`.", read=read_end
    )
    thickness: Literal["auto"] | Length = key(
        AUTO_LENGTH,
        "Thickness of the belly at rest: a length or a percentage of the muscle. Default auto: 42 % of the way from "
        "bone to skin.",
        "auto",
        read=read_auto_length,
    )
    tendon: Length = key(
        LENGTH, "Length of both tendons, which do not shorten: a length or a percentage. Default 22%.", "22%",
        read=parse_length,
    )  # fmt: skip
    width: Literal["auto"] | Length = key(
        AUTO_LENGTH,
        "Width over which the skin follows, around the limb: a length or a percentage. Default auto: from the limb's "
        "own thickness.",
        "auto",
        read=read_auto_length,
    )
    activation: Activation | None = key(
        if_mapping(
            schema_of(ActivationKeys),
            if_mapping(
                schema_of(ActivationMorph),
                expects("{keys: {CLIP: [[SECONDS, ACTIVATION], …]}}, {morph: NAME} or none", enum=["none", None]),
                required=["morph"],
            ),
            required=["keys"],
        ),
        "Tension that thickens the muscle while its length stays: {keys: …} by hand, {morph: …} by a morph target. "
        "Default none.",
        None,
        read=_read_activation,
    )

    travel: bool = key(
        FLAG,
        "true: the belly moves along as the muscle shortens, which takes more morph targets. Default false.",
        False,
    )

    @property
    def points(self) -> tuple[Point, ...]:
        """Both ends."""
        return (self.origin, self.insertion)

    def place_of(self, number: int, *keys: str) -> str:
        """The place of an end in the file."""
        return self.place(("origin", "insertion")[number], *keys)

    @property
    def named_clips(self) -> Sequence[tuple[str, tuple[str, ...]]]:
        """The clips that key the activation, with the paths of their keys."""
        keyed = self.activation.keys if isinstance(self.activation, ActivationKeys) else {}
        return [(name, ("activation", "keys", name)) for name in keyed]


def odd_activation(value: Any) -> Sequence[tuple[tuple[str, ...], str]]:
    """Faults of an activation that the schema accepts: the place below the key, and the expected value."""
    found = []
    for clip, keys in value.get("keys", {}).items() if isinstance(value, dict) else ():
        falling = next(((a, b) for (a, _), (b, _) in pairwise(keys) if b <= a), None)
        if falling:
            message = f"expected times that rise from key to key, not {falling[0]:g} and then {falling[1]:g}"
            found.append((("keys", clip), message))
    return found
