"""The text of a suggested tools file, with comments, and a check that reading it gives the suggested tools."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from wrinklecli.errors import AssetError, WrinkleError
from wrinklecli.gltf.document import Document
from wrinklecli.review.suggest.draft import SLACK, decimals, place_of, written_length
from wrinklecli.review.suggest.fitted_tools import Suggestion
from wrinklecli.review.suggest.score import Score
from wrinklecli.tools.fields import Field
from wrinklecli.tools.materials import presets as usual_presets
from wrinklecli.tools.mirror import exchange_sides
from wrinklecli.tools.read import read_values
from wrinklecli.tools.records import Contact, Length, RefinementSettings, RestLengthMorph, ToolsFile, WrinkleTool
from wrinklecli.tools.yaml_tree import printable, read_tree

_USUAL = RefinementSettings()


def tools_text(
    suggestions: Sequence[Suggestion],
    asset: str,
    refinement: RefinementSettings = _USUAL,
    presets: Sequence[str] = (),
    fields: Sequence[str] = (),
) -> str:
    """Write a file of fields and tools, with the asset's name in comments, and the refinement if it is not usual.

    `presets` are the files of presets that it names, `fields` the lines of its fields.
    """
    lines = [
        f"# Wrinkles for {printable(asset, 70)}, as `wrinkle suggest` found them.",
        "# This is made to be edited: delete what you do not want.",
        "version: 1",
        "",
        *([f"presets: [{', '.join(map(quoted, presets))}]", ""] if presets else []),
        *written_refinement(refinement),
    ]
    lines += fields
    if not suggestions:
        return "\n".join(lines[:-1]) + "\n"
    lines += [
        "# A tool is a segment across folds that a clip makes: its ends come closer, and the lost length comes back",
        "# as bumps. Where folds turn it is a path. Positions are those of the stored pose, in scene units, Y up. Best",
        "# first: move the ends, try other widths and numbers of bumps.",
        "defaults:",
        f"  rest_length: {100 - SLACK}%     # slack: the first {SLACK} % of shortening make no wrinkles",
        "  max_height: auto     # the material's, which compressible has bumps reach in the deepest fold",
        "",
        "tools:",
    ]
    for each in suggestions:
        tool = each.tool
        digits = decimals(each.span)
        shortens = (
            f"shortens by {100 * each.shortening:.0f} %, from {each.span:.{digits}f} to"
            f" {each.clips[each.clip]:.{digits}f}, in clip {printable(each.clip, 90)} at {each.time:.2f} s"
        )
        if isinstance(tool.rest_length, RestLengthMorph):
            shortens = "its weight makes the wrinkles, as the skin in the middle hardly shortens"
        places = [f"[{', '.join(f'{x:.{digits}f}' for x in place_of(point))}]" for point in tool.points]
        keys = {
            "node": None if tool.node is None else quoted(tool.node),
            "path": f"[{', '.join(places)}]" if tool.between else None,
            "origin": None if tool.between else places[0],
            "target": None if tool.between else places[-1],
            "mirror": "x" if each.mirrored else None,
            "width": f"{tool.width.value:.12g}",
            "rest_length": None if isinstance(tool.rest_length, Length) else written_length(tool.rest_length),
            "material": tool.material,
            "strategy": tool.strategy,
            "bumps": tool.bumps,
            "max_height": _written_height(tool),
            "profile": tool.profile if each.own_profile else None,
            "compressible": f"{100 * tool.compressible:.0f}%" if tool.compressible or tool.material else None,
            "strength": None if tool.strength == 1.0 else f"{tool.strength:g}",
            "seed": tool.seed,
            "contact": "resolve" if tool.contact == Contact() else None,
        }
        lines.append(f"  # {each.words[0].upper()}{each.words[1:]}: {shortens}")
        if each.gpu_bytes:
            lines.append(f"  # Up to {each.height:.2g} high, {each.gpu_bytes / 1e6:.1f} MB on a GPU after bake --split")
        if each.substance is not None:
            lines.append(f"  # {each.substance.words}")
        lines += left_out_without_all(each.judgement, each.fault)
        if each.crossings and tool.contact:
            lines.append(
                "  # Folded, it would pass through itself: contact keeps its sides apart, and baking takes longer"
            )
        elif each.crossings:
            lines.append(
                "  # Folded, it passes through itself; contact: resolve mends that: pip install 'wrinklecli[contact]'"
            )
        if each.one_sided:
            lines.append(
                f"  # {exchange_sides(tool.name)}, which mirror makes, is there for other clips: none here raises it"
            )
        lines += [*entry(tool.name, keys), ""]
    return "\n".join(lines[:-1]) + "\n"


def left_out_without_all(judgement: Score | None, fault: str = "") -> list[str]:
    """A comment that says why a suggestion is there with `--all` alone; none if it is there without."""
    why = fault or (judgement.sentence if judgement and not judgement.is_kept else "")
    return [f"  # Left out without --all: {why}"] if why else []


def _written_height(tool: WrinkleTool) -> str | None:
    """The greatest height, if it is not that of the file's defaults."""
    if isinstance(tool.max_height, Length):
        return f"{tool.max_height.value:.12g}{'%' if tool.max_height.percent else ''}"
    return "none" if tool.max_height is None else None


def read_suggested(text: str, document: Document, suggestions: Sequence[Suggestion]) -> ToolsFile:
    """Read the text of suggestions for an asset with the presets that they know, from whatever files.

    Raises:
        AssetError: The asset's lengths are beyond the range of a tools file.
    """
    root, problems = read_tree(text)
    assert root is not None, problems
    try:
        return read_values(root.value, known=suggestions[0].presets if suggestions else usual_presets())
    except WrinkleError as error:
        raise AssetError(f"cannot be described by a tools file: {error.lines[0]}", where=document.path) from error


def written_refinement(refinement: RefinementSettings) -> list[str]:
    """The lines of the key `refinement`; none if it is as usual."""
    finer, flat = refinement.max_levels != _USUAL.max_levels, refinement.scheme != _USUAL.scheme
    if not finer and not flat:
        return []
    keys = [f"max_levels: {refinement.max_levels}"] * finer + [f"scheme: {refinement.scheme}"] * flat
    why = ["fine enough for triangles as long as these"] * finer + ["keeps the flat faces of a coarse mesh"] * flat
    return [f"refinement: {{{', '.join(keys)}}}   # {', '.join(why)}", ""]


def entry(name: str, keys: Mapping[str, object]) -> list[str]:
    """The lines of one entry of a list in a tools file, without the keys that are None."""
    return [f"  - name: {name}", *(f"    {key}: {value}" for key, value in keys.items() if value is not None)]


def quoted(name: str) -> str:
    """A name with any characters as YAML text in double quotes."""
    escaped = name.replace("\\", "\\\\").replace('"', '\\"')
    return '"' + "".join(c if c.isprintable() else f"\\U{ord(c):08x}" for c in escaped) + '"'


def refuse_unwritable(
    text: str, document: Document, suggestions: Sequence[Suggestion], fields: Sequence[Field] = ()
) -> None:
    """Check that reading the text gives the suggested tools and fields.

    Raises:
        AssetError: The asset's lengths are beyond the range of a tools file.
    """
    read = read_suggested(text, document, suggestions)
    suggested: list[Any] = [*(each.tool for each in suggestions), *fields]
    by_name = {each.name: each for each in read.effects}
    for each in suggested:
        found = by_name[each.name]
        assert found == replace(each, where=found.where), each.name
