"""Other people's glTF software for the tests: the Khronos validator, three.js, glTF-Transform and gltfpack, in node.

They come by `npm ci` from the lock file beside this one, on first use. Without node a test that needs them is
skipped with the reason; where `CI` is set it fails instead.
"""

import atexit
import importlib.util
import json
import os
import shutil
import subprocess
import sys
import tempfile
import threading
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from fcntl import LOCK_EX, flock
from functools import cache
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import pytest
from numpy.typing import NDArray

from kit.places import IN_CI, SHARED
from kit.work import PATIENCE

Floats = NDArray[np.float64]

HERE = Path(__file__).resolve().parents[1] / "clients"


@dataclass(frozen=True, slots=True)
class Report:
    """What the Khronos validator says of a file.

    Attributes:
        path: The file.
        errors: Number of errors.
        warnings: Number of warnings.
        messages: Every issue, infos and hints too: `code`, `message`, `severity` (0 error to 3 hint) and
            mostly `pointer`.
    """

    path: Path
    errors: int
    warnings: int
    messages: tuple[dict[str, Any], ...]

    def lines(self, *, severity: int = 1) -> list[str]:
        """The issues down to a severity, as text for an assertion's message."""
        return [
            f"{self.path.name}#{message.get('pointer', '')}: {message['code']}: {message['message']}"
            for message in self.messages
            if message["severity"] <= severity
        ]


def give_up(reason: str) -> NoReturn:
    if IN_CI:
        pytest.fail(reason, pytrace=False)
    pytest.skip(reason)


def need(module: str) -> None:
    """Skips the test without a package of the extra `test-more`; fails it where `CI` is set."""
    if importlib.util.find_spec(module) is None:
        give_up(f"{module} is not installed: pip install '.[test-more]'")


@cache
def install() -> tuple[str, str]:
    """Install the packages that are missing; the node to run, or the reason why there is none: one of both is empty."""
    places = os.pathsep.join((os.environ.get("PATH", ""), str(Path(sys.executable).parent)))
    node, npm = shutil.which("node", path=places), shutil.which("npm", path=places)
    if node is None or npm is None:
        return "", f"{'node' if node is None else 'npm'} is not installed: no Khronos validator, no three.js"
    pins: dict[str, str] = json.loads((HERE / "package.json").read_text())["dependencies"]
    manifests = {HERE / "node_modules" / name / "package.json": pin for name, pin in pins.items()}
    with (SHARED / "npm.lock").open("w") as lock:
        flock(lock, LOCK_EX)  # others wait for the first
        if all(path.is_file() and json.loads(path.read_text())["version"] == pin for path, pin in manifests.items()):
            return node, ""
        command = [npm, "ci", "--ignore-scripts", "--no-audit", "--no-fund"]
        installed = subprocess.run(command, cwd=HERE, capture_output=True, text=True, check=False)
    return (
        (node, "") if not installed.returncode else ("", f"npm ci failed in {HERE}: {installed.stderr[-600:].strip()}")
    )


def requireinstall() -> str:
    """The path of node, its packages installed.

    Skips the test without node, npm or a network to install from; fails it where `CI` is set.
    """
    node, reason = install()
    if not node:
        give_up(reason)
    return node


class _Server:
    """A node process that answers for as long as this one runs: to start one takes longer than most answers."""

    def __init__(self) -> None:
        self._said = tempfile.TemporaryFile("w+", encoding="utf-8")  # noqa: SIM115
        self._process = subprocess.Popen(
            [requireinstall(), str(HERE / "serve.mjs")],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._said,
            text=True,
            encoding="utf-8",
        )
        atexit.register(self.close)

    def ask(self, line: str) -> str:
        """The line that answers one; none where the process ended, or had to be ended."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        ended = threading.Event()

        def end() -> None:
            ended.set()
            self._process.kill()

        watch = threading.Timer(PATIENCE, end)
        watch.start()
        try:
            self._process.stdin.write(f"{line}\n")
            self._process.stdin.flush()
            reply = self._process.stdout.readline()
        except BrokenPipeError:
            reply = ""
        finally:
            watch.cancel()
            watch.join()
        # An answer of a process that was ended meanwhile would leave the next one to find it dead.
        return "" if ended.is_set() else reply

    def close(self) -> str:
        """End the process; what it said on standard error."""
        with suppress(BrokenPipeError, subprocess.TimeoutExpired):
            self._process.communicate(timeout=5.0)
        self._process.kill()
        self._process.wait()
        if self._said.closed:
            return ""
        with self._said:
            self._said.seek(0)
            return self._said.read().strip()


@cache
def _server() -> _Server:
    return _Server()


def ask(module: str, function: str, *arguments: Any) -> Any:
    """Call a function of a module in `tests/clients`."""
    reply = _server().ask(json.dumps([module, function, *arguments]))
    if not reply:
        said = _server().close()
        _server.cache_clear()
        raise AssertionError(f"{module}.mjs: no answer within {PATIENCE:g} s, or node has ended: {said[-2000:]}")
    answer = json.loads(reply)
    assert "error" not in answer, f"{module}.mjs: {answer['error'][-2000:]}"
    return answer["answer"]


def validate(paths: Sequence[Path]) -> list[Report]:
    """Run the Khronos validator over .glb and .gltf files, external buffers and images included."""
    answers = [ask("validate", "validate", str(path)) for path in paths]
    return [
        Report(path, answer["numErrors"], answer["numWarnings"], tuple(answer["messages"]))
        for path, answer in zip(paths, answers, strict=True)
    ]


def optimize(path: Path, out: Path) -> dict[str, Any]:
    """Run a file through glTF-Transform, as its `optimize --compress meshopt` does; what its `inspect` says of it."""
    report: dict[str, Any] = ask("optimize", "optimize", str(path), str(out))
    return report


def tidy(path: Path, out: Path) -> None:
    """Run a file through glTF-Transform, as its `optimize --simplify false --resample false --compress false` does."""
    ask("optimize", "tidy", str(path), str(out))


def gltfpack(path: Path, out: Path, *flags: str) -> None:
    """Run a file through gltfpack."""
    command = [requireinstall(), str(HERE / "node_modules/gltfpack/cli.js"), "-i", str(path), "-o", str(out), *flags]
    done = subprocess.run(command, capture_output=True, text=True, encoding="utf-8", check=False)
    assert done.returncode == 0, f"gltfpack: {done.stderr.strip()[-2000:]}"


def assert_valid(*paths: Path) -> None:
    """The Khronos validator finds no error in any of the files."""
    found = [line for report in validate(paths) for line in report.lines(severity=0)]
    assert not found, "\n".join(found)


def pose_with_normals(
    file: Path,
    *,
    node: str | int,
    clip: str | int | None,
    times: Sequence[float],
    vertices: Sequence[int] | None = None,
) -> tuple[Floats, Floats]:
    """Pose a node's mesh with three.js, positions and normals as its shaders would leave them.

    Args:
        file: .glb or .gltf with a NORMAL for each primitive.
        node: Name or index of a node with a mesh.
        clip: Name or index of an animation; None for the pose as stored.
        times: Seconds, held at both ends of the clip.
        vertices: These alone; default all, the primitives one after another in file order.

    Returns:
        (times, vertices, 3) world-space positions in scene units, and unit normals; float32's precision.
    """
    positions, normals = _posed(file, node, clip, times, vertices, ("output", "normals"))
    return positions, normals


def pose(
    file: Path,
    *,
    node: str | int,
    clip: str | int | None,
    times: Sequence[float],
    vertices: Sequence[int] | None = None,
) -> Floats:
    """Pose a node's mesh with three.js: the positions alone of `pose_with_normals`, NORMAL not needed."""
    (positions,) = _posed(file, node, clip, times, vertices, ("output",))
    return positions


def pose_each(file: Path, nodes: Sequence[str | int], *, clip: str | int, times: Sequence[float]) -> list[Floats]:
    """Like `pose`, for several nodes of a file: it is read once."""
    with tempfile.TemporaryDirectory() as folder:
        request: dict[str, Any] = {"file": str(file), "clip": clip, "times": [float(time) for time in times]}
        requests = [
            {**request, "node": node, "vertices": None, "output": str(Path(folder, f"{number}.f32"))}
            for number, node in enumerate(nodes)
        ]
        answers = ask("pose", "pose", requests)
        return [
            np.fromfile(each["output"], np.float32).reshape(len(times), answer["vertices"], 3).astype(np.float64)
            for each, answer in zip(requests, answers, strict=True)
        ]


def _posed(
    file: Path,
    node: str | int,
    clip: str | int | None,
    times: Sequence[float],
    vertices: Sequence[int] | None,
    wanted: tuple[str, ...],
) -> list[Floats]:
    with tempfile.TemporaryDirectory() as folder:
        outputs = {key: str(Path(folder, f"{key}.f32")) for key in wanted}
        request = {
            "file": str(file),
            "node": node,
            "clip": clip,
            "times": [float(time) for time in times],
            "vertices": None if vertices is None else [int(vertex) for vertex in vertices],
            **outputs,
        }
        (answer,) = ask("pose", "pose", [request])
        shape = (len(times), answer["vertices"], 3)
        return [np.fromfile(path, np.float32).reshape(shape).astype(np.float64) for path in outputs.values()]


def drive(
    file: Path,
    *,
    node: str,
    clip: str | None,
    times: Sequence[float],
    anim: Path | None = None,
    driver: bool = False,
    elapsed: Sequence[float] = (),
    loops: bool = False,
    places: Sequence[Sequence[float]] = (),
    into: tuple[str, Sequence[float]] | None = None,
) -> dict[str, Floats]:
    """Morph weights of a node's mesh while three.js plays a clip.

    Args:
        file: The body, .glb or .gltf.
        node: Name of the node with the mesh.
        clip: Name of an animation; None for the pose as stored.
        times: Seconds.
        anim: The file with the clip, where it is not the body's.
        driver: Let the page in `samples/driver` set the weights each frame.
        elapsed: Seconds since the time before, for each, for tools that lag; left out, the times' own.
        loops: Let the page bring springs to the beginning of a loop first.
        places: Where the player has put the body, for each time; left out, at the origin.
        into: Another clip, and its share of the motion at each time.

    Returns:
        By target, (times, parts of the mesh) weights.
    """
    request = {"file": str(file), "node": node, "clip": clip, "times": [float(time) for time in times], "drive": driver}
    request |= {"elapsed": list(elapsed)} if elapsed else {}
    request |= {"loops": True} if loops else {}
    request |= {"places": [list(each) for each in places]} if places else {}
    request |= {} if anim is None else {"anim": str(anim)}
    request |= {} if into is None else {"into": {"clip": into[0], "shares": list(into[1])}}
    answer = ask("drive", "drive", request)
    weights = np.array(answer["weights"], np.float64)
    return {name: weights[:, :, k] for k, name in enumerate(answer["targets"])}


def map_weights(file: Path, folder: Path, clip: str, times: Sequence[float]) -> list[dict[str, float]]:
    """For each time of a clip the weights, by target, that the page in `samples/driver` gives to a folder's maps."""
    found: list[dict[str, float]] = ask("drive", "mapped", str(file), str(folder), clip, list(times))
    return found


def driver_warnings(file: Path) -> list[str]:
    """The lines on the console that the driver of the page in `samples/driver` writes for a file."""
    said: list[str] = ask("drive", "warnings", str(file))
    return said


def clip_tracks(file: Path, clip: str) -> list[tuple[str, str, Floats, Floats]]:
    """What three.js reads of a clip: node, property as three.js calls it, (keys,) seconds and (keys, …) values."""
    found = []
    for track in ask("drive", "tracks", str(file), clip):
        times = np.array(track["times"], np.float64)
        found.append((track["node"], track["path"], times, np.array(track["values"]).reshape(len(times), -1)))
    return found


def compare_with_three(
    path: Path,
    node: str | int,
    clip: str | int | None,
    times: Sequence[float],
    expected: Floats,
    *,
    tolerance: float = 2e-6,
) -> float:
    """Assert that three.js poses a file as expected.

    Args:
        path: .glb or .gltf.
        node: Name or index of a node with a mesh.
        clip: Name or index of an animation; None for the pose as stored.
        times: Seconds.
        expected: (times, vertices, 3) world-space positions, the primitives one after another.
        tolerance: Relative to the greatest coordinate; the default is some steps of float32.

    Returns:
        The greatest difference of a coordinate, scene units.
    """
    found = pose(path, node=node, clip=clip, times=times)
    assert found.shape == expected.shape
    differences = np.abs(found - expected)
    worst = np.unravel_index(differences.argmax(), differences.shape)
    limit = tolerance * max(1e-6, float(np.abs(expected).max()))
    assert differences[worst] <= limit, (
        f"{path.name}: {differences[worst]:.3g} > {limit:.3g} at time {times[worst[0]]:g}, vertex {worst[1]}:"
        f" three.js {found[worst[:2]]}, expected {expected[worst[:2]]}"
    )
    return float(differences[worst])


def target_bytes(file: Path) -> int:
    """What three.js allocates on a GPU for a file's morph targets."""
    return int(ask("memory", "targetBytes", str(file)))
