"""Cases of the attack: a number always gives the same command, on the same files with the same faults."""

import json
import random
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import get_args

from kit.damage import Edit, body_edits, damage, geometry_edit, is_baked, presets_edits
from kit.hostile import Source, corpus
from kit.manifests import NAMES, forgeries, manifest_edits
from kit.visits import visits
from wrinklecli.choices import Engine

_LINKS = ("link", "hard link", "link to itself", "link to nothing", "link to ASSET", "hard link to ASSET")
DEVICES = ("/dev/null", "/dev/full", "/dev/zero")
_PLACES = (*_LINKS, "folder", "nothing", "pipe", *DEVICES)
_DISPLACED = {"batch": 0.15, "edit": 0.2}  # of the cases of these commands
_DISPLACED_ELSE = 0.05  # of others
# More files in whose places something else may stand, by command.
# fmt: off
_MORE_PLACES = {
    "batch": (
        "cache", "cache/keys", "cache/files", "sub", "sub/limb.gltf", "sub/limb.bin", "sub/out.glb", "sub/tracked",
        "sub/report.json", "sound.glb",
    ),
    "edit": (".tools.yaml.unsaved", ".tools.yaml.unsaved", "tools.yaml"),
}
# fmt: on
# Of the cases of commands that write; the editor is killed while it saves, before it is started again.
_KILLED = {
    "bake": 0.02,
    "track": 0.02,
    "suggest": 0.02,
    "schema": 0.02,
    "preview": 0.02,
    "batch": 0.03,
    "edit": 0.15,
    "maps": 0.02,
}
_DISK = 0.05  # of the cases of commands that write meet a disk that fails
_BESIDE = 0.02  # of them run beside themselves
_SOLVE = ("bake", "check", "batch", "preview")
_CONTACT = 0.06  # of all cases of these commands get contact in a tool
_BODY = 0.08  # of all cases of these commands get a muscle, flesh or a field
_CONTACTS = ("resolve", "resolve", "resolve", {}, {"per_clip": False}, {"ignore": ["limb"]}, "off")
PRESETS = "own.yaml"  # a file of presets
MOTIONS = ("still.glb", "stranger.glb")  # a clip of 0 s, and clips of another skeleton
_LARGE = range(17, 22)  # sources of the corpus that take longer
_CACHED = (0, 3, 6, 8)  # sources whose sound batches are kept in caches
WEB = "web:"  # begins the name of a file in the place of which a server gives an answer of its own
_SERVED = ("limb.glb", "limb.gltf", "tools.yaml", "all.zip", "all.tar.gz", "")
ANSWERS = (
    "announced", "endless", "stopped", "silent", "dribbled", "crawling", "broken", "inflated", "zip bomb",
    "zip that says less", "tar bomb", "sound",
)  # fmt: skip
# fmt: off
_COMMANDS = {
    "bake": 30, "inspect": 15, "diff": 20, "check": 10, "suggest": 8, "track": 10, "preview": 7, "schema": 1,
    "batch": 24, "edit": 2, "doctor": 1, "maps": 4, "demo": 1, "completion": 1,
}
# fmt: on


@dataclass(frozen=True)
class Case:
    """A command on damaged files.

    Attributes:
        name: For messages.
        source: Number of the sound asset in the corpus.
        edits: What was done to it and its tools.
        arguments: Of the command line; names of files are relative to the case's folder.
        places: What stands in the place of some of the files, by name: see `_displace`.
    """

    name: str
    source: int
    edits: Sequence[Edit]
    arguments: Sequence[str]
    places: Mapping[str, str] = field(default_factory=dict)

    def dumped(self) -> str:
        """The case as a line of JSON."""
        kept = {"source": self.source, "edits": self.edits, "arguments": self.arguments}
        return json.dumps(kept | ({"places": self.places} if self.places else {}))


def loaded(line: str, name: str) -> Case:
    """A case as it was dumped."""
    return Case(name, **json.loads(line))


def make_case(number: int) -> Case:
    """The case of a number."""
    chance = random.Random(number)
    sources = corpus()
    command = chance.choices(list(_COMMANDS), list(_COMMANDS.values()))[0]
    wanted = [k for k, source in enumerate(sources) if command != "track" or chance.random() < 0.5 or is_baked(source)]
    source = chance.choices(wanted, [1 if k in _LARGE else 3 for k in wanted])[0]
    arguments = list(_arguments(chance, command, sources[source]))
    edits = list(_edits(chance, arguments, sources[source]))
    files = [each for each in arguments if Path(each).suffix[1:].isalpha() and "{" not in each]
    files += _MORE_PLACES.get(command, ())
    share = _DISPLACED.get(command, _DISPLACED_ELSE)
    places = {chance.choice(files): chance.choice(_PLACES)} if files and chance.random() < share else {}
    if any("{web}" in each for each in arguments):
        places |= {f"{WEB}{chance.choice(_SERVED)}": chance.choice(ANSWERS)}
    return Case(f"{number} ({' '.join(arguments)})", source, edits, arguments, places)


def _edits(chance: random.Random, arguments: Sequence[str], source: Source) -> Iterator[Edit]:
    """Edits of the files of a command, acts of others while it runs, and the call at which it is killed."""
    command = arguments[0]
    if chance.random() < _KILLED.get(command, 0.0):
        sign = chance.choice(["SIGKILL", "SIGKILL", "SIGTERM", "SIGINT"])
        yield [sign, "kill", int(1.5 ** chance.uniform(0, 18))]
        if chance.random() < 0.8:
            return
    elif command in _KILLED and chance.random() < _DISK:
        kinds = ("ENOSPC", int(1.5 ** chance.uniform(0, 9))), ("EIO", int(1.5 ** chance.uniform(0, 9)))
        kinds += ("EFBIG", int(1.5 ** chance.uniform(0, 40))), ("EROFS", 0), ("EACCES", 0)
        name, number = chance.choice(kinds)
        yield [name, "disk", number]
        if chance.random() < 0.8:
            return
    elif command in _KILLED and command != "edit" and "--watch" not in arguments and chance.random() < _BESIDE:
        yield ["rest", "beside", int(1.5 ** chance.uniform(0, 18))]
        if chance.random() < 0.8:
            return
    match command:
        case "batch" if arguments[1] in NAMES and chance.random() < 0.8:
            yield from manifest_edits(chance)
        case "batch" if "kept" in arguments:
            yield from forgeries(chance)
        case "edit":
            if chance.random() < 0.3:
                yield from damage(chance, source)
            if chance.random() < 0.3:
                yield from _side_edits(chance)
            yield from visits(chance)
        case _:
            yield from damage(chance, source)
    if (
        command in _SOLVE
        and "kept" not in arguments
        and chance.random() < _CONTACT
        and not any(source is corpus()[number] for number in _LARGE)
    ):
        yield ["set", "tools", ["tools", 0, "contact"], chance.choice(_CONTACTS)]
        if chance.random() < 0.5:
            yield from geometry_edit(chance)
    if command in _SOLVE and "kept" not in arguments and chance.random() < _BODY:
        yield from body_edits(chance)
    if PRESETS in arguments and chance.random() < 0.7:
        yield from presets_edits(chance)
    if "--watch" in arguments:
        names = [arguments[1], arguments[1], "tools.yaml", "sound.glb", "p.png"]
        for _ in range(chance.choice([1, 2, 4])):
            yield [
                chance.choice(["half", "pipe", "folder", "again", "again", "sound", "gone"]),
                "later",
                chance.choice(names),
            ]


def _side_edits(chance: random.Random) -> Iterator[Edit]:
    """Faults in the file in which the editor keeps what is not saved."""
    values = [
        None,
        5,
        "",
        "x",
        "tools: [",
        "version: 1\ntools: []\n",
        "\ud800",
        "a\0b",
        [],
        {},
        float("nan"),
        "&a [*a]",
        "x" * 10**6,
    ]
    place = chance.randrange(300)
    deep = chance.choice([b"[" * 200_000, b"\xff\xfe", b"\0", b"NaN"])
    edits = (
        ["set", "side", [chance.choice(["wrinkle_edit", "base", "text", "text", "other"])], chance.choice(values)],
        ["drop", "side", [chance.choice(["wrinkle_edit", "base", "text"])]],
        ["cut", "side bytes", place, chance.choice([1, 64, 10**6])],
        ["flip", "side bytes", place, 1 << chance.randrange(8)],
        ["put", "side bytes", chance.choice([0, place]), deep.hex()],
    )
    yield chance.choice(edits)


def _arguments(chance: random.Random, command: str, source: Source) -> Iterator[str]:
    def some(*options: str, share: float = 0.15) -> Iterator[str]:
        if chance.random() < share:
            yield from options

    asset = f"limb{source.suffix}"
    memory = "--max-memory", chance.choice(["50MB", "200MB", "4GB"])
    loudness = chance.choice(["--verbose", "--quiet"])
    report = chance.choice(["report.json"] * 5 + ["out.glb", "tools.yaml", asset])
    # What moves an asset besides its own clips: the damaged one moves itself or others, and sound ones move it.
    anims = list(some("--anim", chance.choice([asset, "sound.glb", "body.glb", "nowhere.glb", *MOTIONS])))
    motions = [*anims, *some("--range-of-motion", share=0.05)]
    pose = "--pose", chance.choice(["joint_1=z:60", "joint_0=x:-170", "none=y:5", "limb=x:90", "joint_1=z:0"])
    morph = "--morph", chance.choice(["morph_0=1", "morph_1=-2.5", "none=0.5", "morph_0=9"])
    posing = chance.choice([pose, morph, (*pose, *morph)])
    yield command
    match command:
        case "bake":
            replaced = list(some("--replace", share=0.6))
            yield from (asset, "tools.yaml", *replaced, *some("--report", report), *anims)
            if not replaced:  # the two go not together
                yield from some("--maps-dir", chance.choice(["maps", "maps", ".", "sub", "frames", asset]), share=0.1)
            yield from some("--mode", chance.choice(["frames", "frames", "weights"]))
            yield from some("--accessors", chance.choice(["dense", "based"]))
            yield from some("--tracks", "none")
            yield from some("--morph-tangents")
            yield from (*some("--draft"), *some("--split"), *some("--edges-per-interval", "1", share=0.1))
            yield from some("--engine", chance.choice(get_args(Engine)))
            yield from some("--frames-dir", "frames", "--frames-format", chance.choice(["obj", "ply", "glb"]))
            yield from some("--timings", "timings.json", share=0.05)
            yield from some("--depfile", "out.d")
            yield from some("--cache", chance.choice(["cache", "cache", asset, "tools.yaml"]))
            yield from some("--max-levels", "0")
            yield from some("--max-vertices", chance.choice(["10", "1000"]), share=0.1)
            yield from some("--max-error", chance.choice(["0.01%", "1"]), share=0.1)
            yield from some("--tool", "limb", share=0.05)
            yield from some("--fps", "2")
            yield from some("--clip", "fold")
            yield from some("--strict", share=0.05)
            yield from some(loudness)
            yield from (*some("--progress", share=0.05), *some("--json", share=0.1))
            yield from some("--allow-external")
            yield from some(*memory, share=0.1)
            yield from ("-o", chance.choice(["out.glb"] * 9 + ["out.gltf"] * 5 + ["sub/out.gltf"] * 4 + [asset]))
        case "check" if chance.random() < 0.2:
            yield from (asset, *some("tools.yaml", share=0.7), "--crossings", *some("--json"), *some("--fps", "3"))
            yield from (*chance.choice([[], [], ["--clip", "fold"], posing]), *some("--strict"), *motions)
        case "check":
            yield from (asset, "tools.yaml", *some("--json", share=0.5), *some("--fps", "3"))
            yield from chance.choice([[], [], [], [], ["--clip", "fold"], posing])
            yield from (*motions, *some("--strict"), *some("--allow-external"), *some(*memory, share=0.1))
            yield from (*some("--max-levels", "0"), *some("--max-vertices", "10", share=0.1))
            yield from some("--tool", "limb", share=0.1)
            yield from some("--plot", chance.choice(["plot.svg", "plot.svg", "plot.png"]), share=0.2)
            yield from (*some("--verbose", share=0.3), *some("--progress", share=0.05))
        case "inspect":
            yield from (asset, *some("--json", share=0.5), *some("--allow-external"), *some(*memory, share=0.1))
        case "diff":
            yield from chance.choice([(asset, "sound.glb"), ("sound.glb", asset), (asset, "twin.glb"), (asset, asset)])
            yield from (*some("--json", share=0.3), *some("--posed", share=0.2), *some("--clip", "fold"))
            yield from (*some("--verbose", share=0.3), *some("--fps", "3", share=0.5), *some("--tolerance", "1"))
            yield from (*some("--quiet", share=0.05), *some("--allow-external"), *some(*memory, share=0.1))
        case "suggest":
            yield from (
                asset,
                *some("--json", share=0.3),
                *some("-o", "found.yaml", *some(chance.choice(["--force", "--merge"])), share=0.5),
                "--fps",
                "4",
            )
            yield from (*some("--node", "limb"), *some("--count", "2"), *some("--clip", "fold"), *some("--all"))
            yield from some("--material", chance.choice(["limb=cloth", "limb=hard", "nowhere=skin"]))
            yield from some(
                *chance.choice([["--face"], ["--muscles"], ["--flesh"], ["--touch"], ["--presets", PRESETS]]), share=0.4
            )
            yield from some("--budget", chance.choice(["1kB", "8MB"]), share=0.1)
            yield from (*motions, *some(loudness), *some("--progress", share=0.05))
            yield from (*some("--allow-external"), *some(*memory, share=0.1))
        case "preview" if chance.random() < 0.15:
            yield from (asset, *some("--tools", "tools.yaml", share=0.5), "-o", "p.png", "--size", "32x32")
            yield from (
                "--review",
                *some("--tool", "limb", share=0.1),
                *some("--clip", "fold"),
                *some("--heat"),
                *motions,
            )
        case "preview" if chance.random() < 0.05:
            yield from (asset, "--watch", "--rest", "-o", "p.png", "--size", "32x32", *some("--tools", "tools.yaml"))
        case "preview":
            tools, tool = ["--tools", "tools.yaml"], list(some("--tool", "limb", share=0.1))
            several = [["sound.glb"], ["sound.glb", "--labels", "a,b"], [*tools, "--before"], [*tools, *tool]]
            yield from (asset, *chance.choice([[], [], tools, [*tools, "--hide-tools"], *several]))
            pictures = [
                ["-o", "p.png"],
                ["-o", "p.png", "--columns", "2"],
                ["-o", "p.gif", "--fps", "3"],
                ["-o", "p.webp"],
            ]
            moments = [["--frames", "2"], ["--frames", "2", "--clip", "fold"], ["--times", "0,0.2"]]
            moving = [*chance.choice(pictures), *chance.choice(moments)]
            still = [["-o", "p.png", *each] for each in (["--rest"], ["--grid"], posing)]
            yield from chance.choice([moving, moving, moving, moving, *still])
            yield from ("--size", "32x32", *some("--quiet"), *some("--json", share=0.1), *motions)
            yield from (*some("--heat"), *some("--wire"), *some("--clay"), *some("--backfaces"), *some("--grid"))
            yield from (*some("--views", "front,facing"), *some("--follow"))
            yield from (
                *some("--radius", "2"),
                *some("--focus", "0,1,0", "--radius", "3"),
                *some("--max-vertices", "10", share=0.1),
            )
            yield from (*some("--allow-external"), *some(*memory, share=0.1))
        case "edit":
            yield from (asset, *some("tools.yaml", share=0.9), "--no-browser", "--port", "0", *some("--heat"))
            yield from (*motions, *some("--quiet"), *some("--allow-external"), *some(*memory, share=0.1))
            yield from some("--presets", PRESETS)
            yield from some(
                "--host", chance.choice(["localhost", "0.0.0.0", "::1", "none.invalid", "127.0.0.2"]), share=0.1
            )
        case "batch":
            outs = ["out.glb", "sub/{stem}.gltf", "sub/{stem}.gltf", asset]
            manifests = [[chance.choice([*NAMES, *NAMES, *NAMES, "tools.yaml"])]] * 4
            manifests += [[asset, "--tools", "tools.yaml", "--out", chance.choice(outs)]] * 3
            if any(source is corpus()[number] for number in _CACHED):
                manifests += [[asset, "--tools", "tools.yaml", "--out", chance.choice(outs[:3]), "--cache", "kept"]] * 9
            addresses = [f"{{web}}/{asset}"] * 3 + ["{web}/*.glb"]
            manifests += [[chance.choice(addresses), "--tools", chance.choice(_WEB_TOOLS), "--out", "out.glb"]]
            chosen = chance.choice(manifests)
            yield from (*chosen, *([] if "kept" in chosen else ["--cache", "cache"]))
            dry, as_json = list(some("--dry-run")), list(some("--json", share=0.1))
            yield from (*dry, *as_json, *some("--strict"))
            yield from (*some("--fail-fast"), *some("--keep-going"), *some(loudness))
            # Options of which another is the opposite are wrong usage.
            yield from some("--profile", "mobile", share=0.2 if len(chosen) == 1 else 0.0)
            yield from some("--junit", chance.choice(["jobs.xml", asset]), share=0.0 if dry else 0.1)
            yield from ["--retry", "0"] if any("{web}" in each for each in chosen) else some("--retry", "0")
            yield from some("--report", chance.choice(["jobs.jsonl", "jobs.jsonl", asset if as_json else "-", asset]))
        case "schema":
            yield from ("-o", "found.json", *some("--read", "tools.yaml", share=0.5))
        case "maps":
            yield from (asset, "tools.yaml", "-o", "maps", "--size", chance.choice(["16", "64", "64"]))
            yield from some(
                "--unwrap", chance.choice(["out.glb", "out.glb", "sub/out.gltf", "maps/limb.glb", asset]), share=0.5
            )
            yield from (*some("--supersample", "1", share=0.5), *some("--maps", "normal,height"), *some("--separate"))
            yield from (*some("--quiet"), *some("--strict"), *some("--allow-external"), *some(*memory, share=0.1))
            yield from (*some("--tool", "limb", share=0.2), *some("--anim", "body.glb", share=0.2), *some("--json"))
        case "doctor":
            yield from some("--json", share=0.5)
        case "demo":  # folders that it refuses: it does not read the asset
            yield from (chance.choice([".", asset, f"{asset}/demo", "\0", "sub/.."]), *some("--no-open"), *some("-q"))
        case "completion":
            yield chance.choice(["bash", "zsh", "fish"])
        case _:
            if is_baked(source) and chance.random() < 0.5:
                yield from (asset, "sound.glb")
            else:
                yield from ("body.glb", asset)
            yield from (
                "-o",
                "tracked",
                *some("--fps", "4", share=0.5),
                *some(loudness),
                *some("--strict"),
                *some("--json"),
            )
            yield from (*some("--max-error", "5%"), *some("--allow-external"), *some(*memory, share=0.1))


_WEB_TOOLS = (
    "tools.yaml",
    "{web}/tools.yaml",
    "{web}/tools.yaml",
    "zip://tools.yaml::{web}/all.zip",
    "tar://tools.yaml::{web}/all.tar.gz",
)
