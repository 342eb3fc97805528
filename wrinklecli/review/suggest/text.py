"""The text of a suggested tools file, with comments, and a check that reading it gives what is suggested."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import field, replace
from typing import Any

from wrinklecli.errors import AssetError, WrinkleError
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.document import Document
from wrinklecli.tools.materials import Preset
from wrinklecli.tools.materials import presets as usual_presets
from wrinklecli.tools.read import read_values
from wrinklecli.tools.records import Length, RefinementSettings, ToolsFile, usual_effect, written_keys
from wrinklecli.tools.yaml_edit import written
from wrinklecli.tools.yaml_tree import printable, read_tree

_USUAL = RefinementSettings()
# Shortening without wrinkles, per cent of the rest distance, for a tool that a joint drives: clips rarely return to the
# stored pose, and 1 % is visible.
SLACK = 5
# The rest length that this gives a tool over the distance of its ends.
REST_LENGTH = Length(100.0 - SLACK, percent=True)
# What stands above each list.
_COMMENTS: Mapping[str, str] = {
    "fields": """\
# A field wrinkles a garment wherever its joints compress it, across the direction in which they do. Try
# another wavelength, strength or slack.""",
    "tools": f"""\
# A tool is a segment across folds that a clip makes: its ends come closer, and the lost length comes back
# as bumps. Where folds turn it is a path. Positions are those of the stored pose, in scene units, Y up. Best
# first: move the ends, try other widths and numbers of bumps.
defaults:
  rest_length: {REST_LENGTH.value:g}%     # slack: the first {SLACK} % of shortening make no wrinkles
  max_height: auto     # the material's, which compressible has bumps reach in the deepest fold
""",
    "muscles": """\
# These are guesses by the names of bones and the thickness of limbs. Look at each in a preview, move its ends, make
# it thicker or thinner, or delete it. `activation` flexes it by hand.""",
    "flesh": """\
# These are guesses by the names of bones and the thickness of the body. Look at each in a preview, make it softer (a
# lower frequency), let it swing further (a higher limit), or delete it.""",
    "touches": """\
# These are places to which a clip brings a fingertip. Places, tips and times are measured; how far the skin slides
# (grip) and where the slide ends (reach) are guesses: look at each in a preview, and change or delete it.""",
}
# The defaults that this gives tools.
_DEFAULTS: Mapping[str, Any] = {"rest_length": REST_LENGTH, "max_height": "auto"}
# Characters of a line of a list.
_LONGEST = 100
# Keys that are written even where they have their defaults, as people try other values of these first.
_SHOWN = ("material", "strategy", "bumps", "compressible")


@dataclass(frozen=True, slots=True)
class Entry:
    """An effect as a suggested file has it.

    Attributes:
        effect: A record of a kind of `tools.schema`, with numbers as they are written; the left one if `mirrored`.
        mirrored: True if the other side has the same.
        remarks: Lines about it.
        facts: What was measured: numbers and texts, by names for tables and JSON.
        known: Presets by name, one of which it may have.
    """

    effect: Any
    mirrored: bool = False
    remarks: Sequence[str] = ()
    facts: Mapping[str, Any] = field(default_factory=dict)
    known: Mapping[str, Preset] = field(default_factory=usual_presets)

    @property
    def values(self) -> dict[str, Any]:
        """Its keys as the file has them."""
        defaults = _DEFAULTS if self.effect.section == "tools" else {}
        found = written_keys(self.effect, usual_effect(self.effect, self.known, **defaults), _SHOWN)
        if "path" in found:
            found["path"] = [found.pop("origin"), *found["path"], found.pop("target")]
        return {"name": self.effect.name, **({"mirror": "x"} if self.mirrored else {}), **found}

    @property
    def lines(self) -> list[str]:
        """Its lines in the file."""
        first, *others = (f"{key}: {_in_lines(key, value)}" for key, value in self.values.items())
        return [*(f"  # {each}" for each in self.remarks), f"  - {first}", *(f"    {each}" for each in others), ""]


def file_text(
    entries: Sequence[Entry],
    asset: str = "",
    refinement: RefinementSettings = _USUAL,
    presets: Sequence[str] = (),
) -> str:
    """Write a file of effects, those of a list together, with the asset's name in a comment.

    `presets` are the files of presets that it names.
    """
    lines = [
        f"# Proposals for {printable(os.path.basename(asset), 70)}, as `wrinkle suggest` made them.",
        "# This is made to be edited: delete what you do not want.",
        "version: 1",
        "",
        *([f"presets: {written(presets)}", ""] if presets else []),
        *_refinement_lines(refinement),
    ]
    for section in dict.fromkeys(each.effect.section for each in entries):
        lines += [_COMMENTS[section], f"{section}:"]
        lines += [line for each in entries if each.effect.section == section for line in each.lines]
    return "\n".join(lines[:-1]) + "\n"


def read_suggested(text: str, document: Document, known: Mapping[str, Preset]) -> ToolsFile:
    """Read the text of suggestions for an asset with known presets, from whatever files.

    Raises:
        AssetError: The asset's lengths are beyond the range of a tools file.
    """
    root, problems = read_tree(text)
    assert root is not None, problems
    try:
        return read_values(root.value, known=known)
    except WrinkleError as error:
        raise AssetError(f"cannot be described by a tools file: {error.lines[0]}", where=document.path) from error


def refuse_unwritable(text: str, document: Document, entries: Sequence[Entry]) -> None:
    """Check that reading the text gives the suggested effects.

    Raises:
        AssetError: The asset's lengths are beyond the range of a tools file.
    """
    by_name = {each.name: each for each in read_suggested(text, document, entries[-1].known).effects}
    for each in (entry.effect for entry in entries):
        assert by_name[each.name] == replace(each, where=by_name[each.name].where), each.name


def _refinement_lines(refinement: RefinementSettings) -> list[str]:
    """The lines of the key `refinement`; none if it is as usual."""
    why = {
        "max_levels": "fine enough for triangles as long as these",
        "scheme": "keeps the flat faces of a coarse mesh",
    }
    found = written_keys(refinement)
    return [f"refinement: {written(found)}   # {', '.join(map(why.__getitem__, found))}", ""] if found else []


def _in_lines(key: str, value: Any) -> str:
    """The value of a key in YAML, a list in lines that fit, each below its first entry."""
    if not isinstance(value, list):
        return written(value)
    lines = [""]
    for each in map(written, value):
        lines = [*lines[:-1], f"{lines[-1]}{each}, "] if len(lines[-1] + each) < _LONGEST else [*lines, f"{each}, "]
    return f"[{(chr(10) + len(f'    {key}: [') * ' ').join(line.rstrip() for line in lines).rstrip(',')}]"
