"""Holds a baked file in Godot 3 against the player of the tests. Run by hand, as no test needs another 60 MB.

    apt-get install godot3-server
    PYTHONPATH=tests python tests/clients/godot3_check.py BAKED.glb NODE

Prints how far each blend shape at weight 1 is from the player's; above 1e-6 of the mesh's size it fails.

Seen with Godot 3.2.3: of wrist.glb each blend shape moves as far with `--accessors based` as with `--accessors dense`,
4.2 mm. Of a plain bake every vertex that a target leaves alone is at twice its position, 0.22 m off: Godot 3 takes the
base for what a sparse accessor without a buffer view begins with (mended in May 2023).
"""

import subprocess
import sys
import tempfile
from contextlib import suppress
from pathlib import Path

import numpy as np

from kit.player import Gltf

_TOLERANCE = 1e-6
_IMPORT_SECONDS = 30.0
_PROJECT = 'config_version=4\n[application]\nconfig/name="check"\n'
# Positions of all blend shapes as Godot holds them, whole rather than deltas, one number a line.
_SCRIPT = """
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


def main(path: Path, node: str) -> int:
    """Compare; the exit code."""
    file = Gltf(path)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "project.godot").write_text(_PROJECT)
        (folder / "show.gd").write_text(_SCRIPT)
        (folder / "in.glb").write_bytes(path.read_bytes())
        command = ["godot3-server", "--no-window", "--path", name]
        # The editor imports, and may stay.
        with suppress(subprocess.TimeoutExpired):
            subprocess.run([*command, "-e", "-q"], capture_output=True, check=False, timeout=_IMPORT_SECONDS)
        subprocess.run([*command, "-s", "show.gd"], capture_output=True, check=False)
        shown = np.loadtxt(folder / "shown.txt").reshape(-1, 3)
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
    sys.exit(main(Path(sys.argv[1]), sys.argv[2]))
