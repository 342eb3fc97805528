"""Commands run on damaged files, always the same for the same number, and what holds however they end."""

import io
import json
import os
import random
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from threading import Event, Thread
from typing import Any

from kit.damage import Edit, copied, damage, damaged, is_baked
from kit.hostile import MEGABYTES, SECONDS, Source, bounded, corpus, packed
from wrinklecli.cli import main
from wrinklecli.gltf.document import read_document

_LONGEST_LINE = 10_100  # characters of a message
_CODES = {"diff": (0, 1, 2)}
_DONE = {"diff": (0, 1), "check": (0, 3)}  # what --strict refuses, check shows all the same
_LINKS = ("link", "hard link", "link to itself", "link to nothing", "link to ASSET", "hard link to ASSET")
_DEVICES = ("/dev/null", "/dev/full", "/dev/zero")
_PLACES = (*_LINKS, "folder", "nothing", "pipe", *_DEVICES)
# What is there before, or a link put there, and no input; all other files are inputs.
_REPLACED = ("out.glb", "displaced-out.glb", "found.json", "jobs.jsonl")
_KEPT = ("cache/", "jobs.jsonl", "displaced-jobs.jsonl")  # what a batch writes whatever comes of its jobs
_DISPLACED = 0.05  # of all cases
_LARGE = range(17, 22)  # sources of the corpus that take longer
# fmt: off
_COMMANDS = {
    "bake": 30, "inspect": 15, "diff": 20, "check": 10, "suggest": 8, "track": 10, "preview": 7, "schema": 1,
    "batch": 8,
}
# fmt: on

_MANIFEST = """\
version: 1
defaults: {tools: tools.yaml, split: true, max_memory: 4GB}
jobs:
  - {asset: "limb.*", out: "sub/{stem}.gltf", report: sub/report.json, timings: sub/timings.json, anim: sound.glb}
  - {asset: sound.glb, out: sub/out.glb, anims: ["limb.*", body.glb], tracked: sub/tracked, max_error: 5%, strict: true}
"""


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
    edits = damage(chance, sources[source])
    arguments = list(_arguments(chance, command, sources[source]))
    files = [each for each in arguments if Path(each).suffix[1:].isalpha()]
    places = {chance.choice(files): chance.choice(_PLACES)} if chance.random() < _DISPLACED else {}
    return Case(f"{number} ({' '.join(arguments)})", source, edits, arguments, places)


def _arguments(chance: random.Random, command: str, source: Source) -> Iterator[str]:
    def some(*options: str, share: float = 0.15) -> Iterator[str]:
        if chance.random() < share:
            yield from options

    asset = f"limb{source.suffix}"
    memory = "--max-memory", chance.choice(["50MB", "200MB", "4GB"])
    loudness = chance.choice(["--verbose", "--quiet"])
    report = chance.choice(["report.json"] * 5 + ["out.glb", "tools.yaml", asset])
    # What moves an asset besides its own clips: the damaged one moves itself or others, and sound ones move it.
    anims = list(some("--anim", chance.choice([asset, "sound.glb", "body.glb", "nowhere.glb"])))
    motions = [*anims, *some("--range-of-motion", share=0.05)]
    pose = "--pose", chance.choice(["joint_1=z:60", "joint_0=x:-170", "none=y:5"])
    morph = "--morph", chance.choice(["morph_0=1", "morph_1=-2.5", "none=0.5"])
    posing = chance.choice([pose, morph, (*pose, *morph)])
    yield command
    match command:
        case "bake":
            yield from (asset, "tools.yaml", *some("--replace", share=0.6), *some("--report", report), *anims)
            yield from some("--mode", "frames")
            yield from some("--accessors", chance.choice(["dense", "based"]))
            yield from some("--tracks", "none")
            yield from some("--morph-tangents")
            yield from (*some("--draft"), *some("--split"), *some("--edges-per-interval", "1", share=0.1))
            yield from some("--engine", chance.choice(["three", "unity", "spec8", "vtk", "godot3"]))
            yield from some("--frames-dir", "frames", "--frames-format", chance.choice(["obj", "ply", "glb"]))
            yield from some("--timings", "timings.json", share=0.05)
            yield from some("--depfile", "out.d")
            yield from some("--max-levels", "0")
            yield from some("--max-vertices", chance.choice(["10", "1000"]), share=0.1)
            yield from some("--max-error", chance.choice(["0.01%", "1"]), share=0.1)
            yield from some("--tool", "limb", share=0.05)
            yield from some("--fps", "2")
            yield from some("--clip", "fold")
            yield from some("--strict", share=0.05)
            yield from some(loudness)
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
        case "inspect":
            yield from (asset, *some("--json", share=0.5), *some("--allow-external"), *some(*memory, share=0.1))
        case "diff":
            yield from chance.choice([(asset, "sound.glb"), ("sound.glb", asset), (asset, "twin.glb"), (asset, asset)])
            yield from (*some("--json", share=0.3), *some("--posed", share=0.2), *some("--clip", "fold"))
            yield from (*some("--verbose", share=0.3), *some("--fps", "3", share=0.5), *some("--tolerance", "1"))
            yield from (*some("--quiet", share=0.05), *some("--allow-external"), *some(*memory, share=0.1))
        case "suggest":
            yield from (asset, *some("--json", share=0.3), *some("-o", "found.yaml", share=0.5), "--fps", "4")
            yield from (*some("--node", "limb"), *some("--count", "2"), *some("--clip", "fold"), *some("--all"))
            yield from (*motions, *some("--quiet"), *some("--allow-external"), *some(*memory, share=0.1))
        case "preview" if chance.random() < 0.15:
            yield from (asset, *some("--tools", "tools.yaml", share=0.5), "-o", "p.png", "--size", "32x32")
            yield from (
                "--review",
                *some("--tool", "limb", share=0.1),
                *some("--clip", "fold"),
                *some("--heat"),
                *motions,
            )
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
            yield from ("--size", "32x32", *some("--quiet"), *motions)
            yield from (*some("--heat"), *some("--wire"), *some("--clay"), *some("--backfaces"), *some("--grid"))
            yield from (*some("--views", "front,facing"), *some("--follow"))
            yield from (
                *some("--radius", "2"),
                *some("--focus", "0,1,0", "--radius", "3"),
                *some("--max-vertices", "10", share=0.1),
            )
            yield from (*some("--allow-external"), *some(*memory, share=0.1))
        case "batch":
            manifests = [[chance.choice(["jobs.yaml", "jobs.yaml", "tools.yaml"])]]
            outs = ["out.glb", "sub/{stem}.gltf", "sub/{stem}.gltf", asset]
            manifests += [[asset, "--tools", "tools.yaml", "--out", chance.choice(outs)]] * 3
            yield from (*chance.choice(manifests), "--cache", "cache", *some("--dry-run"), *some("--strict"))
            yield from (*some("--fail-fast"), *some("--keep-going"), *some(loudness), *some("--retry", "0"))
            yield from some("--report", chance.choice(["jobs.jsonl", "jobs.jsonl", "-", asset]))
        case "schema":
            yield from ("-o", "found.json")
        case _:
            if is_baked(source) and chance.random() < 0.5:
                yield from (asset, "sound.glb")
            else:
                yield from ("body.glb", asset)
            yield from ("-o", "tracked", *some("--fps", "4", share=0.5), *some(loudness), *some("--strict"))
            yield from (*some("--max-error", "5%"), *some("--allow-external"), *some(*memory, share=0.1))


@cache
def _sound(source: int) -> bytes:
    chosen = corpus()[source]
    return packed(copied(chosen.gltf), chosen.data, ".glb" if chosen.suffix == ".glb" else ".gltf")


@cache
def _body() -> bytes:
    return _sound(next(number for number, source in enumerate(corpus()) if is_baked(source)))


def prepare(case: Case, folder: Path) -> None:
    """Write the case's files: the damaged asset, a copy of it that is spelled otherwise, sound ones, tools."""
    source = corpus()[case.source]
    asset, tools = damaged(source, case.edits)
    Path(folder, f"limb{source.suffix}").write_bytes(asset)
    Path(folder, "twin.glb").write_bytes(_spelled_otherwise(asset))
    Path(folder, "sound.glb").write_bytes(_sound(case.source))
    Path(folder, "body.glb").write_bytes(_body())
    Path(folder, "tools.yaml").write_bytes(tools)
    Path(folder, "jobs.yaml").write_text(_MANIFEST)
    Path(folder, "sub").mkdir()
    Path(folder, "out.glb").write_bytes(b"old")
    for name, kind in case.places.items():
        _displace(folder / name, kind, asset=folder / f"limb{source.suffix}")


def _displace(path: Path, kind: str, *, asset: Path) -> None:
    """Put something else in the place of a file, which may be there."""
    elsewhere = path.with_name(f"displaced-{path.name}")
    if path.exists():
        path.rename(elsewhere)
    match kind:
        case "link":
            path.symlink_to(elsewhere.name)
        case "hard link" if elsewhere.exists():
            path.hardlink_to(elsewhere)
        case "link to ASSET":
            path.symlink_to(asset)
        case "hard link to ASSET" if asset.exists():
            path.hardlink_to(asset)
        case "link to itself":
            path.symlink_to(path.name)
        case "link to nothing":
            path.symlink_to("nothing")
        case "folder":
            path.mkdir()
        case "pipe":
            os.mkfifo(path)
        case _ if kind in _DEVICES:
            path.symlink_to(kind)


@contextmanager
def _readers(pipes: Iterable[Path]) -> Iterator[list[bytearray]]:
    """Read whatever is written to pipes, which would be waited for otherwise: their contents, when the block ends."""
    contents: list[bytearray] = []
    waiting: list[tuple[int, Thread]] = []
    for path in pipes:
        # Open to write too, so that there is no end before the last byte, which is ours.
        end, content = os.open(path, os.O_RDWR), bytearray()

        def read(end: int = end, content: bytearray = content) -> None:
            while not (content.endswith(b"\0") and ended.is_set()):
                content += os.read(end, 2**16)

        contents.append(content)
        waiting.append((end, Thread(target=read, daemon=True)))
    ended = Event()
    for _, thread in waiting:
        thread.start()
    try:
        yield contents
    finally:
        ended.set()
        for (end, thread), content in zip(waiting, contents, strict=True):
            os.write(end, b"\0")
            thread.join()
            os.close(end)
            del content[-1:]


def _spelled_otherwise(asset: bytes) -> bytes:
    """The same asset by another generator, where it is a whole .gltf or .glb and names none."""
    named = (b'"asset": {', b'"asset": {"generator": "twin", ')
    if asset[:4] != b"glTF":
        return asset.replace(*named, 1)
    size = int.from_bytes(asset[12:16], "little")
    if asset[16:20] != b"JSON" or 20 + size > len(asset) or asset[8:12] != len(asset).to_bytes(4, "little"):
        return asset
    text = asset[20 : 20 + size].replace(*named, 1)
    text += b" " * (-len(text) % 4)
    lengths = [(each + len(text) - size).to_bytes(4, "little") for each in (len(asset), size)]
    return asset[:8] + lengths[0] + lengths[1] + b"JSON" + text + asset[20 + size :]


def attack(case: Case, folder: Path) -> int:
    """Run a case in an empty folder; the exit code.

    Raises:
        AssertionError: It ended in a traceback, left what it should not, took too long or too much, or said it badly.
    """
    prepare(case, folder)
    before = _found(folder)
    pipes = [folder / name for name, kind in case.places.items() if kind == "pipe"]
    with _readers(pipes) as piped, bounded(seconds=SECONDS, megabytes=MEGABYTES):
        code, out, err = run(case.arguments, folder)
    command = case.arguments[0]
    assert code in _CODES.get(command, (0, 1, 3)), f"exit code {code}:\n{err[-3000:]}"
    after = _found(folder)
    lost = {name for name in before if Path(name).name not in _REPLACED and after.get(name) != before[name]}
    if command == "schema" and "link to ASSET" in case.places.values():
        lost = set()  # it reads no asset, so a file that its output leads to is no input
    assert not lost, f"changed or took away {sorted(lost)}"
    if code not in _DONE.get(command, (0,)):
        assert err.strip(), "an error without a message"
        if command == "batch":  # jobs that went well stay
            after = {name: data for name, data in after.items() if not _is_kept(case, name, folder)}
        assert after == before, f"left or changed {sorted(set(after.items()) ^ set(before.items()))}"
        assert not any(piped), f"wrote {len(piped[0])} bytes to a pipe"
    data = "--json" in case.arguments or command == "suggest"  # has names whole
    for line in err.splitlines() + ([] if data else out.splitlines()):
        assert len(line) <= _LONGEST_LINE, f"a line of {len(line)} characters: {line[:200]}"
        assert line.isprintable(), f"a line that commands the terminal: {line[:200]!r}"
    if code == 0 and command == "bake" and not case.places:
        read_document(folder / case.arguments[-1])
        if case.arguments[-1] == "out.glb":
            asset = case.arguments[1]
            other, out, err = run(["diff", asset, "twin.glb", "--fps", "2"], folder)
            assert other == 0, f"what bake passes through, diff ends with {other} of:\n{err[-2000:] or out[-1000:]}"
    if command == "diff" and not case.places and {case.arguments[1], "twin.glb"} & set(case.arguments[2:3]):
        assert code != 1, f"a file differs from itself:\n{out[-1000:]}"
    return code


def _is_kept(case: Case, path: str, folder: Path) -> bool:
    """Whether a batch may leave a file though a job failed."""
    name = str(Path(path).relative_to(folder))
    return name.startswith((*_KEPT, *(["sub/"] if case.arguments[1] == "jobs.yaml" else [])))


def _found(folder: Path) -> dict[str, bytes]:
    """Every file below a folder."""
    return {str(path): path.read_bytes() for path in folder.rglob("*") if path.is_file() and not path.is_fifo()}


def run(arguments: Sequence[str], folder: Path) -> tuple[int, str, str]:
    """Run `wrinkle` in this process and a folder: its exit code, standard output and standard error."""
    streams = [io.TextIOWrapper(io.BytesIO(), "utf-8", errors="backslashreplace") for _ in range(2)]
    code: Any = 0
    with _working_in(folder, ["wrinkle", *arguments]), redirect_stdout(streams[0]), redirect_stderr(streams[1]):
        try:
            main()
        except SystemExit as ended:
            code = ended.code or 0
    texts = []
    for stream in streams:
        stream.flush()
        texts.append(stream.buffer.getvalue().decode("utf-8", "backslashreplace"))  # type: ignore[attr-defined]
    return code, texts[0], texts[1]


@contextmanager
def _working_in(folder: Path, arguments: Sequence[str]) -> Iterator[None]:
    """Change the folder and the command line of this process."""
    home, earlier = os.getcwd(), sys.argv
    os.chdir(folder)
    sys.argv = list(arguments)
    try:
        yield
    finally:
        sys.argv = earlier
        os.chdir(home)
