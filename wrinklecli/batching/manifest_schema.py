"""The JSON Schema of a manifest: jobs, with the options of `wrinkle bake` by the same names.

`max-error` of the command line is `max_error` here. An option that may be repeated is a text or a list of texts.
"""

from typing import get_args

from wrinklecli.choices import MAX_LEVELS, Engine, FrameFormat, Mode, Storage, Tracks
from wrinklecli.numeric.memory import MAX_VERTICES
from wrinklecli.tools.json_schema import (
    FLAG,
    TEXT,
    Schema,
    any_keys,
    expects,
    key_of,
    list_of,
    mapping_of,
    number,
    one_of,
    whole,
)
from wrinklecli.tools.records import LENGTH

MAX_JOBS = 100_000
OWN_KEYS = ("asset", "lods")  # each job has its own; there are no defaults


def _texts(accepted: str) -> Schema:
    """One text or several."""
    return expects(accepted, type=["string", "array"], items=TEXT, minLength=1, minItems=1)


OPTION_KEYS: dict[str, Schema] = {
    "mode": key_of(one_of(*get_args(Mode)), "Keep the skin, or write a mesh for each frame.", default="morph"),
    "anim": key_of(_texts("a path or a list of paths"), "Files whose clips get into `out` too."),
    "clip": key_of(_texts("a name or a list of names"), "Bake only these clips."),
    "tool": key_of(_texts("a name or a list of names"), "Bake only these tools."),
    "fps": key_of(number(0.1, 1000), "Frames per second; overrides sampling.fps."),
    "max_error": key_of(LENGTH, "Refuse a file that is off by more.", default="1%"),
    "max_levels": key_of(whole(0, MAX_LEVELS), "Overrides refinement.max_levels; 0 does not refine."),
    "edges_per_interval": key_of(whole(1, 16), "Overrides refinement.edges_per_interval."),
    "max_vertices": key_of(whole(0, 100_000_000), "Refuse tools that would add more.", default=MAX_VERTICES),
    "accessors": key_of(one_of(*get_args(Storage)), "Of morph targets.", default="sparse"),
    "tracks": key_of(one_of(*get_args(Tracks)), "none: targets without weight tracks.", default="all"),
    "draft": key_of(FLAG, "A quick look: no proof, one level less.", default=False),
    "split": key_of(FLAG, "Meshes in parts, each with the morph targets alone that move it.", default=False),
    "morph_tangents": key_of(FLAG, "Add TANGENT to targets.", default=False),
    "engine": key_of(one_of(*get_args(Engine)), "Hold targets to what it plays, or refuse."),
    "frames_dir": key_of(TEXT, "Also write a file for each frame into this folder."),
    "frames_format": key_of(one_of(*get_args(FrameFormat)), "Of these files.", default="obj"),
    "maps_dir": key_of(TEXT, "Also write wrinkle maps into this folder."),
    "report": key_of(TEXT, "Write what was made and how exact it is (JSON)."),
    "timings": key_of(TEXT, "Write what it took (JSON)."),
    "allow_external": key_of(FLAG, "Read files outside the asset's folder too.", default=False),
    "max_memory": key_of(
        expects(
            "a size from 50MB up, such as 500MB or 4GB",
            type="string",
            pattern=r"^0*([5-9][0-9]|[1-9][0-9]{2,5})(\.[0-9]{1,3})? ?[Mm][Bb]$|"
            r"^([0-9]{0,5}[1-9](\.[0-9]{1,3})?|[0-9]{1,5}0(\.[0-9]{1,3})?) ?[GgTt][Bb]$",
        ),
        "Refuse what would take more.",
        default="1GB",
    ),
    "replace": key_of(FLAG, "Bake the original of an asset that is itself baked.", default=False),
    "strict": key_of(FLAG, "Treat warnings as refusals.", default=False),
}
_PATH_KEYS: dict[str, Schema] = {
    "asset": key_of(TEXT, "The .glb or .gltf to read, or a pattern such as chars/*.glb: a job for each."),
    "tools": key_of(_texts("a path or a list of paths"), "The tools file, or several that are merged."),
    "out": key_of(TEXT, "The .glb or .gltf to write; {stem} is the asset's name, {folder} its folder."),
    "anims": key_of(_texts("a path or a list of paths"), "Clips that `wrinkle track` gives the wrinkles of `out`."),
    "tracked": key_of(TEXT, "The folder for these."),
}
_LOD = mapping_of({**_PATH_KEYS, **OPTION_KEYS}, required=("asset",))
JOB_KEYS: dict[str, Schema] = {
    **_PATH_KEYS,
    **OPTION_KEYS,
    "lods": key_of(
        list_of(_LOD, 1, 100, "a list of levels of detail, each begun by a dash"),
        "Levels of detail in place of one asset: each inherits what the job says.",
    ),
}
_INHERITED = {name: values for name, values in JOB_KEYS.items() if name not in OWN_KEYS}
_DEFAULTS = {**mapping_of(_INHERITED), "type": ["object", "null"]}

MANIFEST_SCHEMA: Schema = {
    "$schema": "https://json-schema.org/draft/2020-12/schema",
    "title": "wrinkle batch",
    **mapping_of(
        {
            "version": key_of(expects("1, the only version so far", const=1), "Version of this format. Required: 1."),
            "defaults": key_of(_DEFAULTS, "What every job inherits where it does not say otherwise."),
            "profiles": key_of(
                any_keys(_DEFAULTS, "a mapping of profiles by their names"),
                "What every job inherits in place of defaults if --profile names it, such as mobile or desktop.",
            ),
            "include": key_of(
                _texts("a path or a list of paths"),
                "Manifests whose defaults, profiles and jobs are taken first; this one overrides them.",
            ),
            "jobs": key_of(
                list_of(mapping_of(JOB_KEYS), 1, MAX_JOBS, f"a list of 1 to {MAX_JOBS:,} jobs, each begun by a dash"),
                "What to bake.",
            ),
        },
        required=("version",),
    ),
}
