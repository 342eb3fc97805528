"""Golden tests: tolerance, damaged files, the command, and the samples compared with their goldens."""

import copy
import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from kit.asset import Asset, attribute, stored
from kit.changes import compared, image_byte, moved_vertex, renamed_clip
from kit.command import Wrinkle, make_samples
from kit.limb import limb_asset
from kit.places import SAMPLES
from kit.variants import SMALL, rich
from wrinklecli.gltf.document import read_document
from wrinklecli.gltf.edited_document import EditedDocument
from wrinklecli.gltf.writer import write
from wrinklecli.review.diff.diff import diff
from wrinklecli.tools.records import Length

Json = dict[str, Any]


Json = dict[str, Any]


def test_progress_reaches_the_end(tmp_path: Path) -> None:
    before, alike, after = rich(), rich(), rich()
    alike.gltf["asset"]["generator"] = "another"
    moved_vertex(after)
    renamed_clip(after)
    strip = rich(mode="strip", indices="u2")
    for other in (alike, after, strip):
        steps: list[tuple[str, int, int]] = []
        found = compared(tmp_path, before, other, progress=lambda *step, to=steps: to.append(step))
        assert [done for _, done, _ in steps] == sorted(done for _, done, _ in steps)
        assert steps[-1] == ("compare", found.times, found.times)


# Tolerance


def test_the_tolerance_is_a_share_of_the_size_or_scene_units(tmp_path: Path) -> None:
    before, after = limb_asset(**SMALL), limb_asset(**SMALL)
    attribute(after, 0, "POSITION")[3] += np.float32([0.0, 0.0, 0.003])
    found = compared(tmp_path, before, after)
    assert found.size == pytest.approx(np.sqrt(2.0**2 + 0.5**2 + 0.5**2))
    assert found.tolerance == pytest.approx(1e-6 * found.size)
    assert not found.same
    assert not compared(tmp_path, before, after, tolerance=Length(0.0029)).same
    assert compared(tmp_path, before, after, tolerance=Length(0.0031)).same
    assert compared(tmp_path, before, after, tolerance=Length(100 * 0.0031 / found.size, percent=True)).same


def test_what_is_hidden_makes_an_asset_no_larger(tmp_path: Path) -> None:
    def with_hats(*scales: float) -> Asset:
        asset = rich()
        for number, scale in enumerate(scales):
            far = {"mesh": 1, "translation": [50.0 * number, 0.0, 0.0], "scale": [scale] * 3}
            asset.gltf["scenes"][0]["nodes"].append(asset.append("nodes", far))
        return asset

    sizes = []
    for scales in ((1.0,), (1.0, 0.0), (1.0, 0.5), (1.0, 0.5, 0.0)):
        other = with_hats(*scales)
        other.gltf["asset"]["generator"] = "another"
        sizes.append(compared(tmp_path, with_hats(*scales), other).size)
    assert sizes[0] == sizes[1]
    assert sizes[2] == sizes[3] > 40.0


def test_far_from_the_origin_the_default_tolerance_is_that_of_float32(tmp_path: Path) -> None:
    before, after = (limb_asset(**SMALL, root={"translation": [1000.0, 0.0, 0.0]}) for _ in range(2))
    after.gltf["nodes"][-1]["translation"][0] = float(np.nextafter(np.float32(1000.0), np.float32(2000.0)))
    found = compared(tmp_path, before, after, posed=True)
    assert found.worst is not None
    assert found.worst.distance > 1e-6 * found.size
    assert found.same


# Faults


# The command


def test_exit_codes_say_same_different_or_neither(wrinkle: Wrinkle, tmp_path: Path) -> None:
    a = rich().write(tmp_path / "a.glb")
    after = rich()
    moved_vertex(after)
    b = after.write(tmp_path / "b.glb")
    shutil.copy(a, tmp_path / "c.glb")
    (tmp_path / "bad.glb").write_bytes(a.read_bytes()[:1000])

    ran = wrinkle("diff", a, "c.glb")
    assert (ran.code, ran.lines, ran.out) == (0, [], "same: to the byte\n")

    alike = rich()
    alike.gltf["asset"]["generator"] = "another"
    ran = wrinkle("diff", a, alike.write(tmp_path / "d.glb"))
    assert (ran.code, ran.lines) == (0, [])
    assert ran.out.startswith("same: at most 0 apart; tolerance ")
    assert len(ran.out.splitlines()) == 1

    ran = wrinkle("diff", a, b)
    assert (ran.code, ran.lines) == (1, [])
    *lines, last = ran.out.splitlines()
    assert lines[0] == "/meshes/0/primitives/0/attributes/POSITION (limb): vertex 17 is 0.01 off"
    assert last.startswith("different: at most ")
    assert "'limb' in A, vertex 17" in last
    assert wrinkle("diff", a, b, "--tolerance", "1%").code == 0
    assert wrinkle("diff", a, b, "--tolerance", "0.02", "--posed", "--clip", "fold", "--fps", "5").code == 0

    for arguments in (("missing.glb",), ("bad.glb",), (b, "--clip", "nothing")):
        ran = wrinkle("diff", a, *arguments)
        assert (ran.code, ran.out) == (2, "")
        assert len(ran.lines) == 1
    for arguments in ((), (b, "--tolerance", "0"), (b, "--tolerance", "nan"), (b, "--fps", "nan"), (b, "extra")):
        assert wrinkle("diff", a, *arguments).code == 2

    for other, code in ((b, 1), ("c.glb", 0)):
        ran = wrinkle("diff", a, other, "-q")
        assert (ran.code, ran.out, ran.lines) == (code, "", [])


def test_json_keeps_its_keys(wrinkle: Wrinkle, tmp_path: Path) -> None:
    a = rich().write(tmp_path / "a.glb")
    after = rich()
    moved_vertex(after)
    attribute(after, 0, "TEXCOORD_0")[0] = np.nan
    b = after.write(tmp_path / "b.glb")
    ran = wrinkle("diff", a, b, "--json")
    assert (ran.code, ran.lines) == (1, [])
    data = json.loads(ran.out, parse_constant=pytest.fail)
    assert list(data) == [
        *("diff", "same", "a", "b", "posed", "tolerance", "size", "times", "worst", "normal", "differences")
    ]
    assert data["diff"] == 1
    assert (data["same"], data["posed"], data["a"], data["b"]) == (False, False, str(a), str(b))
    assert list(data["worst"]) == ["distance", "side", "place", "name", "vertex", "clip", "time"]
    assert all(list(each) == ["kind", "place", "name", "message", "distance"] for each in data["differences"])
    assert {each["kind"] for each in data["differences"]} == {"geometry", "pose"}
    ran = wrinkle("diff", a, a, "--json", "--posed")
    data = json.loads(ran.out)
    assert (ran.code, data["same"], data["posed"], data["differences"]) == (0, True, True, [])


def test_many_differences_of_a_kind_are_counted(wrinkle: Wrinkle, tmp_path: Path) -> None:
    before, after = rich(), rich()
    for asset, value in ((before, 1), (after, 2)):
        asset.gltf["extras"] |= {f"key_{k}": value for k in range(30)}
    image_byte(after)
    paths = before.write(tmp_path / "a.glb"), after.write(tmp_path / "b.glb")
    lines = wrinkle("diff", *paths).out.splitlines()
    assert len([line for line in lines if line.startswith("/extras/key_")]) == 10
    assert "... and 20 more of kind value" in lines
    assert any(line.startswith("/images/0 (felt): other bytes") for line in lines)
    lines = wrinkle("diff", *paths, "-v").out.splitlines()
    assert len([line for line in lines if line.startswith("/extras/key_")]) == 30


def test_names_cannot_command_a_terminal(wrinkle: Wrinkle, tmp_path: Path) -> None:
    before, after = rich(), rich()
    for asset in (before, after):
        asset.gltf["nodes"][-1]["name"] = "hat\n\x1b[31m"
    moved = copy.deepcopy(after)
    moved.gltf["nodes"][-1]["translation"] = [1.0, 0.0, 0.0]
    ran = wrinkle("diff", before.write(tmp_path / "a.glb"), moved.write(tmp_path / "b.glb"))
    assert ran.code == 1
    assert "\x1b" not in ran.out
    assert all(line.startswith(("/", "different:")) for line in ran.out.splitlines())


def test_a_file_without_anything_to_see_is_compared_too(wrinkle: Wrinkle, tmp_path: Path) -> None:
    asset = Asset()
    animation: Json = {"name": "wave"}
    asset.append("nodes", {"name": "arm"})
    asset.channel(animation, 0, "translation", [0, 1], [[0, 0, 0], [1, 0, 0]])
    asset.append("animations", animation)
    a = asset.write(tmp_path / "a.glb")
    stored(asset, animation["samplers"][0]["output"])[1, 0] = 1.001
    b = asset.write(tmp_path / "b.glb")
    asset.gltf["asset"]["generator"] = "another"
    ran = wrinkle("diff", b, asset.write(tmp_path / "c.glb"))
    assert (ran.code, ran.out.strip()) == (0, "same: no positions to compare")
    ran = wrinkle("diff", a, b)
    assert ran.code == 1
    assert "/animations/0/channels/0 (wave): translation of 'arm' differs by 0.001 at 1 s" in ran.out


# The samples' pipeline


@pytest.mark.skipif(shutil.which("make") is None, reason="needs make")
@pytest.mark.slow
@pytest.mark.long
def test_the_samples_are_checked_and_compared_with_their_golden(tmp_path: Path) -> None:
    samples = tmp_path / "samples"
    shutil.copytree(SAMPLES, samples, ignore=shutil.ignore_patterns("out", "pictures", "__pycache__"))
    (tmp_path / "configs").mkdir()
    shutil.copy(SAMPLES.parent / "configs" / "wrist.yaml", tmp_path / "configs")
    golden = samples / "goldens" / "wrist.glb"
    kept = golden.read_bytes()
    assert len(kept) < 200_000
    ran = make_samples(samples, "test", "-j2")
    assert "same: to the byte" in ran.stdout

    edited = EditedDocument(read_document(golden))
    edited.gltf["nodes"][0]["extras"]["wrinkle"]["tools"][0]["rest_length"] *= 1.01
    write(edited, golden)
    with pytest.raises(subprocess.CalledProcessError) as caught:
        make_samples(samples, "golden-check")
    assert "/nodes/0/extras/wrinkle/tools/0/rest_length" in caught.value.stdout

    make_samples(samples, "goldens")
    assert diff(golden, samples / "out" / "golden" / "wrist.glb").same
    make_samples(samples, "golden-check")

    config = tmp_path / "configs" / "wrist.yaml"
    wider, count = re.subn(r"width: [0-9.]+", "width: 0.08", config.read_text())
    assert count
    config.write_text(wider)
    with pytest.raises(subprocess.CalledProcessError) as caught:
        make_samples(samples, "golden-check")
    assert "different: at most" in caught.value.stdout
