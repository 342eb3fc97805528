"""Text of tools files, with what is said of mistakes in it, and Hypothesis strategies for the values of its keys."""

import pytest
from hypothesis import strategies as st

from kit.places import ROOT
from wrinklecli.errors import ConfigError
from wrinklecli.tools.materials import presets
from wrinklecli.tools.read import parse_tools
from wrinklecli.tools.records import WrinkleTool
from wrinklecli.tools.schema import TOOLS_SCHEMA

README = (ROOT / "configs" / "README.md").read_text(encoding="utf-8")
# All pages on the tools file, one below the other.
REFERENCE = "\n".join(page.read_text(encoding="utf-8") for page in sorted((ROOT / "configs").glob("*.md")))
# Lines 1 to 5 of a file with one tool; more keys of the tool follow from line 6 on.
HEAD = """version: 1
tools:
  - name: brow.L
    origin: [1, 2, 3]
    target: [1, 4, 3]
"""
EVERYTHING = """\
version: 1
up: y
rest: {clip: walk, time: 0.5}
sampling: {fps: 24, clips: [walk, run]}
refinement: {max_levels: 3, edges_per_interval: 4, scheme: midpoint}
defaults: {attenuation: linear}
tools:
  - name: brow.L
    node: head_male
    origin: [0.035, 0.845, 0.150]
    target: {marker: brow_top.L}
    snap: vertex
    width: 0.05
    material: cloth
    strategy: both_ends
    bumps: 5
    gap: 1
    max_height: 40%
    details: [0.2, 0.1]
    profile: polyline
    variation: 0.8
    seed: 7
    branch: 0.5
    broken: 0.6
    attachment: patch
    strength: -0.5
    clips: {walk: 0.3, idle: 0}
    rest_length: {keys: {frown: [[0, 0.06], [0.5, 110%]]}}
    enabled: true
    optional: true
"""
LENGTHS = "a length from 1e-9 to 1e9 scene units or a percentage from 0.01% to 10000%"
TEXT = "text, in quotes where YAML would read a number, true, false or null"
FILE = TOOLS_SCHEMA["properties"]
MUSCLE = FILE["muscles"]["items"]["properties"]
FIELD = FILE["fields"]["items"]["properties"]
FLESH = FILE["flesh"]["items"]["properties"]
TOUCH = FILE["touches"]["items"]["properties"]
TOOL = FILE["tools"]["items"]["properties"]
TOOL_KEYS = ", ".join(TOOL)
FILE_KEYS = ", ".join(FILE)
BAD_TOOL_KEYS = [  # one more key on line 6 of HEAD (width on line 7), the line's rest
    ("widht: 0.05", "tools[0].widht: unknown key, did you mean width?"),
    ("Bumps: 3", "tools[0].Bumps: unknown key, did you mean bumps?"),
    ("zzz: 3", f"tools[0].zzz: unknown key, expected {TOOL_KEYS}"),
    ('"a b\\n": 3', f"tools[0]['a b\\n']: unknown key, expected {TOOL_KEYS}"),
    ("bumps: 2.5", "tools[0].bumps: found 2.5, expected a whole number from 1 to 64"),
    ("bumps: 0", "tools[0].bumps: found 0, expected a whole number from 1 to 64"),
    ("bumps: 65", "tools[0].bumps: found 65, expected a whole number from 1 to 64"),
    ("bumps: 010", "tools[0].bumps: found 010, expected a whole number from 1 to 64"),
    ("bumps: '3'", "tools[0].bumps: found '3', expected a whole number from 1 to 64"),
    ("bumps: true", "tools[0].bumps: found true, expected a whole number from 1 to 64"),
    ("bumps:", "tools[0].bumps: found nothing, expected a whole number from 1 to 64"),
    ("bumps: [1]", "tools[0].bumps: found a list of 1, expected a whole number from 1 to 64"),
    (f"bumps: {'9' * 5000}", f"tools[0].bumps: found {'9' * 39}…, expected a whole number from 1 to 64"),
    ("gap: -1", "tools[0].gap: found -1, expected a whole number from 0 to 64"),
    ("max_height: tall", f"tools[0].max_height: found tall, expected auto, none, {LENGTHS}"),
    (
        "max_height: atuo",
        f"tools[0].max_height: found atuo, expected auto, none, {LENGTHS}; did you mean auto?",
    ),
    ("max_height: 0%", f"tools[0].max_height: found 0%, expected auto, none, {LENGTHS}"),
    ("details: [0.5, 0]", "tools[0].details[1]: found 0, expected a number from 0.001 to 0.99"),
    ("details: 0.5", "tools[0].details: found 0.5, expected a list of up to 4 shares"),
    (
        "details: [.1, .1, .1, .1, .1]",
        "tools[0].details: found a list of 5, expected a list of up to 4 shares",
    ),
    (
        "details: [0.5, 0.5]",
        "tools[0].details: found a list of 2, expected shares whose sum is at most 0.99, not 1",
    ),
    ("snap: on", "tools[0].snap: found on, expected surface or vertex"),
    ("snap: vertx", "tools[0].snap: found vertx, expected surface or vertex; did you mean vertex?"),
    ("material: wool", f"tools[0].material: found wool, expected {', '.join(presets())} or none"),
    (
        "material: cloht",
        f"tools[0].material: found cloht, expected {', '.join(presets())} or none; did you mean cloth?",
    ),
    ("material: 5", f"tools[0].material: found 5, expected {', '.join(presets())} or none"),
    ("mirror: w", "tools[0].mirror: found w, expected x, y, z or none"),
    (
        "strategy: Both ends",
        "tools[0].strategy: found Both ends, expected everywhere, origin or both_ends; did you mean both_ends?",
    ),
    ("node: no", f"tools[0].node: found no, expected {TEXT}"),
    ("node: 5", f"tools[0].node: found 5, expected {TEXT}"),
    ("node: ''", f"tools[0].node: found '', expected {TEXT}"),
    ("strength: .nan", "tools[0].strength: found .nan, expected a number from -100 to 100"),
    ("strength: -.inf", "tools[0].strength: found -.inf, expected a number from -100 to 100"),
    ("strength: 1e400", "tools[0].strength: found 1e400, expected a number from -100 to 100"),
    ("clips: walk", "tools[0].clips: found walk, expected a mapping of clip names to strengths"),
    ("clips: {a: x}", "tools[0].clips.a: found x, expected a number from -100 to 100"),
    ("clips: {'Walk 1': no}", "tools[0].clips['Walk 1']: found no, expected a number from -100 to 100"),
    ("enabled: maybe", "tools[0].enabled: found maybe, expected true or false"),
    ("enabled: 1", "tools[0].enabled: found 1, expected true or false"),
    ("optional: 'yes'", "tools[0].optional: found 'yes', expected true or false"),
    (
        "rest_length: {}",
        f"tools[0].rest_length: found a mapping, expected auto, {LENGTHS}, "
        "{keys: {CLIP: [[SECONDS, LENGTH], …]}} or {morph: NAME, full: LENGTH}",
    ),
    ("rest_length: {morph: a}", "tools[0].rest_length.full: required, but missing"),
    ("rest_length: {morp: a, full: 1}", "tools[0].rest_length.morp: unknown key, did you mean morph?"),
    (
        "rest_length: {keys: {}}",
        "tools[0].rest_length.keys: found a mapping, expected a mapping of clip names to lists of [seconds, length]",
    ),
    (
        "rest_length: {keys: {a: []}}",
        "tools[0].rest_length.keys.a: found a list of 0, expected a list of one or more [seconds, length]",
    ),
    (
        "rest_length: {keys: {a: [[1, 1], [1, 2]]}}",
        "tools[0].rest_length.keys.a: found a list of 2, expected times that rise from key to key, not 1 and then 1",
    ),
    (
        "rest_length: {keys: {a: [[1, 1], [2]]}}",
        "tools[0].rest_length.keys.a[1]: found a list of 1, expected [seconds, length]",
    ),
    (
        "rest_length: {keys: {a: [[-1, 1]]}}",
        "tools[0].rest_length.keys.a[0][0]: found -1, expected seconds from 0 to 1e6",
    ),
    (
        'node: "a\\eb\\n"\nnode: x',
        "tools[0].node: duplicate key, first on line 6",
    ),
    ("node: !py x", "tools[0].node: found the tag !py, expected a value without it"),
    (
        "node: !!python/object:os.system x",
        "tools[0].node: found the tag python/object:os.system, expected a value without it",
    ),
    ('node: "\\ud800"', "tools[0].node: found '\\ud800', expected valid Unicode"),
    ("<<: 5", "tools[0]['<<']: expected a mapping to merge"),
    ("? [a]\n: 5", "tools[0]: found a key that is no text, expected a name"),
    (
        'enabled: "\\e[31m' + "x" * 50 + '"',
        f"tools[0].enabled: found '\\x1b[31m{'x' * 34}…', expected true or false",
    ),
]
BAD_HEADERS = [
    ("version: 2", "version: found 2, expected 1, the only version so far"),
    ("version: true", "version: found true, expected 1, the only version so far"),
    ("version: '1'", "version: found '1', expected 1, the only version so far"),
    ("up: x", "up: found x, expected y or z"),
    ("up: yes", "up: found yes, expected y or z"),
    ("up: Y", "up: found Y, expected y or z; did you mean y?"),
    ("rest: bound", "rest: found bound, expected stored, bind or {clip: NAME, time: 0}; did you mean bind?"),
    ("rest: {time: 1}", "rest.clip: required, but missing"),
    ("rest: {clip: a, time: -1}", "rest.time: found -1, expected seconds from 0 to 1e6"),
    ("sampling: 30", "sampling: found 30, expected a mapping of fps, clips"),
    ("sampling: {fps: 0}", "sampling.fps: found 0, expected a number from 0.1 to 1000"),
    ("sampling: {clips: walk}", "sampling.clips: found walk, expected all or a list of clip names"),
    ("sampling: {clips: []}", "sampling.clips: found a list of 0, expected all or a list of clip names"),
    ("sampling: {clips: [a, 1]}", f"sampling.clips[1]: found 1, expected {TEXT}"),
    ("sampling: {clips: [a, a]}", "sampling.clips: found a list of 2, expected each clip named once"),
    ("refinement: {max_lvls: 2}", "refinement.max_lvls: unknown key, did you mean max_levels?"),
    ("refinement: {zzz: 2}", "refinement.zzz: unknown key, expected max_levels, edges_per_interval, scheme"),
    (
        "refinement: {max_levels: 9}",
        "refinement.max_levels: found 9, expected a whole number from 0 to 8",
    ),
    (
        "refinement: {scheme: loop}",
        "refinement.scheme: found loop, expected butterfly, midpoint or butterfly_full",
    ),
    ("defaults: 5", f"defaults: found 5, expected a mapping of {', '.join(FILE['defaults']['properties'])}"),
    ("defaults: {name: a}", "defaults.name: not inherited, each tool needs its own"),
    ("defaults: {bumps: 0}", "defaults.bumps: found 0, expected a whole number from 1 to 64"),
    ("defaults: {bupms: 1}", "defaults.bupms: unknown key, did you mean bumps?"),
    ("tool: []", "tool: unknown key, did you mean tools?"),
]
LENGTH = st.one_of(
    st.floats(1e-6, 1e6), st.integers(1, 1000), st.integers(1, 10_000).map(lambda percent: f"{percent}%")
)
NAMES = st.text("abcLRxyz_.019 éß", min_size=1, max_size=8)
ANCHORS = st.one_of(
    st.lists(st.floats(-1e6, 1e6), min_size=3, max_size=3),
    NAMES.map(lambda name: {"marker": name}),
)
TIMES = st.lists(st.floats(0, 1e6), min_size=1, max_size=4, unique=True).map(sorted)
OPTIONS = {
    "node": NAMES,
    "snap": st.sampled_from(["surface", "vertex"]),
    "strategy": st.sampled_from(["everywhere", "origin", "both_ends"]),
    "material": st.sampled_from(["none", None, *presets()]),
    "bumps": st.integers(1, 64),
    "gap": st.integers(0, 64),
    "max_height": st.one_of(st.sampled_from(["auto", "none", None]), LENGTH),
    "details": st.lists(st.floats(0.001, 0.2), max_size=4),
    "profile": st.sampled_from(["smooth", "skin", "cloth", "polyline"]),
    "variation": st.floats(0, 1),
    "seed": st.one_of(st.none(), st.integers(0, 2**31 - 1)),
    "branch": st.floats(0, 1),
    "broken": st.floats(0, 1),
    "attenuation": st.sampled_from(["bell", "linear"]),
    "attachment": st.sampled_from(["skin", "patch"]),
    "bow": st.floats(-1, 1),
    "strength": st.floats(-100, 100),
    "clips": st.dictionaries(NAMES, st.floats(-100, 100), max_size=3),
    "rest_length": st.one_of(
        st.just("auto"),
        LENGTH,
        st.fixed_dictionaries({"morph": NAMES, "full": LENGTH}),
        st.dictionaries(NAMES, TIMES.map(lambda times: [[time, "90%"] for time in times]), min_size=1, max_size=2).map(
            lambda keys: {"keys": keys}
        ),
    ),
    "optional": st.booleans(),
}


def first_tool(more: str = "width: 1", **options: str) -> WrinkleTool:
    """The first tool of HEAD with more keys."""
    text = options.get("before", "") + HEAD + "".join(f"    {line}\n" for line in more.splitlines())
    return parse_tools(text).tools[0]


def lines_of(text: str, name: str = "t.yaml") -> list[str]:
    with pytest.raises(ConfigError) as caught:
        parse_tools(text, name=name)
    return list(caught.value.lines)


def tool_lines(more: str) -> list[str]:
    return lines_of(HEAD + "".join(f"    {line}\n" for line in more.splitlines()))
