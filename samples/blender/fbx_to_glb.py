"""Converts an FBX file, or another that Blender imports, to a .glb with all of its clips, without a window.

    blender -b --python fbx_to_glb.py -- in.fbx [out.glb]

Also with Blender as a module: `pip install bpy`, `python fbx_to_glb.py in.fbx [out.glb]`. Each action becomes a clip.
All influences of joints and all morph targets stay, and nothing is resampled more coarsely than a frame of the file.
"""

import json
import re
import sys
from pathlib import Path
from typing import Any

import bpy

_IMPORTERS = {
    # By default Blender moves clips by a frame, to begin at frame 1.
    ".fbx": lambda path: bpy.ops.import_scene.fbx(filepath=path, anim_offset=0.0),
    ".blend": lambda path: bpy.ops.wm.open_mainfile(filepath=path),
    ".usd": lambda path: bpy.ops.wm.usd_import(filepath=path),
}
_IMPORTERS |= dict.fromkeys((".usda", ".usdc", ".usdz"), _IMPORTERS[".usd"])
_EXPORT = {
    "export_format": "GLB",
    "export_animation_mode": "ACTIONS",
    "export_merge_animation": "NLA_TRACK",
    "export_frame_range": False,
    "export_optimize_animation_size": False,
    "export_all_influences": True,
    "export_rest_position_armature": True,
    "export_morph_normal": True,
}


_LAYER = re.compile(r"(Base ?|Anim)?Layer\d*")


def clip_name(action: str) -> str:
    """The clip in an action's name, such as `Armature|walk|BaseLayer` of Maya or `rig|rig|walk` of Blender."""
    parts = [each for each in action.split("|") if not _LAYER.fullmatch(each)]
    return parts[-1] if parts else action


def lay_tracks() -> None:
    """Put each imported action into a track of what it moves, which gets the name of the clip.

    Blender exports the actions in tracks, each by the name of its track; what an armature and shape keys have by one
    name becomes one clip.
    """
    for owner in (*bpy.data.objects, *bpy.data.shape_keys):
        # The importer begins the name of an action with that of what it moves.
        actions = [each for each in bpy.data.actions if each.name.split("|")[0] == owner.name]
        for action in actions:
            animation = owner.animation_data or owner.animation_data_create()
            animation.action = None
            track = animation.nla_tracks.new()
            track.name = clip_name(re.sub(r"\.\d{3}$", "", action.name))
            strip = track.strips.new(track.name, int(action.frame_range[0]), action)
            kind = "KEY" if owner in {*bpy.data.shape_keys} else "OBJECT"
            slot = next((each for each in getattr(action, "slots", ()) if each.target_id_type == kind), None)
            if slot is not None:
                strip.action_slot = slot
            track.mute = True


def clips_in(path: Path) -> list[str]:
    """The names of the clips of a .glb."""
    data = path.read_bytes()
    document = json.loads(data[20 : 20 + int.from_bytes(data[12:16], "little")])
    return sorted(each["name"] for each in document.get("animations", ()))


def convert(source: Path, out: Path) -> list[str]:
    """Convert a file; the names of its clips.

    Raises:
        ValueError: The file is not there, or Blender has no importer of its kind.
    """
    importer = _IMPORTERS.get(source.suffix.lower())
    if importer is None:
        raise ValueError(f"{source}: ends in none of {', '.join(_IMPORTERS)}")
    if not source.is_file():
        raise ValueError(f"{source}: is not there")
    bpy.ops.wm.read_factory_settings(use_empty=True)
    importer(str(source))
    if source.suffix.lower() == ".fbx":
        lay_tracks()
    known = bpy.ops.export_scene.gltf.get_rna_type().properties.keys()
    options: dict[str, Any] = {key: value for key, value in _EXPORT.items() if key in known}
    bpy.ops.export_scene.gltf(filepath=str(out), **options)
    return clips_in(out)


def main(arguments: list[str]) -> int:
    """Convert what the command line names; the exit code."""
    if not 1 <= len(arguments) <= 2:
        print(__doc__, file=sys.stderr)
        return 2
    source = Path(arguments[0])
    out = Path(arguments[1]) if arguments[1:] else source.with_suffix(".glb")
    try:
        clips = convert(source, out)
    except (ValueError, RuntimeError) as error:
        print(error, file=sys.stderr)
        return 1
    print(f"{out}: clips {', '.join(clips) or 'none'}")
    return 0


if __name__ == "__main__":
    # Blender's own options stand before `--`.
    sys.exit(main(sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:]))
