"""A case that is run, and what holds however it ends."""

import io
import json
import os
import re
import resource
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, redirect_stderr, redirect_stdout, suppress
from dataclasses import replace
from functools import cache
from itertools import pairwise
from pathlib import Path
from threading import Event, Thread
from typing import Any
from unittest.mock import patch

import click

from kit import web
from kit.asset import Json
from kit.cases import DEVICES, PRESETS, WEB, Case
from kit.clients import need
from kit.damage import Edit, copied, damaged, damaged_presets, edit_bytes, edit_tree, is_baked
from kit.guard import Fault, failing, only_within
from kit.hostile import MEGABYTES, SECONDS, bounded, corpus, packed
from kit.killed import act_at_line, signal_at_line
from kit.limb import limb_asset
from kit.manifests import MANIFEST, NAMES, forged, placed, written
from kit.places import SETTINGS
from kit.small_maps import small_maps
from kit.visits import visited, watched
from wrinklecli.batching import jobs, stores, worker
from wrinklecli.batching.manifest import read_manifest
from wrinklecli.cli import main
from wrinklecli.editor.side_file import SideFile
from wrinklecli.errors import WrinkleError
from wrinklecli.gltf.document import read_document

_LONGEST_LINE = 10_100  # characters of a message
_CODES = {"diff": (0, 1, 2)}
_DONE = {"diff": (0, 1), "check": (0, 3)}  # what --strict refuses, check shows all the same
# What is there before, or a link put there, and no input; all other files are inputs.
_REPLACED = ("out.glb", "displaced-out.glb", "found.json", "jobs.jsonl", "jobs.xml")
_KEPT = (
    "cache/",
    "kept/",
    "jobs.jsonl",
    "jobs.xml",
    "displaced-jobs.jsonl",
    "nothing",
)  # what a batch writes whatever comes of its jobs
_EDITED = ("tools.yaml", "displaced-tools.yaml", ".tools.yaml.unsaved")  # begin the names of what the editor writes
_WEB_BYTES = 2 * 10**7  # that a file at a URL may have
_REST = 0.2  # seconds for which a run rests beside another
_WEB_PATIENCE = 0.1  # seconds without a byte


@cache
def _sound(source: int) -> bytes:
    chosen = corpus()[source]
    return packed(copied(chosen.gltf), chosen.data, ".glb" if chosen.suffix == ".glb" else ".gltf")


@cache
def _body() -> bytes:
    return _sound(next(number for number, source in enumerate(corpus()) if is_baked(source)))


@cache
def _motions() -> dict[str, bytes]:
    """Files with a clip of 0 s, and with clips of another skeleton."""
    still, stranger = limb_asset(rings=3, sides=3), limb_asset(rings=3, sides=3, joints=3)
    animation: Json = {"name": "still"}
    still.channel(animation, 2, "rotation", [0.0], [[0.0, 0.0, 0.8, 0.6]])
    still.gltf["animations"] = [animation]
    for number, node in enumerate(stranger.gltf["nodes"][1:]):
        node["name"] = f"bone {number}"
    return {"still.glb": still.glb(), "stranger.glb": stranger.glb()}


def prepare(case: Case, folder: Path) -> None:
    """Write the case's files: the damaged asset, a copy of it that is spelled otherwise, sound ones, tools."""
    source = corpus()[case.source]
    asset, tools = damaged(source, case.edits)
    Path(folder, f"limb{source.suffix}").write_bytes(asset)
    Path(folder, "twin.glb").write_bytes(_spelled_otherwise(asset))
    Path(folder, "sound.glb").write_bytes(_sound(case.source))
    Path(folder, "body.glb").write_bytes(_body())
    for name, data in _motions().items():
        if name in case.arguments:
            Path(folder, name).write_bytes(data)
    Path(folder, "tools.yaml").write_bytes(tools)
    if PRESETS in case.arguments:
        Path(folder, PRESETS).write_bytes(damaged_presets(case.edits))
    for name in NAMES if case.arguments[0] == "batch" else ():
        Path(folder, name).write_bytes(_manifest(name, case.edits))
    Path(folder, "sub").mkdir()
    Path(folder, "out.glb").write_bytes(b"old")
    for name, data in _kept(case, folder).items():
        Path(folder, name).parent.mkdir(parents=True, exist_ok=True)
        Path(folder, name).write_bytes(data)
    _write_side(case, folder)
    for name, kind in case.places.items():
        if not name.startswith(WEB):
            _displace(folder / name, kind, asset=folder / f"limb{source.suffix}")


def _manifest(name: str, edits: Sequence[Edit]) -> bytes:
    """A manifest with faults."""
    tree = copied(MANIFEST)
    for edit in edits:
        if edit[1] == "manifest":
            edit_tree(tree, edit)
    data = bytearray(written(name, tree))
    for edit in edits:
        if edit[1] == "manifest bytes":
            edit_bytes(data, edit)
    return bytes(data)


def _kept(case: Case, folder: Path) -> dict[str, bytes]:
    """The outputs and the forged cache of an earlier batch, if a case has one."""
    return forged(placed(_kept_soundly(case), folder), case.edits) if "kept" in case.arguments else {}


def _kept_soundly(case: Case) -> dict[str, bytes]:
    """The outputs and the cache of a batch of a sound asset."""
    asset = f"limb{corpus()[case.source].suffix}"
    sound, tools = damaged(corpus()[case.source], [])
    base = tuple(case.arguments[: case.arguments.index("kept") + 1])
    return _batch(((asset, sound), ("tools.yaml", tools)), base)


@cache
def _batch(assets: tuple[tuple[str, bytes], ...], arguments: tuple[str, ...]) -> dict[str, bytes]:
    """All files that a sound batch leaves, by name: its outputs, and the cache in `kept`.

    The name of a note about an output depends on the folder, so that it has the output's name here.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for path, data in assets:
            (folder / path).parent.mkdir(exist_ok=True)
            (folder / path).write_bytes(data)
        code, _, err = run(arguments, folder)
        assert code == 0, err
        found = {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    for path, _ in assets:
        found.pop(path)
    notes = [path for path in found if path.startswith("kept/outs/")]
    return found | {f"outs:{json.loads(found[path])['out']}": found.pop(path) for path in notes}


def _write_side(case: Case, folder: Path) -> None:
    """Write the file of what an editor has not saved, with faults, if a case has some."""
    edits = [edit for edit in case.edits if edit[1].startswith("side")]
    if not edits:
        return
    tools = (folder / "tools.yaml").read_text(errors="replace")
    tree = {"wrinkle_edit": 1, "base": tools, "text": tools.replace("limb", "edited")}
    for edit in edits:
        if edit[1] == "side":
            edit_tree(tree, edit)
    data = bytearray(json.dumps(tree).encode())
    for edit in edits:
        if edit[1] == "side bytes":
            edit_bytes(data, edit)
    # Where the command looks for it: in the user's own folder, which is one of the run of tests.
    side = Path(SideFile(click.get_app_dir("wrinkle"), os.fspath(folder / "tools.yaml")).path)
    side.parent.mkdir(parents=True, exist_ok=True)
    side.write_bytes(data)


def _displace(path: Path, kind: str, *, asset: Path) -> None:
    """Put something else in the place of a file, which may be there."""
    elsewhere = path.with_name(f"displaced-{path.name}")
    path.parent.mkdir(exist_ok=True)
    if path.exists():
        path.rename(elsewhere)
    match kind:
        case "link":
            path.symlink_to(elsewhere.name)
        case "hard link" if elsewhere.is_file():
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
        case _ if kind in DEVICES:
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
    if "--plot" in case.arguments:
        need("matplotlib")
        import matplotlib.font_manager  # noqa: F401  # keeps a list of fonts beside the user's files, made on first use
    command = case.arguments[0]
    before, inputs = _found(folder), _inputs(case, folder)
    pipes = [folder / name for name, kind in case.places.items() if kind == "pipe"]
    with ExitStack() as stack:
        temporary = stack.enter_context(_temporary())
        arguments = stack.enter_context(_served(case, folder))
        refused = stack.enter_context(only_within(folder, temporary, SETTINGS))
        piped = stack.enter_context(_readers(pipes))
        stack.enter_context(small_maps())
        # As on a machine of 2 GB, whatever this one has: half of what is free would be more than a case may take.
        stack.enter_context(patch("wrinklecli.numeric.memory.available_memory", lambda: 2 * 10**9))
        stack.enter_context(bounded(seconds=SECONDS, megabytes=MEGABYTES))
        saved = _saved(case, folder)
        middle = _kill(case, folder)
        with _beside(case, folder) as beside, _small_files(case), failing(_fault(case)):
            code, out, err = _run(case, arguments, folder)
        assert not list(temporary.iterdir()), f"left temporary files: {[each.name for each in temporary.iterdir()]}"
    assert code in _CODES.get(command, (0, 1, 3)), f"exit code {code}:\n{err[-3000:]}"
    assert "Traceback" not in err, err[-3000:]
    after = _found(folder)
    if beside:  # the other run may have changed what this one did not
        assert beside[0] in _CODES.get(command, (0, 1, 3)), f"the other run ended with {beside[0]}"
        before = before if beside[0] else before | after
    _check_files(case, folder, before if middle is None else middle, after, inputs=inputs, code=code)
    if middle is not None:
        _check_killed(before, middle, after | saved, code=code)
    if not any(edit[1].startswith("manifest") for edit in case.edits):
        assert not refused, f"would have written to {refused[:3]}"
    if code not in _DONE.get(command, (0,)):
        assert err.strip(), "an error without a message"
        built = command == "batch" and re.search(r"^built ", err, re.MULTILINE)  # another job of it failed
        assert built or not any(piped), f"wrote {len(piped[0])} bytes to a pipe"
    data = "--json" in case.arguments or command == "suggest"  # has names whole
    for line in err.splitlines() + ([] if data else out.splitlines()):
        assert len(line) <= _LONGEST_LINE, f"a line of {len(line)} characters: {line[:200]}"
        assert line.isprintable(), f"a line that commands the terminal: {line[:200]!r}"
    if out and "--json" in case.arguments and middle is None:
        assert isinstance(json.loads(out), dict)
    if code == 0 and command == "bake" and not case.places:
        read_document(folder / case.arguments[-1])
        if case.arguments[-1] == "out.glb":
            asset = case.arguments[1]
            other, out, err = run(["diff", asset, "twin.glb", "--fps", "2"], folder)
            assert other == 0, f"what bake passes through, diff ends with {other} of:\n{err[-2000:] or out[-1000:]}"
    if command == "diff" and not case.places and {case.arguments[1], "twin.glb"} & set(case.arguments[2:3]):
        assert code != 1, f"a file differs from itself:\n{out[-1000:]}"
    return code


def _inputs(case: Case, folder: Path) -> set[str]:
    """Files that the command reads: nothing may change these."""
    every = {name for name in _found(folder) if Path(name).name not in _REPLACED}
    command = case.arguments[0]
    if command == "schema" and "link to ASSET" in case.places.values():
        return set()  # it reads no asset, so a file that its output leads to is no input
    if command == "edit":
        return {name for name in every if not Path(name).name.startswith(_EDITED)}
    if command != "batch":
        later = {edit[2] for edit in case.edits if edit[1] == "later"}
        later |= set(case.places) if later else set()
        return {name for name in every if Path(name).name not in later}
    every = {name for name in every if not str(Path(name).relative_to(folder)).startswith(_KEPT)}
    if "{web}" in case.arguments[1]:
        return {name for name in every if Path(name).name in case.arguments[:4]}  # tools that are no URL
    if case.arguments[1] not in NAMES:
        return {name for name in every if "sub" not in Path(name).relative_to(folder).parts[:1]}
    with _working_in(folder, []):
        try:
            every_job = read_manifest(case.arguments[1], {})
        except WrinkleError:
            return every
        paths = [path for job in every_job for path in (job.where.partition(":")[0], *job.inputs)]
        read = {os.path.realpath(path) for path in paths if "\0" not in path}
    return {name for name in every if os.path.realpath(name) in read}


def _check_files(
    case: Case, folder: Path, before: dict[str, bytes], after: dict[str, bytes], *, inputs: set[str], code: int
) -> None:
    """Inputs stay, a command that fails changes nothing, and a batch changes nothing but what it is to write."""
    command = case.arguments[0]
    lost = {name for name in inputs if after.get(name) != before.get(name)}
    assert not lost, f"changed or took away {sorted(lost)}"
    changed = {name for name in before.keys() | after.keys() if before.get(name) != after.get(name)}
    changed = {name for name in changed if "/.wrinkle-" not in name}
    # A page that saves nothing writes no file there, so it takes away nothing of an earlier one that was killed.
    if code == 0 and not (command == "edit" and any(edit[1] == "kill" for edit in case.edits)):
        strays = [name for name in after if "/.wrinkle-" in name]
        assert not strays, f"left {strays}"
    if command == "edit":
        assert all(Path(name).name.startswith(_EDITED) for name in changed), f"left or changed {sorted(changed)}"
    elif command == "batch":
        changed = {name for name in changed if not str(Path(name).relative_to(folder)).startswith(_KEPT)}
        if "kept" in case.arguments:
            _check_kept(case, folder, after, changed, code=code)
        elif code and case.arguments[1] not in NAMES:  # of several jobs, those that went well stay
            # Where the asset is a URL, the batch may write over a file of its name.
            said = dict(pairwise(case.arguments))
            changed -= {str(folder / said[key]) for key in ("--report", "--junit") if key in said} - inputs
            assert not changed, f"left or changed {sorted(changed)}"
    elif code not in _DONE.get(command, (0,)) and "--watch" not in case.arguments:
        if "--cache" in case.arguments:
            changed = {name for name in changed if not name.startswith(str(folder / "cache"))}
        assert not changed, f"left or changed {sorted(changed)}"


def _check_kept(case: Case, folder: Path, after: dict[str, bytes], changed: set[str], *, code: int) -> None:
    """Whatever a cache says, a batch makes the outputs that it would make without, and no others."""
    if case.places or any(edit[1] in ("kept tag bytes", "disk") for edit in case.edits):
        return
    asset = case.arguments[1]
    sound = {str(folder / name): data for name, data in _kept_soundly(case).items()}
    outputs = {name for name in sound if not name.startswith((str(folder / "kept"), str(folder / "outs:")))}
    assert changed <= outputs, f"left or changed {sorted(changed - outputs)}"
    fine = (0, 3) if "--strict" in case.arguments else (0,)
    if asset not in case.arguments[2:]:  # as a report
        assert code in fine, f"a cache made it end with {code}"
        if "--dry-run" not in case.arguments and not code:
            wrong = [name for name in outputs if after.get(name) != sound[name]]
            assert not wrong, f"a cache made it write other bytes to {wrong}"


def _check_killed(before: dict[str, bytes], middle: dict[str, bytes], after: dict[str, bytes], *, code: int) -> None:
    """After a kill each file is as it was or as the command makes it, and another run takes its rubbish away."""
    for name, data in middle.items():
        apart = (
            "/.wrinkle-" in name or any(f"/{each}" in name for each in _KEPT) or name.endswith((".json", ".unsaved"))
        )
        if not apart and code == 0:
            assert data in (before.get(name), after.get(name)), f"killed, it left {name} neither old nor new"
    lost = before.keys() - middle.keys()
    assert code or not lost - after.keys(), f"killed, it took away {sorted(lost)}"


def _kill(case: Case, folder: Path) -> dict[str, bytes] | None:
    """Run a command in a process that a signal ends in the middle, if a case has one; the files that are left."""
    for name, _, line in [edit for edit in case.edits if edit[1] == "kill"]:
        child = os.fork()
        if child == 0:
            try:
                nowhere = os.open(os.devnull, os.O_RDWR)
                for stream in (1, 2):
                    os.dup2(nowhere, stream)
                for sign in (signal.SIGTERM, signal.SIGINT):
                    signal.signal(sign, signal.SIG_DFL)
                signal_at_line(line, signal.Signals[name], nowhere)
                if case.arguments[0] == "edit":
                    _save(case.arguments, folder)
                else:
                    _run(replace(case, edits=[]), case.arguments, folder)  # what watches files ends by itself
            finally:
                os._exit(0)
        os.waitpid(child, 0)
        return _found(folder)
    return None


def _saved(case: Case, folder: Path) -> dict[str, bytes]:
    """The tools file as an editor would save it that is not killed."""
    if case.arguments[0] != "edit" or case.places or not any(edit[1] == "kill" for edit in case.edits):
        return {}
    with tempfile.TemporaryDirectory() as name:
        shutil.copytree(folder, name, dirs_exist_ok=True)
        _save(case.arguments, Path(name))
        return {str(folder / "tools.yaml"): Path(name, "tools.yaml").read_bytes()}


def _save(arguments: Sequence[str], folder: Path) -> object:
    """Change a tool as the editor does, and save; in vain where files are at fault."""
    from wrinklecli.editor.session import Session

    with suppress(WrinkleError):
        session = Session(folder / arguments[1], folder / "tools.yaml")
        session.set_value(session.tools()[0].name, ("bumps",), 7)
        session.save()
    return None


@contextmanager
def _beside(case: Case, folder: Path) -> Iterator[list[int]]:
    """Run a command in another process, which rests at some line until the block has begun; its exit code, then.

    The list is empty where a case has no other process.
    """
    lines, codes = [line for _, each, line in _triples(case) if each == "beside"], list[int]()
    hear, tell = os.pipe()
    child = os.fork() if lines else None
    if child == 0:
        code = 70
        try:
            nowhere = os.open(os.devnull, os.O_RDWR)
            for stream in (1, 2):
                os.dup2(nowhere, stream)

            def rest() -> None:
                os.close(tell)
                time.sleep(_REST)

            act_at_line(lines[0], rest)
            code = run(case.arguments, folder)[0]
        finally:
            os._exit(code)
    os.close(tell)
    try:
        if child is not None:
            os.read(hear, 1)  # ends when the other rests, or has ended
        yield codes
    finally:
        os.close(hear)
        if child is not None:
            codes.append(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))


@contextmanager
def _small_files(case: Case) -> Iterator[None]:
    """Let no file be larger than some bytes, if a case says so: what is written beyond fails, as on a full disk."""
    usual = resource.getrlimit(resource.RLIMIT_FSIZE)
    try:
        for size in [size for what, part, size in _triples(case) if (what, part) == ("EFBIG", "disk")]:
            resource.setrlimit(resource.RLIMIT_FSIZE, (size, usual[1]))
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, usual)


def _fault(case: Case) -> Fault | None:
    """The fault of the disk, if a case has one."""
    faults = [Fault(what, left) for what, part, left in _triples(case) if part == "disk" and what != "EFBIG"]
    return faults[0] if faults else None


def _triples(case: Case) -> list[Edit]:
    """The edits of a case that are about its run and not about its files."""
    return [edit for edit in case.edits if edit[1] in ("disk", "beside")]


@contextmanager
def _temporary() -> Iterator[Path]:
    """A folder of its own for temporary files."""
    with tempfile.TemporaryDirectory(prefix="hostile-") as name:
        usual, tempfile.tempdir = tempfile.tempdir, name
        try:
            yield Path(name)
        finally:
            tempfile.tempdir = usual


@contextmanager
def _served(case: Case, folder: Path) -> Iterator[Sequence[str]]:
    """Serve the files of a folder if a case reads URLs, some answers replaced; gives the command's arguments."""
    if not any("{web}" in each for each in case.arguments):
        yield case.arguments
        return
    contents = {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}
    tools = contents.get("tools.yaml", b"")
    contents |= {"all.zip": web.zipped(tools, name="tools.yaml"), "all.tar.gz": web.tarred(tools, name="tools.yaml")}
    listed = "".join(f'<a href="{name}">{name}</a>' for name in sorted(contents)).encode()
    answers = {f"/{name}": web.sound(each) for name, each in contents.items()}
    answers["/"] = web.sound(listed, Content_Type="text/html")
    answers |= {f"/{name[len(WEB) :]}": _answer(kind) for name, kind in case.places.items() if name.startswith(WEB)}
    patches = [
        (stores, "_PATIENCE", _WEB_PATIENCE),
        (worker, "_FIRST_PAUSE", 0.01),
        (jobs, "MAX_MEMORY", _WEB_BYTES),
        (stores, "MAX_MEMORY", 10 * _WEB_BYTES),
    ]
    usual = [getattr(module, name) for module, name, _ in patches]
    try:
        for module, name, value in patches:
            setattr(module, name, value)
        with web.served(answers) as address:
            yield [each.replace("{web}", address) for each in case.arguments]
    finally:
        for (module, name, _), value in zip(patches, usual, strict=True):
            setattr(module, name, value)


@cache
def _answer(kind: str) -> web.Answer:
    much = bytes(_WEB_BYTES * 3 // 2)
    made: dict[str, Callable[[], web.Answer]] = {
        "inflated": lambda: web.inflated(len(much)),
        "zip bomb": lambda: web.sound(web.zipped(much, name="tools.yaml")),
        "zip that says less": lambda: web.sound(web.zipped(much, name="tools.yaml", said=1000)),
        "tar bomb": lambda: web.sound(web.tarred(much, name="tools.yaml")),
        "sound": lambda: web.sound(b""),
    }
    answer: web.Answer = made[kind]() if kind in made else getattr(web, kind)
    return answer


def _run(case: Case, arguments: Sequence[str], folder: Path) -> tuple[int, str, str]:
    """Run a command; one that does not end by itself is ended when others have done what they do meanwhile."""
    if case.arguments[0] == "edit":
        edits = [edit for edit in case.edits if edit[1] == "visit"]
        return run(arguments, folder, through=lambda call, said: visited(edits, call, said))
    if "--watch" in case.arguments:
        edits = [edit for edit in case.edits if edit[1] == "later"]
        code, out, err = run(arguments, folder, through=lambda call, _: watched(edits, folder, call))
        return 0 if code == 130 else code, out, err
    return run(arguments, folder)


def _found(folder: Path) -> dict[str, bytes]:
    """Every file below a folder."""
    return {str(path): path.read_bytes() for path in folder.rglob("*") if path.is_file() and not path.is_fifo()}


def run(
    arguments: Sequence[str],
    folder: Path,
    *,
    through: Callable[[Callable[[], None], Callable[[], bytes]], None] = lambda call, _said: call(),
) -> tuple[int, str, str]:
    """Run `wrinkle` in this process and a folder: its exit code, standard output and standard error.

    `through` is given a function that does it, to be called once, and one that tells the output so far.
    """
    buffers = [io.BytesIO(), io.BytesIO()]
    streams = [io.TextIOWrapper(each, "utf-8", errors="backslashreplace") for each in buffers]
    code: Any = 0
    with _working_in(folder, ["wrinkle", *arguments]), redirect_stdout(streams[0]), redirect_stderr(streams[1]):
        try:
            through(main, buffers[0].getvalue)
        except SystemExit as ended:
            code = ended.code or 0
    texts = []
    for stream, buffer in zip(streams, buffers, strict=True):
        stream.flush()
        texts.append(buffer.getvalue().decode("utf-8", "backslashreplace"))
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
