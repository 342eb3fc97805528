"""What `wrinkle edit` edits: an asset with its tools file, and what these show at every moment.

What is shown follows from the present step of the file alone. Methods may be called from several threads.
"""

import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from wrinklecli.character.clip import Clip, clip_named
from wrinklecli.character.scene import deforming_nodes
from wrinklecli.editor.asset import LoadedAsset, ReadOptions
from wrinklecli.editor.attached import AttachedTool, AttachedTools, PlayableMesh, ShownMesh
from wrinklecli.editor.clip_cache import RecentResults, frame_times
from wrinklecli.editor.edits import Draft, Edits, Step, length_of
from wrinklecli.editor.free_pose import POSE, FreePose
from wrinklecli.editor.proposals import Proposal, guessed, offers_of, turned
from wrinklecli.editor.store import Store
from wrinklecli.editor.told import control_curve, heights_over, warnings_of
from wrinklecli.errors import WrinkleError
from wrinklecli.files.watched import Watched
from wrinklecli.gltf.document import Document
from wrinklecli.numeric.arrays import Floats
from wrinklecli.numeric.guard import guarded
from wrinklecli.numeric.memory import MAX_MEMORY
from wrinklecli.review.suggest.placed import Chosen
from wrinklecli.review.suggest.suggest import suggest
from wrinklecli.tools.mirror import exchange_sides
from wrinklecli.tools.records import ToolsFile, identifier, in_axes
from wrinklecli.tools.schema import TOOL_KEYS


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
        length: From point to point as the file has them, scene units; 0 where they are markers.
    """

    name: str
    values: Mapping[str, Any]
    own: frozenset[str]
    enabled: bool
    solo: bool
    partner: str | None
    problem: str | None
    length: float


class Session(Edits):
    """An asset and its tools, being edited. Made by `Session.open`.

    What is dragged is shown at once, on the triangles that are there.

    Args:
        asset: Its path.
        reading: How it is read, as of `open`.
        store: The tools file.

    Attributes:
        asset: Its path.
        reading: How it is read.
        pose: What `POSE` shows, which may be named wherever a clip may.
        notes: What was made of the asset's motions, and what happened to the files, a line each, newest last.
    """

    def __init__(self, asset: str, reading: ReadOptions, store: Store) -> None:
        super().__init__(store)
        self.asset = asset
        self.reading = reading
        self.pose = FreePose()
        self._posed: Clip | None = None
        self._watched_asset = Watched([asset, *reading.anims])
        self._stage = self._read_stage()
        self._laid: tuple[object, AttachedTools] | None = None
        self._settled: tuple[object, AttachedTools] | None = None
        self._measured = RecentResults(4)
        self._offers: list[Proposal] | None = None
        self._watched_tools = Watched([store.path])

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
        """Read an asset and its tools, and what an earlier session has not saved of these: a step that can be undone.

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
        name = os.fspath(tools) if tools is not None else os.path.splitext(path)[0] + ".yaml"
        reading = ReadOptions(tuple(os.fspath(each) for each in anims), range_of_motion, allow_external, max_memory)
        session = cls(path, reading, Store(name))
        session.recover()
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

    def take_pose(self, pose: FreePose) -> None:
        """Let `POSE` be this.

        Raises:
            AssetError: There is no joint or morph target of a name.
        """
        with self._guarded():
            self.pose, self._posed = pose, pose.clip(self._stage.document)

    def frame_times(self, clip: str) -> Floats:
        """(frames,) seconds at which a clip is played: meshes at just these times are cheap."""
        return frame_times(clip_named(self.clips, clip, where=self.asset))

    def tools(self) -> tuple[EditedTool, ...]:
        """The tools of the file, in its order, disabled ones too; a mirrored one is its source's partner."""
        with self._guarded():
            file, solo, problems = self._base.file, self._base.solo, self._quick().problems
            schema = {key: each["default"] for key, each in TOOL_KEYS.items() if "default" in each}
            found = []
            for number, own in enumerate(file.tools):
                if self._draft is not None and self._draft.number == number:
                    own = self._draft.values
                values = schema | dict(file.defaults) | dict(own)
                name, mirrored = str(own.get("name", "")), values.get("mirror") not in (None, "none")
                partner = exchange_sides(name) if mirrored else None
                problem = problems.get(name) or (problems.get(partner) if partner else None)
                enabled = bool(values.get("enabled"))
                shown = name in solo
                found.append(EditedTool(name, values, frozenset(own), enabled, shown, partner, problem, length_of(own)))
            return tuple(found)

    # Edits.

    def add_tool(self, origin: Sequence[float], target: Sequence[float], node: str | None = None) -> str:
        """Add a tool between two places of a mesh at rest, with a first guess of its width and bumps.

        Args:
            origin: (3,) world space.
            target: (3,)
            node: Name of the node whose mesh was touched.

        Returns:
            Its name.
        """
        with self._guarded():
            file = self._base.file
            axis = file.defaults.get("mirror")
            sides = dict(zip("xyz", in_axes((np.add(origin, target) / 2.0).tolist(), file.up), strict=True))
            name = self._new_name("wrinkle" + ("" if axis not in sides else ".L" if sides[axis] > 0 else ".R"))
            span = float(np.linalg.norm(np.subtract(target, origin)))
            deforming = deforming_nodes(self._stage.document)
            meshes = [mesh for mesh in self._quick().meshes if mesh.ground.rig.node in deforming]
            touched = [mesh for mesh in meshes if node in (None, mesh.node)]
            values: dict[str, Any] = {"name": name}
            if node is not None and len(deforming) > 1:
                values["node"] = node
            values |= {"origin": self._written_place(origin, span), "target": self._written_place(target, span)}
            if touched:
                values |= guessed(self._chosen_on(touched[0]).tool(np.array(origin, float), np.array(target, float)))
            else:
                values["width"] = float(f"{span:.2g}")
            self._become(file.with_tool(values), f"{name} is new")
            return name

    def offers(self) -> list[Proposal]:
        """What `suggest` finds for the asset. It may take seconds, beside what is shown meanwhile."""
        if self._offers is None:
            reading = self.reading
            found = suggest(
                self.asset,
                anims=reading.anims,
                range_of_motion=reading.range_of_motion,
                allow_external=reading.allow_external,
                max_memory=reading.max_memory,
            )
            self.notes += [*found.notes, *([f"{self.asset}: {found.reason}"] if found.reason else [])]
            self._offers = offers_of(found)
        return self._offers

    def accept(self, offer: Proposal) -> str:
        """Add a tool that was offered; its name."""
        with self._guarded():
            file = self._base.file
            name = offer.name if identifier(offer.name) not in self._taken_names() else self._new_name(offer.name)
            values = turned(offer.values, file.up) | {"name": name}
            if file.defaults.get("mirror") not in (None, "none"):
                values.setdefault("mirror", "none")
            self._become(file.with_tool(values), f"{name} is accepted")
            return name

    # The files.

    def refresh(self) -> bool:
        """Take up what others have written: the asset, exported again, and the tools file; to be called now and then.

        Tools are attached again, and those that no longer fit have a `problem`. What cannot be read, or not be merged,
        is said in `notes`, and all stays as it is.

        Returns:
            Whether anything has changed, be it the notes.
        """
        asset, tools = self._watched_asset.changed(), self._watched_tools.changed()
        try:
            if asset:
                stage = self._read_stage()  # beside what is shown meanwhile
                with self._lock:
                    self._stage, self._laid, self._settled, self._offers = stage, None, None, None
                    self.pose, self._posed = FreePose(), None
                self.notes.append(f"{self.asset}: was exported again")
            if tools:
                self.merge()
        except WrinkleError as error:
            self.notes += error.lines
        return asset or tools

    # What is shown.

    @property
    def settled(self) -> bool:
        """Whether tools are shown as they are baked: refined for what they are now."""
        return self._draft is None and self._settled is not None and self._settled[0] is self._base

    def settle(self) -> None:
        """Refine for what tools are now. It takes a while, and may run beside what is shown meanwhile."""
        with self._lock:
            step, stage, settings = self._base, self._stage, self._shown_settings(self._base)
        if self._settled is None or self._settled[0] is not step:
            with guarded(self.asset):
                laid = stage.laid(settings)
            with self._lock:
                if stage is self._stage:
                    self._settled = step, laid

    def laid(self) -> Mapping[str, AttachedTool]:
        """The tools that fit, mirrored ones too, by name; in a hurry as `meshes` shows them."""
        with self._guarded():
            return self._quick().tools

    def meshes(self, clip: str | None, time: float, *, wait: bool = True, wrinkled: bool = True) -> list[ShownMesh]:
        """All meshes at a time of a clip, seconds; in the stored pose where the clip is None.

        Args:
            clip: Its name.
            time: Those of `frame_times` are cheap.
            wait: Until tools are refined for what they are now, unless they are drafts; else `settle` is to be called,
                and until then they are shown on the triangles that are there.
            wrinkled: With wrinkles.
        """
        if wait and self._draft is None:
            self.settle()
        with self._guarded():
            found = self._clip(clip)
            return [
                ShownMesh(each.node, each, each.posed(found, time, wrinkled=wrinkled)) for each in self._quick().meshes
            ]

    def curve(self, tool: str, clip: str | None, time: float) -> Floats | None:
        """(points, 2) a tool's control curve at a moment, as `control_curve`; None where it does not fit."""
        with self._guarded():
            found = self._quick().tools.get(tool)
            return None if found is None else control_curve(found, self._stage.played, self._clip(clip), time)

    def heights(self, tool: str, clip: str) -> tuple[Floats, Floats] | None:
        """(frames,) seconds and (frames,) a tool's greatest height then, scene units.

        None where it does not fit, and for a clip of one moment.
        """
        with self._guarded():
            found, at = self._quick().tools.get(tool), self._clip(clip)
            if found is None or at is None or at.end <= at.start:
                return None
            return heights_over(found, self._stage.played, at)

    def warnings(self) -> dict[str, list[str]]:
        """What `check` warns of, by tool; of meshes by an empty name. It settles, and may take seconds at first."""
        self.settle()
        assert self._settled is not None
        laid = self._settled[1]
        with guarded(self.asset):
            return warnings_of(laid, self._stage.played, self.clips, self._settings_of(self._base.file))

    # Within.

    @contextmanager
    def _guarded(self) -> Iterator[None]:
        with self._lock, guarded(self.asset):
            yield

    def _chosen_on(self, mesh: PlayableMesh) -> Chosen:
        """A mesh, measured for first guesses."""
        return self._measured.of(mesh.ground, lambda: Chosen(self._stage.document, mesh.ground, self.clips))

    def _read_stage(self) -> LoadedAsset:
        with guarded(self.asset):
            stage = LoadedAsset.read(self.asset, self.reading)
        self.notes += [each for each in stage.notes if each not in self.notes]
        self._watched_asset = self._watched_asset.instead([self.asset, *stage.document.files, *self.reading.anims])
        return stage

    def _shown_settings(self, step: Step, draft: Draft | None = None) -> ToolsFile:
        """The tools of a step that are shown, or with those of a draft of it."""
        settings = self._settings_of(step.file) if draft is None else draft.settings
        if not step.solo:
            return settings
        names = [exchange_sides(each.name) if each.mirrored else each.name for each in settings.tools]
        chosen = (tool for tool, name in zip(settings.tools, names, strict=True) if name in step.solo)
        return replace(settings, tools=tuple(chosen))

    def _quick(self) -> AttachedTools:
        """What tools make of the asset now, in a hurry: what was settled where it fits."""
        of = self._draft or self._base
        if self._settled is not None and self._settled[0] is of:
            return self._settled[1]
        if self._laid is None or self._laid[0] is not of:
            # What is dragged is carried on from where it was a moment ago.
            drags = self._laid is not None and self._laid[1].hurried
            before = self._laid if drags else self._settled or self._laid
            self._laid = (
                of,
                self._stage.laid(self._shown_settings(self._base, self._draft), None if before is None else before[1]),
            )
            if not self._laid[1].hurried and of is self._base:
                self._settled = self._laid
        return self._laid[1]

    def _clip(self, name: str | None) -> Clip | None:
        if name == POSE:
            return self._posed
        return None if name is None else clip_named(self.clips, name, where=self.asset)
