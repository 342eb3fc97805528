"""The record of a field of wrinkles, as `tools.records` has those of tools. `configs/fields.md` is the reference."""

from collections.abc import Mapping
from typing import Any, ClassVar, Literal, get_args

from wrinklecli.choices import MaterialName, Stops
from wrinklecli.frozen import dataclass
from wrinklecli.tools.json_schema import (
    TEXT,
    any_keys,
    either,
    expects,
    key,
    list_of,
    number,
    one_of,
    percentage,
    readers_of,
    slider,
    whole,
)
from wrinklecli.tools.materials import Preset
from wrinklecli.tools.records import (
    CONTACT_WORDS,
    MASK,
    MAX_SEED,
    Contact,
    EffectTool,
    Length,
    Mask,
    contact_word,
    length_or,
)

# A strip buckles at π²/3 of the square of its thickness over the wavelength: 0.2 % for denim, 0.7 % for thick leather.
OF_MATERIALS: Mapping[MaterialName, Mapping[str, Any]] = {
    "cloth": {"wavelength": "10%", "slack": "1%", "variation": 0.15},
    "leather": {"wavelength": "12%", "slack": "1%", "variation": 0.15},
    "skin": {"wavelength": "6%", "slack": "10%", "variation": 0.1},
}
"""Values of each material for keys that a field lacks; chosen by eye on trousers, a suit and a sleeve."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Field(EffectTool):
    """A field of wrinkles over a whole garment.

    Attributes:
        wavelength: From crest to crest at rest; a percentage is of the girth of the limb beneath.
        beside: The other nodes of a list in `node`.
        slack: Part of a length that is lost before a fold rises; folds take it up beyond.
        substance: The substances on which it lies; None for all.
        joints: Names of the joints that fold it.
    """

    section: ClassVar[str] = "fields"
    words: ClassVar[tuple[str, str]] = ("field", "fields")
    meaning: ClassVar[str] = "Fields of wrinkles over whole garments, where these are compressed."

    node: str | None = key(
        either(list_of(TEXT, 1, None, "a node or a list of nodes"), {**TEXT, "type": ["string", "null"]}),
        "Node of the mesh, or a list of nodes whose meshes are one surface; may be left out where one mesh deforms.",
        None,
    )
    mask: Mask | None = key(
        MASK,
        "Factor of the height at each place, 0 to 1: {attribute: _WRINKLE} of the vertices, or {image: FILE, channel: "
        "r}. Default none.",
        None,
    )
    substance: tuple[MaterialName, ...] | None = key(
        {
            "if": {"type": "null"},
            "else": list_of(
                one_of(*get_args(MaterialName)), 1, len(get_args(MaterialName)), "a list of skin, cloth and leather"
            ),
        },
        "The field lies only on places that look like these: a list of skin, cloth and leather. Default: everywhere.",
        None,
        read=lambda value: None if value is None else tuple(value),
    )
    stops: Stops = key(
        one_of("features", "none"),
        "Where wrinkles fade out: at features (open borders, seams of materials, facets), or none. Default features.",
        "features",
    )
    material: MaterialName = key(
        one_of("skin", "cloth", "leather"),
        "Substance, which gives the wavelength, the slack and the shape of a fold. Default cloth.",
        "cloth",
        group="Shape",
    )
    wavelength: Length = key(
        length_or("auto", slides=slider(2, 30, 0.5, "%")),
        "From crest to crest at rest: a length, or a percentage of the girth of the limb beneath. Default auto: the "
        "material's.",
        "auto",
    )
    slack: float = key(
        {**percentage(50, 20), "type": ["string", "null"]},
        "Part of its length that the surface loses before a fold rises. Default: the material's.",
        None,
    )
    strength: float = key(
        {**number(0, 10), **slider(0, 2, 0.05)}, "Factor of the heights in all clips. Default 1.", 1.0
    )
    variation: float = key(
        {**number(0, 1, step=0.05), "type": ["number", "null"]},
        "0 even distances of crests, 1 most irregular. Default: the material's.",
        None,
        group="Irregularity",
    )
    seed: int | None = key(
        {**whole(0, MAX_SEED), "type": ["integer", "null"]}, "Seed of the irregularity. Default: from the name.", None
    )
    joints: Literal["all"] | tuple[str, ...] = key(
        either(
            list_of(TEXT, 1, None, "all or a list of names of joints"),
            expects("all or a list of names of joints", enum=["all"]),
        ),
        "Joints whose turns fold it: all, or a list of names. Default all.",
        "all",
        group="Motion",
    )
    clips: Mapping[str, float] = key(
        any_keys(number(0, 10), "a mapping of clip names to factors"),
        "Factors of the heights in some clips, in place of `strength`. Default {}.",
        {},
        hashed=False,
    )
    contact: Contact | None = key(
        contact_word("off or resolve", anyOf=[{"enum": [*CONTACT_WORDS]}]),
        "resolve: it is lowered where it would cross more than the skin alone. Default off.",
        "off",
    )

    beside: tuple[str, ...] = ()

    @classmethod
    def of_material(cls, values: Mapping[str, Any], _known: Mapping[str, Preset]) -> Mapping[str, Any]:
        """The values that its material gives for keys that it does not have."""
        return OF_MATERIALS[values.get("material", "cloth")]

    @classmethod
    def fields_of(cls, values: Mapping[str, Any], known: Mapping[str, Preset]) -> dict[str, Any]:
        """The fields that the keys of a file give, with those of its material."""
        given, readers = cls.of_material(values, known), readers_of(Field)
        absent = {name: readers[name](each) for name, each in given.items() if values.get(name) in (None, "auto")}
        found = {name: each for name, each in values.items() if name != "mirror"} | absent
        if isinstance(found.get("node"), tuple):
            found["node"], *found["beside"] = dict.fromkeys(found["node"])
            found["beside"] = tuple(found["beside"])
        return found
