"""`wrinkle check --crossings`."""

from typing import Any

from wrinklecli.cli.output import Progress, emit, emit_json, warn
from wrinklecli.errors import RefusedError, counted

_MOST_PLACES = 8  # of a clip, with the most crossings; the others are summed


def emit_crossings(asset: str, tools: str | None, *, as_json: bool, strict: bool, **options: Any) -> None:
    """Count what crosses and print it.

    Args:
        asset: The .gltf or .glb.
        tools: The YAML file of tools, if any.
        as_json: Print JSON instead of tables.
        strict: Refuse if there are warnings.
        options: Fields of `CheckOptions`.
    """
    from wrinklecli.review.crossings import crossings

    with Progress() as progress:
        found = crossings(asset, tools, progress=progress.show, **options)
    if as_json:
        emit_json(found.data)
    else:
        _emit_table(found.data)
        for warning in found.warnings:
            warn(warning)
    if strict and found.warnings:
        raise RefusedError(f"refused by --strict: {counted(len(found.warnings), 'warning')}", where=tools or asset)


def _emit_table(data: dict[str, Any]) -> None:
    emit(f"stored pose: {_changed(data['stored_pose'])}")
    for clip in data["clips"]:
        emit(f"{clip['name']}: {_changed(clip['totals'])} in {counted(len(clip['times']), 'moment')}{_most(clip)}")
        shown, others = clip["places"][:_MOST_PLACES], clip["places"][_MOST_PLACES:]
        for place in shown:
            at = ", ".join(f"{x:.3g}" for x in place["at"])
            emit(f"  {_changed(place['counts'])} between {place['between']}, about [{at}] in the stored pose")
        if others:
            rest = [total - sum(place["counts"][k] for place in shown) for k, total in enumerate(clip["totals"])]
            emit(f"  {_changed(rest)} elsewhere")


def _changed(counts: list[int]) -> str:
    return " -> ".join(f"{count:,}" for count in counts)


def _most(clip: dict[str, Any]) -> str:
    """The moment in which the last state has the most crossings."""
    counts = clip["counts"][-1]
    if not any(counts):
        return ""
    most = max(range(len(counts)), key=counts.__getitem__)
    return f", most at {clip['times'][most]:.3g} s ({_changed([each[most] for each in clip['counts']])})"
