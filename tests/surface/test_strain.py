"""Strain: where surfaces are compressed, along which direction and when."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kit.limb import LENGTH, RADIUS, limb, limb_asset
from kit.prepared import unattached
from wrinklecli.character.clip import Clip, read_clips
from wrinklecli.character.range_of_motion import range_of_motion
from wrinklecli.character.rig import read_rig
from wrinklecli.character.surface import read_surface
from wrinklecli.gltf.document import read_document
from wrinklecli.numeric.arrays import unit
from wrinklecli.review.suggest.suggest import suggest
from wrinklecli.surface.rest import rest_pose
from wrinklecli.surface.sites import at_sites, find_peaks, spread_sites
from wrinklecli.surface.strain import Gauge, StrainedParts, along_directions, principal, read_gauge, strain
from wrinklecli.tools.records import ToolsFile

Json = dict[str, Any]


def gauge_of(path: Path, node: int = 0) -> tuple[Gauge, tuple[Clip, ...]]:
    document = read_document(path)
    rig, clips = read_rig(document, node), read_clips(document)
    surface = read_surface(document, rig)
    return read_gauge(surface, rest_pose(surface, rig, ToolsFile(path=""), clips, []), rig), clips


@given(st.lists(st.floats(-1, 1), min_size=6, max_size=6), st.floats(0, 3), st.floats(0, 6))
def test_principal_loss_is_the_greatest_of_all_directions_in_the_plane(
    components: list[float], height: float, turn: float
) -> None:
    normal = unit(np.array([[np.cos(turn), np.sin(turn), height - 1.5]]))
    tensor = np.array([components])
    loss, direction = principal(tensor, normal)
    xx, yy, zz, xy, yz, zx = components
    full = np.array([[xx, xy, zx], [xy, yy, yz], [zx, yz, zz]])
    first = unit(np.cross(normal[0], [0.3, -0.5, 0.8]))
    second = np.cross(normal[0], first)
    angles = np.linspace(0.0, np.pi, 2001)[:, None]
    every = np.cos(angles) * first + np.sin(angles) * second
    losses = np.einsum("ai,ij,aj->a", every, full, every)
    assert loss[0] >= losses.max() - 1e-12
    assert loss[0] <= losses.max() + 1e-5
    assert abs(direction[0] @ normal[0]) < 1e-12
    assert abs(direction[0] @ full @ direction[0] - loss[0]) < 1e-12
    assert abs(along_directions(tensor, normal, direction[0])[0] - loss[0]) < 1e-12


def test_squashing_loses_what_it_takes_away(tmp_path: Path) -> None:
    # The morph target moves x by -0.3 x exp(-(x / 0.6)²): at the middle, lengths along x become 0.7 of what they were.
    gauge, (clip,) = gauge_of(
        limb(tmp_path / "limb.glb", skinned=False, clip=None, morphs=1, morph_clip="LINEAR", rings=81)
    )
    sites = spread_sites(gauge)
    tensors = at_sites(sites, clip, np.array([0.3]))[0]
    losses, directions = principal(tensors, sites.normals)
    near = np.abs(sites.positions[:, 0]) < 0.03
    assert losses[near] == pytest.approx(0.3, abs=0.01)
    assert np.abs(directions[near, 0]).min() > 0.99
    x = sites.positions[:, 0]
    wanted = 0.3 * np.exp(-((x / 0.6) ** 2)) * (1.0 - 2.0 * (x / 0.6) ** 2)
    assert np.abs(losses - np.maximum(wanted, 0.0)).max() < 0.04


@pytest.mark.quick(1)
@pytest.mark.parametrize("root", [{}, {"scale": [1.0, 1.0, -1.0]}, {"scale": [30.0] * 3, "rotation": [0, 0, 0.6, 0.8]}])
def test_rigid_motion_and_scale_lose_nothing(tmp_path: Path, root: Json) -> None:
    asset = limb_asset(clip="grow", root=root)
    gauge, (clip,) = gauge_of(asset.write(tmp_path / "limb.glb"))
    assert np.abs(strain(gauge, clip, np.linspace(0.0, 1.0, 4))).max() < 1e-6
    assert not suggest(tmp_path / "limb.glb").tools


@pytest.mark.slow
def test_sites_cover_the_surface_whatever_its_triangles(tmp_path: Path) -> None:
    areas = []
    for rings, sides in ((7, 6), (24, 16), (120, 90)):
        gauge, _ = gauge_of(limb(tmp_path / "limb.glb", rings=rings, sides=sides))
        sites = spread_sites(gauge)
        corners = gauge.rest.positions[gauge.triangles]
        area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum() / 2
        assert sites.areas.sum() == pytest.approx(area)
        for shares in (sites.gather, sites.smooth):
            assert np.abs(shares.sum(axis=1) - 1.0).max() < 1e-12
        areas.append(sites.areas.sum())
    assert areas[-1] == pytest.approx(2 * np.pi * RADIUS * LENGTH, rel=0.01)


@given(exponent=st.integers(-4, 4), thinness=st.sampled_from([1e-4, 1e-5, 1e-7, 1e-8]))
def test_a_triangle_is_too_thin_by_its_proportions_alone(exponent: int, thinness: float) -> None:
    """Scale does not matter: a triangle counts if its height is more than a millionth of its longest edge."""
    sound = unattached(limb_asset(rings=3, sides=4))
    positions = sound.rest.positions.copy()
    positions[:3] = 10.0**exponent * np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.5, thinness, 0.0]])
    surface = replace(sound.surface, triangles=np.array([[0, 1, 2], [1, 2, 0]]))
    gauge = read_gauge(surface, replace(sound.rest, positions=positions), sound.rig)
    assert len(gauge.triangles) == (2 if thinness > 1e-6 else 0)


def test_slivers_and_degenerate_triangles_change_little(tmp_path: Path) -> None:
    sound, _ = gauge_of(limb(tmp_path / "sound.glb"))
    surface = sound.surface
    flat = np.array([[0, 0, 1], [5, 5, 5], [0, 1, 0]])
    triangles = np.concatenate([surface.triangles, flat])
    gauge = read_gauge(replace(surface, triangles=triangles), sound.rest, sound.rig)
    assert len(gauge.triangles) == len(sound.triangles)


def test_the_greatest_loss_is_found_in_whatever_chunks_poses_come(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    gauge, clips = gauge_of(limb(tmp_path / "limb.glb"))
    sites = spread_sites(gauge)
    times = [np.linspace(0.0, 2.0, 23)]
    whole = find_peaks(sites, clips, times)
    alone = lambda count, _width: (slice(k, k + 1) for k in range(count))  # noqa: E731
    monkeypatch.setattr("wrinklecli.surface.sites.portions", alone)
    single = find_peaks(sites, clips, times)
    assert (whole.poses == single.poses).all()
    assert np.abs(whole.losses - single.losses).max() < 1e-12
    assert whole.losses.max() > 0.5


def test_the_greatest_loss_does_not_depend_on_the_number_of_processes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    gauge, (clip,) = gauge_of(limb(tmp_path / "limb.glb"))
    sites, times = spread_sites(gauge), [np.linspace(0.0, end, 3) for end in (2.0, 1.0, 1.0, 2.0, 0.5)]
    clips = [replace(clip, name=f"clip {number}") for number in range(len(times))]
    monkeypatch.setattr("wrinklecli.surface.sites._WORK_OF_PROCESS", 1)
    done: list[int] = []
    one, two = (find_peaks(sites, clips, times, done.append, jobs=jobs) for jobs in (1, 2))
    assert (one.poses == two.poses).all()
    assert (one.losses == two.losses).all()
    assert done[-2:] == [6, 15]


def test_what_a_motion_strains_is_among_the_triangles_that_it_can() -> None:
    """The limb's second target bulges its middle; a joint bends what is near to it."""
    made = unattached(limb_asset(rings=40, sides=4, joints=6, morphs=2, clip=None))
    gauge = read_gauge(made.surface, made.rest, made.rig)
    sites = spread_sites(gauge)
    times = np.array([0.0, 0.4, 1.0])
    counts = {}
    for clip in range_of_motion(made.document, [0]).clips[::8]:
        whole, part = strain(gauge, clip, times), gauge.strained.of(clip)
        if part is None:
            continue
        counts[clip.name] = len(part.triangles)
        others = np.delete(whole, part.triangles, axis=1)
        assert np.abs(others).max(initial=0.0) < 1e-12
        assert strain(gauge, clip, times, part) == pytest.approx(whole[:, part.triangles], abs=1e-12)
        averaged = at_sites(sites, clip, times)
        rows = whole.transpose(1, 0, 2).reshape(len(gauge.triangles), -1)
        expected = (sites.smooth @ (sites.gather @ rows)).reshape(-1, 3, 6).transpose(1, 0, 2)
        assert averaged == pytest.approx(expected, abs=1e-9)
    assert len(counts) >= 3
    assert max(counts.values()) < 0.4 * len(gauge.triangles)


def test_a_clip_that_scales_or_bends_most_of_it_is_looked_at_as_a_whole() -> None:
    made = unattached(limb_asset(rings=8, sides=5, clip="grow"))
    assert StrainedParts(made.rig, made.surface, made.surface.triangles).of(made.clip) is None
    made = unattached(limb_asset(rings=8, sides=5, joints=6))
    assert StrainedParts(made.rig, made.surface, made.surface.triangles).of(made.clip) is None
