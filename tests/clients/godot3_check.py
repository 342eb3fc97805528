"""Holds a baked file in Godot 3 against the player of the tests. Run by hand, as an import takes half a minute.

    apt-get install godot3-server
    PYTHONPATH=tests python tests/clients/godot3_check.py BAKED.glb NODE
    PYTHONPATH=tests python tests/clients/godot3_check.py BAKED.glb NODE CLIP

Prints how far each blend shape at weight 1 is from the player's; above 1e-6 of the mesh's size it fails. With a clip it
prints how far the weights of the driver's node are from the clip's own tracks, in 61 frames; above 0.01 it fails.

Seen with Godot 3.2.3 and bakes with `--accessors based`: 0.0026 (wrist, flex), 0.0028 (wrist, extend) and 0.0029 (head,
raise_brows) with poses imported at 240 frames a second, without the optimizer; by Godot's defaults 0.011, 0.091, 0.003.

Seen with Godot 3.2.3: of wrist.glb each blend shape moves as far with `--accessors based` as with `--accessors dense`,
4.2 mm. Of a plain bake every vertex that a target leaves alone is at twice its position, 0.22 m off: Godot 3 takes the
base for what a sparse accessor without a buffer view begins with (mended in May 2023).
"""

import re
import shutil
import subprocess
import sys
import tempfile
from contextlib import suppress
from pathlib import Path

import numpy as np

from kit.player import Floats, Gltf

_TOLERANCE = 1e-6
_IMPORT_SECONDS = 30.0
_PROJECT = 'config_version=4\n[application]\nconfig/name="check"\n'
# Positions of all blend shapes as Godot holds them, whole rather than deltas, one number a line.
_SHAPES = """
extends SceneTree
func _init():
    var file = File.new()
    file.open("res://shown.txt", File.WRITE)
    show(load("res://in.glb").instance(), file)
    file.close()
    quit()
func show(node, file):
    if node is MeshInstance and node.mesh.get_blend_shape_count() > 0:
        for surface in range(node.mesh.get_surface_count()):
            for shape in node.mesh.surface_get_blend_shape_arrays(surface):
                for place in shape[Mesh.ARRAY_VERTEX]:
                    file.store_line("%.9f %.9f %.9f" % [place.x, place.y, place.z])
    for child in node.get_children():
        show(child, file)
"""

# A line for each frame and target that the driver sets: seconds, the weight of the track, and that of the driver.
_DRIVE = """
extends SceneTree
func _init():
    var file = File.new()
    file.open("res://shown.txt", File.WRITE)
    var scene = load("res://in.glb").instance()
    var driver = load("res://driver_godot3.gd").new()
    driver.gltf = "res://in.glb"
    scene.add_child(driver)
    root.add_child(scene)
    var player = scene.get_node("AnimationPlayer")
    player.play("CLIP")
    for frame in range(61):
        var time = player.current_animation_length * frame / 60.0
        player.seek(time, true)
        for body in driver.bodies:
            var tracks = {}
            for target in body["shapes"][0]:
                tracks[target] = body["meshes"][0].get(body["shapes"][0][target])
            for target in body["body"].driven():
                body["meshes"][0].set(body["shapes"][0][target], -1.0)
            driver.drive("CLIP", time, 1.0 / 30.0)
            for target in body["body"].driven():
                var shown = body["meshes"][0].get(body["shapes"][0][target])
                file.store_line("%.9f %.9f %.9f" % [time, tracks[target], shown])
    file.close()
    quit()
"""
_DRIVER = Path(__file__).resolve().parents[2] / "samples" / "driver" / "godot"
# Greatest difference of a weight: the driver's tables, and poses between the importer's samples.
_DRIVEN = 0.01
# Imported poses follow the clip.
_SETTINGS = {"animation/fps": "240", "animation/optimizer/enabled": "false"}


def imported(folder: Path, path: Path, script: str, settings: dict[str, str]) -> Floats:
    """The numbers that a script of Godot writes, in a project with a file that is imported by these settings."""
    (folder / "project.godot").write_text(_PROJECT)
    (folder / "show.gd").write_text(script)
    (folder / "in.glb").write_bytes(path.read_bytes())
    command = ["godot3-server", "--no-window", "--path", str(folder)]
    for change in [{}, settings] if settings else [{}]:
        if change:
            said = (folder / "in.glb.import").read_text()
            for key, value in change.items():
                said = re.sub(f"(?m)^{re.escape(key)}=.*$", f"{key}={value}", said)
            (folder / "in.glb.import").write_text(said)
            shutil.rmtree(folder / ".import")
        # The editor imports, and may stay.
        with suppress(subprocess.TimeoutExpired):
            subprocess.run([*command, "-e", "-q"], capture_output=True, check=False, timeout=_IMPORT_SECONDS)
    subprocess.run([*command, "-s", "show.gd"], capture_output=True, check=False)
    return np.loadtxt(folder / "shown.txt").reshape(-1, 3)


def check_driver(path: Path, clip: str) -> int:
    """Compare the driver's weights with the clip's tracks; the exit code."""
    with tempfile.TemporaryDirectory() as name:
        for source in _DRIVER.glob("*.gd"):
            if source.name != "driver_godot4.gd":
                shutil.copy(source, name)
        shown = imported(Path(name), path, _DRIVE.replace("CLIP", clip), _SETTINGS)
    error = np.abs(shown[:, 1] - shown[:, 2]).max()
    print(f"{clip}: {len(shown)} weights up to {shown[:, 1].max():.3g}, {error:.4f} off at most")
    return int(error > _DRIVEN)


def check_shapes(path: Path, node: str) -> int:
    """Compare blend shapes; the exit code."""
    file = Gltf(path)
    with tempfile.TemporaryDirectory() as name:
        shown = imported(Path(name), path, _SHAPES, {})
    base = file.attribute(node, "POSITION")
    wanted = base + file.deltas(node)
    parts = [file.json["accessors"][each["attributes"]["POSITION"]]["count"] for each in file.mesh(node)["primitives"]]
    wanted = np.concatenate([np.concatenate(each) for each in np.split(wanted, np.cumsum(parts)[:-1], axis=1)])
    gaps = np.linalg.norm(shown - wanted, axis=1)
    start = 0
    for part in parts:
        for target in file.mesh(node)["extras"]["targetNames"]:
            print(f"{target}: {gaps[start : start + part].max():.3g}")
            start += part
    return int(gaps.max() > _TOLERANCE * np.abs(base).max())


if __name__ == "__main__":
    given, node, *clips = sys.argv[1:]
    sys.exit(check_driver(Path(given), clips[0]) if clips else check_shapes(Path(given), node))
