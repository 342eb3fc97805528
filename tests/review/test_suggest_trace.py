"""Suggested tools have paths where the strongest compression turns from place to place, and nowhere else."""

from pathlib import Path

import numpy as np
import pytest

from kit.asset import Asset
from kit.limb import limb
from kit.prepared import prepare
from kit.suggested import ends
from wrinklecli.numeric.arrays import unit
from wrinklecli.review.suggest.suggest import suggest
from wrinklecli.tools.read import parse_tools

MIDDLE = np.array([2.0, 0.0, 0.0])


def corner() -> Asset:
    """A flat sheet around a point that a morph target squeezes, like the skin around the corner of an eye."""
    angles = np.radians(np.linspace(-130.0, 130.0, 65))
    radii, turns = (each.ravel() for each in np.meshgrid(np.linspace(0.15, 1.3, 29), angles, indexing="ij"))
    squeezed = turns - 0.3 * np.exp(-(((radii - 0.6) / 0.3) ** 2)) * np.tanh(turns / 0.9)
    places, moved = (
        MIDDLE + np.stack([radii * np.cos(turn), radii * np.sin(turn), 0.0 * turn], axis=1)
        for turn in (turns, squeezed)
    )
    first = (np.arange(28)[:, None] * 65 + np.arange(64)).reshape(-1, 1)
    asset = Asset()
    primitive = {
        "attributes": {"POSITION": asset.accessor(places)},
        "indices": asset.accessor((first + np.array([0, 65, 1, 1, 65, 66])).ravel(), "u2"),
        "targets": [{"POSITION": asset.accessor(moved - places)}],
    }
    asset.append("meshes", {"primitives": [primitive], "extras": {"targetNames": ["squint"]}})
    asset.append("nodes", {"mesh": 0, "name": "face"})
    animation = {"name": "squint"}
    asset.channel(animation, 0, "weights", [0.0, 1.0, 1.5], [[0.0], [1.0], [0.0]])
    asset.append("animations", animation)
    return asset


@pytest.mark.slow
@pytest.mark.long
def test_a_path_follows_the_strongest_compression_round_a_corner(tmp_path: Path) -> None:
    (found,) = suggest(corner().write(tmp_path / "face.glb"), everything=True).tools
    tool = found.tool
    assert 1 <= len(tool.between) <= 4
    (read,) = parse_tools(suggest(tmp_path / "face.glb", everything=True).text).tools
    assert read.points == tool.points
    path = {"path": [list(point) for point in tool.points if isinstance(point, tuple)]}
    straight = {key: end.tolist() for key, end in zip(("origin", "target"), ends(tool), strict=True)}
    assert median_angle(path, tool.width.value) < 6.0
    assert median_angle(straight, tool.width.value) > 10.0
    straight_instead, *_ = found.others
    assert not straight_instead.tool.between


def median_angle(points: object, width: float) -> float:
    """Median angle between a tool and the circles around the middle, weighted by area, degrees."""
    assert isinstance(points, dict)
    prepared = prepare(corner(), {"name": "tool", "width": width, "laid": "stored", **points})
    places = prepared.rest.positions
    u, v = prepared.patch.coordinates(places)
    on = np.flatnonzero(prepared.patch.presence(u, v, np.ones(len(u))) > 0.25)
    away = places[on] - MIDDLE
    circles = unit(np.cross([0.0, 0.0, 1.0], away))
    cosines = np.abs(np.sum(circles * prepared.patch.path.directions(u[on]), axis=1))
    angles = np.degrees(np.arccos(np.minimum(cosines, 1.0)))
    order = np.argsort(angles)
    total = np.cumsum(np.linalg.norm(away, axis=1)[order])
    return float(angles[order[np.searchsorted(total, total[-1] / 2.0)]])


@pytest.mark.slow
def test_a_limb_that_bends_in_a_plane_gets_straight_tools(tmp_path: Path) -> None:
    found = suggest(limb(tmp_path / "limb.glb", rings=41, sides=24))
    assert found.tools
    assert not any(each.tool.between for found_tool in found.tools for each in (found_tool, *found_tool.others))
