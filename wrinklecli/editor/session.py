"""What `wrinkle edit` edits: an asset, its tools file as text, and every step between that can be undone.

A step is an immutable record of the file's text, so undoing gives the same bytes. What is shown follows from a step
alone. Methods may be called from several threads.
"""

import os
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from wrinklecli.baking.job import drafted
from wrinklecli.character.clip import Clip, clip_named
from wrinklecli.character.moved import Motions, moved
from wrinklecli.character.scene import deforming_nodes
from wrinklecli.editor.shown import Laid, LaidMesh, LaidTool, Stage
from wrinklecli.errors import ConfigError, nearest
from wrinklecli.gltf.document import Document, read_document
from wrinklecli.method.activity import activity
from wrinklecli.numeric.arrays import Floats, Ints
from wrinklecli.numeric.blocks import Blocks
from wrinklecli.numeric.guard import guarded
from wrinklecli.numeric.memory import MAX_MEMORY, Memory
from wrinklecli.tools.mirror import exchange_sides
from wrinklecli.tools.read import load_text, parse_tools
from wrinklecli.tools.records import ToolsFile, identifier, in_axes
from wrinklecli.tools.schema import TOOL_KEYS
from wrinklecli.tools.yaml_edit import Steps, ToolsText

_NEW = "version: 1\ntools: []\n"
# A tool that no file has, for a file without tools, which the reader refuses.
_NO_TOOL = {"name": "none", "origin": [0, 0, 0], "target": [1, 0, 0], "width": 1, "enabled": False}
# Steps that can be undone.
_MOST_STEPS = 1000
# Points of a drawn control curve, and times of a drawn height.
_CURVE_POINTS, _MOST_TIMES = 200, 300


@dataclass(frozen=True, slots=True)
class Step:
    """A state of the edited file.

    Attributes:
        file: Its text.
        solo: Names of the tools that are shown alone; all where there are none.
        done: What made it, for a tip at undo.
    """

    file: ToolsText
    solo: frozenset[str] = frozenset()
    done: str = ""


@dataclass(frozen=True, slots=True)
class EditedTool:
    """A tool of the file.

    Attributes:
        name: Of it.
        values: What holds for it, by key: its own, else the file's defaults, else the schema's.
        own: Keys that the tool itself has.
        enabled: Whether it is baked.
        solo: Whether it is among those that are shown alone.
        partner: Name of the tool that its `mirror` makes; None for none.
        problem: Why it does not fit the asset; None where it does.
    """

    name: str
    values: Mapping[str, Any]
    own: frozenset[str]
    enabled: bool
    solo: bool
    partner: str | None
    problem: str | None


@dataclass(frozen=True, slots=True)
class ShownMesh:
    """A node's mesh at a moment.

    Attributes:
        node: Name of the node.
        laid: What of it does not change with time; another object whenever faces do.
        positions: (vertices, 3) world space, scene units.
    """

    node: str
    laid: LaidMesh
    positions: Floats

    @property
    def faces(self) -> Ints:
        """(triangles, 3) vertices; the same array as long as `laid` is the same object."""
        return self.laid.faces

    def normals(self) -> Floats:
        """(vertices, 3) unit, area-weighted."""
        return self.laid.normals(self.positions)


class Session:
    """An asset and its tools, being edited. Made by `Session.open`.

    Every edit takes `draft=True` while something is dragged: it replaces the last draft, is shown coarsely, and is no
    step of its own; the first edit without it is. `drop_draft` gives a draft up.

    Raises (all edits):
        ConfigError: The file would not be valid; nothing has changed then.
    """

    def __init__(self, stage: Stage, path: str, file: ToolsText) -> None:
        self.path = path
        self.lock = threading.RLock()
        self._stage = stage
        self._saved = file.text
        self._steps: list[Step] = [Step(file)]
        self._at = 0
        self._draft: Step | None = None
        self._laid: tuple[Step, bool, Laid] | None = None

    @classmethod
    def open(
        cls,
        asset: str | os.PathLike[str],
        tools: str | os.PathLike[str] | None = None,
        *,
        anims: Sequence[str | os.PathLike[str]] = (),
        range_of_motion: bool = False,
        allow_external: bool = False,
        max_memory: int = MAX_MEMORY,
    ) -> "Session":
        """Read an asset and its tools.

        Args:
            asset: The .gltf or .glb.
            tools: The YAML file; it need not be there yet. Beside the asset, with its name, where left out.
            anims: Files with more clips.
            range_of_motion: Move it through that too, though it has clips.
            allow_external: Read buffers and images outside the asset's folder too.
            max_memory: Bytes that reading the asset may take.

        Raises:
            WrinkleError: One of the files is at fault.
        """
        path = os.fspath(asset)
        with guarded(path):
            document = read_document(asset, allow_external=allow_external, memory=Memory(max_memory))
            motions = Motions(anims, range_of_motion or None)
            joined = moved(document, deforming_nodes(document), motions)
            stage = Stage(joined.document, joined.clips, frozenset(joined.range))
        name = os.fspath(tools) if tools is not None else os.path.splitext(path)[0] + ".yaml"
        file = ToolsText(load_text(name) if os.path.exists(name) else _NEW, name)
        session = cls(stage, name, file)
        session.settings()
        return session

    # What there is.

    @property
    def clips(self) -> tuple[Clip, ...]:
        """All clips: of the asset, of other files, of the range of motion; each has name, start and end."""
        return self._stage.clips

    @property
    def made(self) -> frozenset[str]:
        """Names of the clips that are a range of motion, which no file has."""
        return self._stage.made

    @property
    def document(self) -> Document:
        """The asset, with all clips."""
        return self._stage.document

    @property
    def step(self) -> Step:
        """The present state, a draft too."""
        return self._draft or self._steps[self._at]

    @property
    def text(self) -> str:
        """Of the tools file as it would be saved."""
        return self._steps[self._at].file.text

    @property
    def changed(self) -> bool:
        """Whether there is something to save."""
        return self.text != self._saved

    def settings(self) -> ToolsFile:
        """The tools file as a bake reads it, with its enabled tools."""
        return _settings(self.step.file)

    def tools(self) -> tuple[EditedTool, ...]:
        """The tools of the file, in its order, disabled ones too; a mirrored one is its source's partner."""
        with self._guarded():
            step, problems = self.step, self._laid_now().problems
            defaults = step.file.beside.get("defaults") or {}
            found = []
            for own in step.file.tools:
                values = {key: each["default"] for key, each in TOOL_KEYS.items() if "default" in each}
                values |= defaults | dict(own)
                name, axis = str(own.get("name", "")), values.get("mirror")
                partner = exchange_sides(name) if axis not in (None, "none") else None
                problem = problems.get(name) or (problems.get(partner) if partner else None)
                found.append(
                    EditedTool(
                        name, values, frozenset(own), bool(values.get("enabled")), name in step.solo, partner, problem
                    )
                )
            return tuple(found)

    # Edits.

    def set_value(self, tool: str, steps: Steps, value: Any, *, draft: bool = False) -> None:
        """Set a key of a tool, or what is within it: `("bumps",)`, `("clips", "walk")`, `("lag", "damping")`.

        Args:
            tool: Its name.
            steps: To the value.
            value: As the schema has it; lengths as numbers or text such as `80%`.
            draft: See the class.
        """
        with self._guarded():
            file = self._base.file
            self._become(file.with_value(self._number(tool), steps, value), f"{tool}: {steps[0]}", draft=draft)

    def unset(self, tool: str, steps: Steps) -> None:
        """Take a key away from a tool: what the file's defaults or the schema say holds."""
        with self._guarded():
            self._become(self._base.file.without(self._number(tool), steps), f"{tool}: {steps[0]}")

    def add_tool(self, origin: Sequence[float], target: Sequence[float], node: str | None = None) -> str:
        """Add a tool between two places of a mesh at rest, world space.

        Args:
            origin: (3,) as `at_rest` gives it.
            target: (3,)
            node: Name of the node whose mesh was touched.

        Returns:
            Its name.
        """
        with self._guarded():
            axis = (self._base.file.beside.get("defaults") or {}).get("mirror")
            middle = np.add(origin, target) / 2.0
            sides = dict(zip("xyz", in_axes(middle.tolist(), self._base.file.beside.get("up", "y")), strict=True))
            name = self._new_name("wrinkle" + ("" if axis not in sides else ".L" if sides[axis] > 0 else ".R"))
            span = float(np.linalg.norm(np.subtract(target, origin)))
            values: dict[str, Any] = {"name": name}
            if node is not None and len(deforming_nodes(self._stage.document)) > 1:
                values["node"] = node
            values |= {
                "origin": self._written_place(origin, span),
                "target": self._written_place(target, span),
                "width": _rounded(span, 2),
            }
            self._become(self._base.file.with_tool(values), f"{name} is new")
            return name

    def move_point(self, tool: str, number: int, place: Sequence[float], *, draft: bool = False) -> None:
        """Move one of a tool's points to a place at rest, world space: 0 is the origin, the last is the target."""
        with self._guarded():
            own = self._base.file.tools[self._number(tool)]
            points = own["path"] if "path" in own else [own["origin"], own["target"]]
            places = [each for each in points if isinstance(each, list)]
            span = float(np.linalg.norm(np.diff(np.array(places, float), axis=0), axis=1).sum()) or 1.0
            steps = ("path", number) if "path" in own else (("origin", "target")[number],)
            value = self._written_place(place, span)
            file = self._base.file.with_value(self._number(tool), steps, value)
            self._become(file, f"{tool}: {steps[0]}", draft=draft)

    def copy(self, tool: str) -> str:
        """Copy a tool; the copy's name."""
        with self._guarded():
            name = self._new_name(tool)
            self._become(self._base.file.with_copy(self._number(tool), name), f"{name} is a copy")
            return name

    def rename(self, tool: str, name: str) -> None:
        """Give a tool another name."""
        with self._guarded():
            self._become(self._base.file.with_value(self._number(tool), ("name",), name), f"{tool} is {name}")

    def delete(self, tool: str) -> None:
        """Take a tool away."""
        with self._guarded():
            self._become(self._base.file.without_tool(self._number(tool)), f"{tool} is gone")

    def enable(self, tool: str, *, enabled: bool) -> None:
        """Switch a tool on or off in the file."""
        self.set_value(tool, ("enabled",), enabled)

    def mirror(self, tool: str, axis: str | None) -> None:
        """Give a tool a partner on the other side of x = 0, or y or z, or none."""
        with self._guarded():
            if axis is None:
                self._become(self._base.file.without(self._number(tool), ("mirror",)), f"{tool}: mirror")
            else:
                self.set_value(tool, ("mirror",), axis)

    def solo(self, tools: Sequence[str]) -> None:
        """Show some tools alone; all again where there are none. The file stays as it is."""
        with self._guarded():
            self._push(replace(self._base, solo=frozenset(tools), done="solo"))

    def drop_draft(self) -> None:
        """Give a draft up."""
        with self.lock:
            self._draft = None

    def undo(self) -> bool:
        """Go a step back; whether there was one."""
        with self.lock:
            self._draft = None
            able = self._at > 0
            self._at -= able
            return able

    def redo(self) -> bool:
        """Go a step forward again; whether there was one."""
        with self.lock:
            self._draft = None
            able = self._at + 1 < len(self._steps)
            self._at += able
            return able

    def save(self) -> None:
        """Write the file.

        Raises:
            WrinkleError: It cannot be written.
        """
        with self.lock:
            from wrinklecli.files.outputs import Outputs

            with Outputs() as outputs:
                outputs.add_bytes(self.path, self.text.encode())
            self._saved = self.text

    # What is shown.

    def laid(self) -> Mapping[str, LaidTool]:
        """The tools that fit, mirrored ones too, by name."""
        with self._guarded():
            return self._laid_now().tools

    def meshes(self, clip: str | None, time: float) -> list[ShownMesh]:
        """All meshes at a time of a clip, seconds, with wrinkles; the stored pose where the clip is None."""
        with self._guarded():
            found = self._clip(clip)
            return [ShownMesh(each.node, each, each.posed(found, time)) for each in self._laid_now().meshes]

    def at_rest(self, mesh: ShownMesh, place: Sequence[float]) -> tuple[Floats, Floats]:
        """The point of a shown mesh that is nearest to a place.

        Returns:
            (3,) where it is at rest, without wrinkles, for `add_tool` and `move_point`; (3,) where it is shown.
        """
        with self._guarded():
            triangle, shares, shown = Blocks.of(mesh.positions, mesh.faces).closest_point(np.array(place, float))
            return shares @ mesh.laid.rest_positions[mesh.faces[triangle]], shown

    def anchors(self, tool: str) -> Floats | None:
        """(points, 3) a tool's anchors at rest, from origin to target, world space; None where it does not fit."""
        with self._guarded():
            found = self._laid_now().tools.get(tool)
            return None if found is None else np.stack([each.position for each in found.carried.patch.anchors])

    def curve(self, tool: str, clip: str | None, time: float) -> Floats | None:
        """(points, 2) a tool's control curve at a moment: along it and its height, scene units; None where it fails."""
        with self._guarded():
            found = self._laid_now().tools.get(tool)
            if found is None:
                return None
            patch, at = found.carried.patch, self._clip(clip)
            seen = activity(patch, found.plan.rig, found.plan.rest, at, np.array([time]))
            us = np.linspace(0.0, 1.0, _CURVE_POINTS)
            strength = patch.clip_strength(at) * patch.shape_strength
            heights = strength * np.einsum("gm,gmv->v", seen.amplitudes[0], patch.curve.shapes(us))
            distance = float(seen.distances[0]) if np.isfinite(seen.distances[0]) else 0.0
            return np.stack([us * distance, heights], axis=1)

    def heights(self, tool: str, clip: str) -> tuple[Floats, Floats] | None:
        """(times,) seconds of a clip and (times,) the height of a tool's highest bump then; None where it fails."""
        with self._guarded():
            found, at = self._laid_now().tools.get(tool), self._clip(clip)
            if found is None or at is None:
                return None
            count = int(np.clip((at.end - at.start) * 60.0, 2, _MOST_TIMES))
            times = np.linspace(at.start, at.end, count)
            patch = found.carried.patch
            seen = activity(patch, found.plan.rig, found.plan.rest, at, times)
            strength = abs(patch.clip_strength(at) * patch.shape_strength)
            return times, strength * patch.curve.heights(seen.amplitudes).reshape(count, -1).max(axis=1)

    # Within.

    @property
    def _base(self) -> Step:
        """What an edit changes: the last step, never a draft."""
        return self._steps[self._at]

    @contextmanager
    def _guarded(self) -> Iterator[None]:
        with self.lock, guarded(self._stage.document.path):
            yield

    def _become(self, file: ToolsText, done: str, *, draft: bool = False) -> None:
        """Take a text for the present state, if it is valid."""
        _settings(file)
        step = Step(file, self._base.solo, done)
        if draft:
            self._draft = step
        else:
            self._push(step)

    def _push(self, step: Step) -> None:
        self._draft = None
        if (step.file.text, step.solo) == (self._base.file.text, self._base.solo):
            return
        self._steps = [*self._steps[: self._at + 1], step][-_MOST_STEPS:]
        self._at = len(self._steps) - 1

    def _laid_now(self) -> Laid:
        step, coarse = self.step, self._draft is not None
        if self._laid is None or self._laid[0] is not step or self._laid[1] != coarse:
            settings = _settings(step.file)
            if step.solo:
                chosen = step.solo | {exchange_sides(name) for name in step.solo}
                settings = replace(settings, tools=tuple(each for each in settings.tools if each.name in chosen))
            if coarse:
                settings = replace(settings, refinement=drafted(settings.refinement))
            self._laid = (step, coarse, self._stage.laid(settings))
        return self._laid[2]

    def _clip(self, name: str | None) -> Clip | None:
        return None if name is None else clip_named(self.clips, name, where=self._stage.document.path)

    def _number(self, tool: str) -> int:
        names = [str(each.get("name")) for each in self._base.file.tools]
        if tool not in names:
            raise ConfigError(f"no tool is named {tool!r}{nearest(tool, names)}", where=self.path)
        return names.index(tool)

    def _new_name(self, stem: str) -> str:
        """A name of a stem that no tool has, with the side at its end where the stem has one."""
        taken = {identifier(tool.name) for tool in _settings(self._base.file).tools}
        taken |= {identifier(str(each.get("name"))) for each in self._base.file.tools}
        body, dot, side = stem.rpartition(".") if stem[-2:] in (".L", ".R") else (stem, "", "")
        number = 1
        while identifier(name := f"{body}_{number}{dot}{side}") in taken:
            number += 1
        return name

    def _written_place(self, place: Sequence[float], span: float) -> list[float]:
        """A Y-up place in the file's axes, with as many digits as matter: a thousandth of the segment, or less."""
        up = self._base.file.beside.get("up", "y")
        digits = max(3 - int(np.floor(np.log10(span))), 0) if span > 0 else 6
        return [round(float(each), digits) + 0.0 for each in in_axes([float(x) for x in place], up)]


def _settings(file: ToolsText) -> ToolsFile:
    """A tools file as a bake reads it; it may be without tools."""
    return parse_tools((file if file.tools else file.with_tool(_NO_TOOL)).text, name=file.name)


def _rounded(value: float, digits: int) -> float:
    """A number of so many significant digits."""
    return float(f"{value:.{digits}g}")
