"""Godot 4.6 without an editor: the engine of an npm package, in Chromium, with a pack of our own in place of its game.

It takes seconds to start, so one session does all that tests ask, and they share what it answers.
"""

import base64
import json
import re
import shutil
import subprocess
import zipfile
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import wrinklecli
from kit.bakes import bake_config
from kit.browser import Page
from kit.clients import HERE, give_up
from kit.engines import browser_page
from kit.kept import kept
from kit.limb import write_tools
from kit.places import ROOT
from kit.samples import BROW, sample

DRIVER, CONFIGS = ROOT / "samples" / "driver", ROOT / "configs"
# Seconds of the clip at which the engine's own shaders are read.
NODE, CLIP, TIMES = "head", "raise_brows", (0.0, 0.35, 0.5, 0.9, 1.3)
# Of the two sets of maps: one for each channel of a mask, of which these have two.
WEIGHTS = ((0.9, 0.4, 0.0, 0.0), (0.5, 0.8, 0.0, 0.0))
# Places of a camera and of what it looks at: the forehead.
_LOOK = (0.05, 0.3, 0.5, 0.0, 0.25, 0.07)
_PROJECT = """config_version=5
[application]
config/name="wrinkle"
run/main_scene="res://main.tscn"
boot_splash/show_image=false
[rendering]
renderer/rendering_method="gl_compatibility"
"""
_SCENE = """[gd_scene load_steps=2 format=3]
[ext_resource type="Script" path="res://godot4.gd" id="1"]
[node name="main" type="Node3D"]
script = ExtResource("1")
"""


@cache
def answers() -> tuple[dict[str, Any], Path]:
    """The answers of Godot 4, and of the shaders for Unity and Unreal.

    Returns:
        `gap`: the greatest distance of a vertex of the head from our player's, of the mesh's size; `vectors`: as
        `answers.gd` gives them; `driven`: for frames of a clip the second, the weight of the track and that of the
        driver's node; `said`: what the engine printed. And a folder with `maps` of the head in two sets, and what each
        shader blends of them by `WEIGHTS`: the picture `godot.png`, and RGBA bytes in rows, `unity` and `unreal`.
    """
    folder = kept("godot4", _answered)
    found: dict[str, Any] = json.loads((folder / "answers.json").read_text())
    return found, folder


def _answered(folder: Path) -> None:
    maps = folder / "maps"
    # Two tools at one place, each with bumps that rise from both ends: two sets with two channels of a mask.
    pair = [{**BROW, "name": name, "strategy": "both_ends", "bumps": bumps} for name, bumps in (("one", 4), ("two", 3))]
    wrinklecli.maps(sample(NODE), write_tools(folder / "tools.yaml", *pair), maps, size=256, supersample=1)
    file, own = bake_config(NODE, NODE), folder / "own"
    wrinklecli.maps(sample(NODE), CONFIGS / f"{NODE}.yaml", own, size=256, supersample=1, unwrap=folder / "plain.glb")
    with zipfile.ZipFile(folder / "pack.zip", "w") as pack:
        pack.writestr("project.godot", _PROJECT)
        pack.writestr("main.tscn", _SCENE)
        sources = [*(DRIVER / "godot").iterdir(), DRIVER / "vectors.json", HERE / "godot4.gd", HERE / "answers.gd"]
        for path in sources:
            pack.write(path, path.name)
        pack.write(file.path, "in.glb")
        for path in (*maps.iterdir(), *own.iterdir()):
            pack.write(path, f"{path.parent.name}/{path.name}")
        pack.write(folder / "plain.glb", "own/plain.glb")
    posed = file.pose(NODE, CLIP, TIMES)
    more = [folder / "pack.zip", maps, HERE / "blended.mjs"]
    with browser_page("godot4", file, NODE, CLIP, TIMES, posed, more=more) as (shown, page):
        found = {
            "gap": np.abs(shown - posed).max() / np.abs(posed).max(),
            "vectors": _asked(page, "vectors"),
            "driven": _asked(page, "driven", "in.glb", CLIP),
        }
        picture = base64.b64decode(_asked(page, "blended", "maps", *WEIGHTS[0], *WEIGHTS[1]))
        (folder / "godot.png").write_bytes(picture)
        # With its own material, whose shader it compiles; of further texture coordinates.
        page.value(f"godot.open('own/plain.glb', {json.dumps(CLIP)})")
        _asked(page, "picture", 0.5, "own", *_LOOK)
        for engine in ("unity", "unreal"):
            (folder / engine).write_bytes(_blended(page, glsl_of(folder, engine), maps))
        found["said"] = page.value("window.said")
    (folder / "answers.json").write_text(json.dumps(found))


def _asked(page: Page, name: str, *arguments: object) -> Any:
    """The answer of a method of `godot4.gd`."""
    page.value(f"window.answer = null, godot.{name}({','.join(map(json.dumps, arguments))})")
    return json.loads(page.wait("window.answer"))


def _blended(page: Page, text: str, maps: Path) -> bytes:
    """RGBA of what a pixel shader makes of maps."""
    data = json.loads((maps / "maps.json").read_text())
    kinds = {"Normal": "normal", "Occlusion": "ao"}
    sets = list(enumerate(data["materials"][0]["sets"], start=1))
    images = {f"{kind}{number}": f"maps/{each[key]}" for number, each in sets for kind, key in kinds.items()}
    images |= {f"Mask{number}": f"maps/{each['weights'][0]['mask']}" for number, each in sets}
    vectors = {f"Weights{number}": WEIGHTS[number - 1] for number, _ in sets}
    given = ",".join(map(json.dumps, (text, data["size"], images, vectors)))
    return base64.b64decode(page.value(f"import('./blended.mjs').then(each => each.blended({given}))"))


_UNITY = """#define TEXTURE2D(name) Texture2D name
#define SAMPLER(name) SamplerState name
#define SAMPLE_TEXTURE2D(map, how, uv) map.Sample(how, uv)
{text}
float4 main(float2 uv : TEXCOORD0) : SV_Target
{{
    float3 normal;
    float occlusion;
    {function}(uv, float3(0.0, 0.0, 1.0), normal, occlusion);
    return float4(normal * 0.5 + 0.5, occlusion);
}}
"""
_MAPS = [f"{kind}{number}" for number in (1, 2) for kind in ("Normal", "Occlusion", "Mask")]
_UNREAL = """#define Texture2DSample(map, how, uv) map.Sample(how, uv)
{declared}
float4 gWeights1;
float4 gWeights2;
float4 CustomExpression0(float2 UV, float3 Own, float4 Weights1, float4 Weights2, {inputs})
{{
{text}
}}
float4 main(float2 uv : TEXCOORD0) : SV_Target
{{
    float4 found = CustomExpression0(uv, float3(0.0, 0.0, 1.0), gWeights1, gWeights2, {given});
    return float4(found.xyz * 0.5 + 0.5, found.w);
}}
"""


def hlsl_of(engine: str) -> list[str]:
    """Whole pixel shaders round the text of an engine, as that engine writes them: one, or one for each precision."""
    if engine == "unity":
        text = (DRIVER / "csharp" / "unity" / "WrinkleMaps.hlsl").read_text()
        halves = _UNITY.replace("float3 n", "half3 n").replace("float o", "half o")
        return [_UNITY.format(text=text, function="Wrinkle_float"), halves.format(text=text, function="Wrinkle_half")]
    text = (DRIVER / "unreal" / "WrinkleMaps.hlsl").read_text()
    declared = "\n".join(f"Texture2D g{each}; SamplerState sampler_g{each};" for each in _MAPS)
    inputs = ", ".join(f"Texture2D {each}, SamplerState {each}Sampler" for each in _MAPS)
    given = ", ".join(f"g{each}, sampler_g{each}" for each in _MAPS)
    return [_UNREAL.format(text=text, declared=declared, inputs=inputs, given=given)]


def glsl_of(folder: Path, engine: str) -> str:
    """The text of an engine as a browser's shader, by glslang and SPIRV-Cross."""
    found = ""
    for text in reversed(hlsl_of(engine)):
        (folder / "shader.frag").write_text(text)
        asked = ("-D", "-V", "-e", "main", "--auto-map-bindings", "--auto-map-locations", "-o", "shader.spv")
        _run("glslangValidator", "glslang-tools", *asked, "shader.frag", at=folder)
        told = ("--es", "--version", "300", "--glsl-emit-ubo-as-plain-uniforms")
        found = _run("spirv-cross", "spirv-cross", "shader.spv", *told, at=folder)
    # Each draws with all of its digits, and with names that say the texture first.
    return re.sub(r"SPIRV_Cross_Combined_?", "", found).replace("mediump", "highp")


def _run(command: str, package: str, *arguments: str, at: Path) -> str:
    """The output of a program of Debian; without it the test is skipped, and fails where `CI` is set."""
    if shutil.which(command) is None:
        give_up(f"{command} is not installed: apt-get install {package}")
    done = subprocess.run([command, *arguments], cwd=at, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout
