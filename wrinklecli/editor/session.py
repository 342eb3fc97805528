"""An editing session: an asset and its tools file, and what they show at any moment.

All that is shown follows from the current step of the file. Methods may be called from several threads.
"""

import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, replace
from itertools import count
from typing import Any

import numpy as np

from wrinklecli.character.clip import Clip, clip_named
from wrinklecli.character.mesh_names import MeshNames
from wrinklecli.character.scene import deforming_nodes
from wrinklecli.editor.asset import LoadedAsset, ReadOptions
from wrinklecli.editor.attached import AttachedBelow, AttachedTool, AttachedTools, PlayableMesh, ShownMesh
from wrinklecli.editor.clicked import NEW_KINDS, Clicked
from wrinklecli.editor.clip_cache import RecentResults, frame_times
from wrinklecli.editor.edits import Draft, Edits, Step, length_of
from wrinklecli.editor.free_pose import POSE, FreePose
from wrinklecli.editor.guessed_tools import Compressed, ToolGuesser
from wrinklecli.editor.hand import Hand, slide_to
from wrinklecli.editor.mask_canvas import MaskCanvas
from wrinklecli.editor.proposals import Proposal, proposals_of
from wrinklecli.editor.raised import RaisedTool, raised_tool
from wrinklecli.editor.store import Store, without_empty_list
from wrinklecli.errors import ConfigError, WrinkleError
from wrinklecli.files.inputs import Watched
from wrinklecli.files.outputs import Outputs
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.document import Document
from wrinklecli.numeric.arrays import Floats
from wrinklecli.numeric.guard import guarded
from wrinklecli.review.suggest.suggest import suggest
from wrinklecli.tools.effective import EffectiveValue, effective_values, inherited_values
from wrinklecli.tools.mirror import exchange_sides, numbered
from wrinklecli.tools.read import read_values
from wrinklecli.tools.records import ToolsFile, identifier, in_axes, with_axes
from wrinklecli.tools.schema import KINDS

_KEPT_MEASURED = 4  # meshes whose measurements for first guesses are kept


@dataclass(frozen=True, slots=True)
class EditedTool:
    """A tool of the file.

    Attributes:
        list_key: The list of the file that has it, such as `tools` or `muscles`.
        keys: The values that count, by key, each with its source.
        solo: The tool is among those that are shown alone.
        partner: Name of the tool that its `mirror` makes.
        problem: Reason why the tool does not fit the asset.
        length: Its length at rest, a muscle's length, or a region's radius, scene units. If it does not fit, the
            distance from point to point as the file has them, or 0.
    """

    name: str
    list_key: str
    keys: Mapping[str, EffectiveValue]
    enabled: bool
    solo: bool
    partner: str | None
    problem: str | None
    length: float

    @property
    def values(self) -> dict[str, Any]:
        """The values that count, by key."""
        return {key: each.value for key, each in self.keys.items()}

    @property
    def own(self) -> frozenset[str]:
        """The keys that the tool itself has."""
        return frozenset(key for key, each in self.keys.items() if each.source == "tool")


class Session(Edits):
    """An asset and its tools, being edited. Unsaved edits of an earlier session are recovered as a step.

    They are kept in a folder of the user's own (`own_folder`), if there is one.

    The tools file need not exist; without `tools` it is the asset's path with the ending .yaml. A draft is shown at
    once, on the triangles that are there. `pose` is that of the clip `POSE`, which may be named wherever a clip may.
    A `hand` slides the skin of a touch, whatever the clip does there.
    `notes` are lines about the asset's motions and about changes of the
    files, the newest last.

    Raises:
        WrinkleError: A file is at fault.
    """

    def __init__(
        self,
        asset: str | os.PathLike[str],
        tools: str | os.PathLike[str] | None = None,
        read_options: ReadOptions | None = None,
        own_folder: str | None = None,
    ) -> None:
        self.asset = os.fspath(asset)
        self.read_options = read_options or ReadOptions()
        path = os.path.splitext(self.asset)[0] + ".yaml" if tools is None else os.fspath(tools)
        self.own_folder = own_folder
        super().__init__(Store(path, external=self.read_options.allow_external, own_folder=own_folder))
        self.pose = FreePose()
        self.hand: Hand | None = None
        self._pose_clip: Clip | None = None
        self._watched_asset = Watched([self.asset, *self.read_options.anims])
        self._loaded = self._load()
        # The step or draft that the tools are of, and the tools: the last ones shown, and the last refined ones.
        self._shown: tuple[object, AttachedTools] | None = None
        self._refined: tuple[object, AttachedTools] | None = None
        self._measured = RecentResults(_KEPT_MEASURED)
        self._proposals: tuple[FreePose, list[Proposal]] | None = None
        self.recover()
        for presets in self.read_options.presets:
            self.add_presets(os.fspath(presets))
        self._preset_files = self.settings().preset_files
        self._watched_tools, self._watched_presets = Watched([self.path]), Watched(self._preset_files)

    # The asset and its tools.

    @property
    def clips(self) -> tuple[Clip, ...]:
        """All clips: of the asset, of other files, of the range of motion."""
        return self._loaded.clips

    @property
    def range_clips(self) -> frozenset[str]:
        """Names of the clips that are a range of motion; no file has them."""
        return self._loaded.range_clips

    @property
    def document(self) -> Document:
        """The asset with all clips."""
        return self._loaded.document

    def take_pose(self, pose: FreePose) -> None:
        """Set the pose of the clip `POSE`.

        Raises:
            AssetError: A joint or morph target does not exist.
        """
        with self._guarded():
            self.pose, self._pose_clip = pose, pose.clip(self._loaded.document)

    def frame_times(self, clip: str) -> Floats:
        """(frames,) seconds at which a clip plays; meshes at exactly these times are cheap."""
        return frame_times(clip_named(self.clips, clip, where=self.asset))

    def tools(self) -> tuple[EditedTool, ...]:
        """The effects of all lists of the file, with disabled ones. A mirrored one is its source's partner."""
        with self._guarded():
            attached, known, tools = self._attached(), self.presets, []
            for list_key, kind in KINDS.items():
                file = self._base.file.of_list(list_key)
                for number, own in enumerate(file.tools):
                    if self._draft is not None and (self._draft.list_key, self._draft.number) == (list_key, number):
                        own = self._draft.values
                    keys = effective_values(own, file.defaults, known, kind)
                    tools.append(self._edited(list_key, own, keys, attached))
            return tuple(tools)

    def _edited(
        self, list_key: str, own: Mapping[str, Any], keys: Mapping[str, EffectiveValue], attached: AttachedTools
    ) -> EditedTool:
        """A tool of a list by its own keys, and the values that count."""
        name, mirrored = str(own.get("name", "")), keys["mirror"].value not in (None, "none")
        partner = exchange_sides(name) if mirrored else None
        problems, found = attached.problems, attached.every.get(name)
        return EditedTool(
            name=name,
            list_key=list_key,
            keys=keys,
            enabled=bool(keys["enabled"].value),
            solo=name in self._base.solo,
            partner=partner,
            problem=problems.get(name) or (problems.get(partner) if partner else None),
            length=length_of(own) if found is None else found.span,
        )

    def inherited(self, tool: EditedTool) -> dict[str, EffectiveValue]:
        """The values that a tool's own keys would have if they were unset; required keys without defaults have none."""
        own = {key: tool.keys[key].value for key in tool.own}
        defaults = self._base.file.of_list(tool.list_key).defaults
        return inherited_values(own, defaults, self.presets, KINDS[tool.list_key])

    # Edits.

    def add(
        self, list_key: str, places: Sequence[Sequence[float]], node: str | None = None, *, clip: str | None = None
    ) -> str:
        """Add an effect of a list of the file, if it fits, where someone has clicked; return its name.

        Args:
            list_key: A key of `NEW_KINDS`.
            places: A (3,) place on the skin at rest, world space, for each click.
            node: Name of the node whose mesh was clicked.
            clip: Name of the clip that is shown.

        Raises:
            WrinkleError: It does not fit.
        """
        with self._guarded():
            loaded, kind, file = self._loaded, NEW_KINDS[list_key], self._base.file.of_list(list_key)
            deforming, attached = deforming_nodes(loaded.document), self._attached()
            meshes = [mesh for mesh in attached.meshes if mesh.ground.rig.node in deforming]
            mesh = next((mesh for mesh in meshes if node in (None, mesh.node)), None)
            if mesh is None:
                raise ConfigError("neither joints nor morph targets move this mesh", where=self.asset)
            points = np.array(places, float)
            shown = next((each for each in self.clips if each.name == clip), None)
            clicked = Clicked(points, mesh.ground, shown, self._written_place, lambda: self._measured_mesh(mesh))
            axis = file.defaults.get("mirror")
            sides = dict(zip("xyz", in_axes(points.mean(axis=0).tolist(), file.up), strict=True))
            name = self._new_name(kind.word + ("" if axis not in sides else ".L" if sides[axis] > 0 else ".R"))
            values = {"name": name, **({"node": mesh.node} if len(deforming) > 1 else {}), **kind.keys(clicked)}
            edited = without_empty_list(file.with_tool(values).of_list("tools"))
            # A step that shows nothing would only be undone.
            problem = loaded.attach(self._settings_of(edited), attached).problems.get(name)
            if problem is not None:
                raise ConfigError(problem)
            self._become(edited, f"add {name}")
            return name

    def proposals(self, *, posed: bool = False) -> list[Proposal]:
        """Suggest for the asset, in its motions, or with `posed` in the pose that is set.

        A call may take seconds; others may go on meanwhile.
        """
        pose = self.pose if posed else FreePose()
        if self._proposals is None or self._proposals[0] != pose:
            options = asdict(self.read_options) | {"presets": self.settings().preset_files}
            found = suggest(self.asset, pose=pose.joint_turns, morphs=pose.weights, **options)
            # What was left out of several counts only where nothing remains; `suggest` says it in a terminal.
            self.notes += [*found.notes, f"{self.asset}: {found.reason}"] if found.reason else []
            self._proposals = pose, proposals_of(found)
        return self._proposals[1]

    def try_out(self, proposal: Proposal) -> RaisedTool | None:
        """Try a proposal alone; None if it does not fit, or nothing raises it. Others may go on meanwhile."""
        header = {key: value for key, value in self._base.file.header.items() if key == "presets"}
        return self._tried({**header, proposal.list_key: [dict(proposal.values)]})

    def try_material(self, tool: str, material: str) -> RaisedTool | None:
        """Try a tool alone with another material, as `set_material` gives it."""
        with self._guarded():
            file, number = self._entry(tool)
            values = {key: value for key, value in file.tools[number].items() if key not in self._given_by(material)}
            header = {key: value for key, value in file.header.items() if key in ("up", "presets", "defaults")}
        return self._tried({**header, "tools": [{**values, "material": material, "mirror": "none"}]})

    def compressed(self, mesh: PlayableMesh) -> Compressed | None:
        """The greatest compression of a mesh over all clips, and in the pose that is set; this may take seconds."""
        return self._measured_mesh(mesh).compressed

    def is_taken(self, proposal: Proposal) -> bool:
        """True if an effect of the file makes the folds that a proposed one would make."""
        node = proposal.values.get("node")
        with self._guarded():
            tools = self._attached().tools.values()
            nodes = None if node is None else MeshNames.of(self._loaded.document).called(node)
            return any(proposal.is_taken(each) for each in tools if nodes is None or each.ground.rig.node in nodes)

    def accept(self, *proposals: Proposal) -> list[str]:
        """Add what is proposed in one step, and return the names."""
        with self._guarded():
            file, taken, names = self._base.file, self._taken_names(), list[str]()
            for each in proposals:
                names.append(numbered(each.name, taken) if identifier(each.name) in taken else each.name)
                taken.add(identifier(names[-1]))
                file = file.of_list(each.list_key)
                values = with_axes(KINDS[each.list_key], each.values, file.up) | {"name": names[-1]}
                if file.defaults.get("mirror") not in (None, "none"):
                    values.setdefault("mirror", "none")
                file = file.with_tool(values)
            self._become(without_empty_list(file.of_list("tools")), f"accept {', '.join(names)}")
            return names

    # Masks.

    def mask_canvas(self, tool: str) -> tuple[MaskCanvas, float]:
        """The mask of a tool to paint on, as it is or white, and the tool's length, scene units.

        Raises:
            WrinkleError: The tool does not fit, or can have no image as its mask.
        """
        with self._guarded():
            attached = self._attached()
            found = attached.every.get(tool)
            if found is None:
                raise ConfigError(attached.problems.get(tool, "is switched off"), where=tool)
            members = found.region.members if isinstance(found, AttachedTool) else np.flatnonzero(found.outlined)
            return MaskCanvas(found.attached.tool, found.ground, members), found.span

    def set_mask(self, tool: str, canvas: MaskCanvas) -> str:
        """Write a mask as a PNG beside the tools file, under a new name, so that it can be undone; return the name.

        Raises:
            WrinkleError: The file cannot be written.
        """
        with self._guarded():
            stem = f"{os.path.splitext(self.path)[0]}.{identifier(tool)}"
            path = next(each for k in count(1) if not os.path.exists(each := f"{stem}_{k}.png"))
            with Outputs() as outputs:
                outputs.add_bytes(path, canvas.png())
            image = os.path.basename(path)
            texcoord = {"texcoord": canvas.texcoord} if canvas.texcoord else {}
            self.set_value(tool, ("mask",), {"image": image, **texcoord})
            return image

    # The files.

    def refresh(self) -> bool:
        """Read files that others have changed, to be called now and then; True if anything changed, even only `notes`.

        Tools are attached to the new asset. If a file cannot be read or merged, `notes` say so, and nothing changes.
        """
        if self._preset_files != self.settings().preset_files:
            self._preset_files = self.settings().preset_files
            self._watched_presets = self._watched_presets.instead(self._preset_files)
        asset, tools = self._watched_asset.changed(), self._watched_tools.changed()
        presets = self._watched_presets.changed()
        try:
            if asset:
                loaded = self._load()  # without the lock: the old asset is shown meanwhile
                with self._lock:
                    self._loaded, self._shown, self._refined, self._proposals = loaded, None, None, None
                    self.pose, self._pose_clip = FreePose(), None
                self.notes.append(f"{self.asset}: was exported again")
            if tools:
                self.merge()
            if presets:
                self.read_presets()
            if tools or presets:
                self._protect(self._loaded)
        except WrinkleError as error:
            self.notes += error.lines
        return asset or tools or presets

    # What is shown.

    @property
    def is_refined(self) -> bool:
        """True if tools are shown as they are baked: on triangles that were refined for them."""
        return self._draft is None and self._refined is not None and self._refined[0] is self._base

    def refine(self) -> None:
        """Refine the mesh for the current tools. This takes a while; others may go on meanwhile."""
        with self._lock:
            step, loaded, settings = self._base, self._loaded, self._shown_settings(self._base)
        if self._refined is None or self._refined[0] is not step:
            with guarded(self.asset):
                attached = loaded.attach(settings)
            with self._lock:
                if loaded is self._loaded:
                    self._refined = step, attached

    def attached_tools(self) -> Mapping[str, AttachedTool]:
        """The tools that fit, with mirrored ones, by name; they are provisional until `refine`."""
        with self._guarded():
            return self._attached().tools

    def attached(self) -> Mapping[str, AttachedTool | AttachedBelow]:
        """All effects that fit, with mirrored ones, by name."""
        with self._guarded():
            return self._attached().every

    def meshes(self, clip: str | None, time: float, *, wait: bool = True, wrinkled: bool = True) -> list[ShownMesh]:
        """All meshes at a time of a clip, or in the stored pose if `clip` is None.

        Args:
            clip: Name of the clip.
            time: Seconds; the times of `frame_times` are cheap.
            wait: Wait until the mesh is refined for the current tools, unless there is a draft. If False, tools are
                shown on the triangles that are there until `refine` is called.
            wrinkled: Add the wrinkles.
        """
        if wait and self._draft is None:
            self.refine()
        with self._guarded():
            found = self._clip(clip)
            held = self._held(found, time)
            return [
                ShownMesh(each, each.posed(found, time, wrinkled=wrinkled, held=held.get(each.ground.rig.node)))
                for each in self._attached().meshes
            ]

    def _held(self, clip: Clip | None, time: float) -> dict[int, dict[int, float]]:
        """The weights, by node and number of the morph target, that the hand holds at a time of a clip."""
        if self.hand is None:
            return {}
        touched = self._attached().below.get(self.hand.name)
        # An edit of the touch takes the hand away.
        if touched is None or touched.touch is not self.hand.drive:
            return {}
        rig = touched.ground.rig
        weights = self.hand.weights_in(rig.own, clip, time)
        return {rig.node: dict(zip(touched.columns.tolist(), weights, strict=True))}

    def hold(self, name: str, clip: str | None, time: float, origin: Floats, direction: Floats) -> Hand | None:
        """Press a hand on the skin of a touch, and slide it to where a ray meets the skin at a time of a clip.

        `origin` and `direction` are (3,), world space. None, and nothing changes, if the ray goes away from the skin.
        """
        with self._guarded():
            found = self._attached().below.get(name)
            drive = None if found is None else found.touch
            if found is None or drive is None:
                return None
            slide = slide_to(drive, found.ground.rig.own, self._clip(clip), time, origin, direction)
            if slide is None:
                return None
            self.hand = Hand(name, drive, np.append(slide, drive.deepest))
            return self.hand

    def curve(self, tool: str, clip: str | None, time: float) -> Floats | None:
        """(points, 2) of a tool's control curve at a moment, scene units; None if the tool does not fit."""
        with self._guarded():
            found = self._attached().tools.get(tool)
            if found is None:
                return None
            at = self._clip(clip)
            return found.part.cut(at, self._loaded.cache.numbers_at(found.ground, found.part, at, time))

    def heights(self, tool: str, clip: str) -> tuple[Floats, Floats] | None:
        """(frames,) seconds, and (frames,) the greatest height of a tool at each, scene units.

        None if the tool does not fit, and for a clip of one moment.
        """
        with self._guarded():
            found, at = self._attached().every.get(tool), self._clip(clip)
            if found is None or at is None or at.end <= at.start:
                return None
            return found.heights(self._loaded.cache, at)

    def raised(self, tool: str) -> RaisedTool | None:
        """An effect of the file where it is tallest; None if it does not fit, or no clip raises it."""
        with self._guarded():
            return raised_tool(self._attached(), tool, self._loaded.cache, self.clips)

    def warnings(self) -> dict[str, list[str]]:
        """The warnings of `check` by tool, those about whole meshes under an empty name; may take seconds."""
        self.refine()
        assert self._refined is not None
        with guarded(self.asset):
            return self._refined[1].warnings(self._loaded.cache, self.clips, self._settings_of(self._base.file))

    def greatest_moves(self) -> dict[str, float]:
        """Measure how far each effect that fits moves the skin in any clip, over its length; this may take seconds."""
        self.refine()
        assert self._refined is not None
        with guarded(self.asset):
            return self._refined[1].greatest_moves(self._loaded.cache, self.clips)

    # Internals.

    @contextmanager
    def _guarded(self) -> Iterator[None]:
        with self._lock, guarded(self.asset):
            yield

    def _tried(self, values: Mapping[str, Any]) -> RaisedTool | None:
        """Try the only effect of a file, without tools, refined as those of the session are."""
        with self._lock:
            loaded, settings = self._loaded, self._settings_of(self._base.file)
            posed = () if self._pose_clip is None else (self._pose_clip,)
        read = read_values({"version": 1, **values}, name=self.path, known=self.presets)
        with guarded(self.asset):
            tried, *_ = read.effects
            others = [each for each in settings.effects if each.section not in ("tools", tried.section)]
            attached = loaded.attach(replace(settings, up=read.up, effects=(*others, tried)))
            return raised_tool(attached, tried.name, loaded.cache, (*loaded.clips, *posed))

    def _measured_mesh(self, mesh: PlayableMesh) -> ToolGuesser:
        """A mesh with the measurements that first guesses need."""
        clips = self.clips if self._pose_clip is None else (*self.clips, self._pose_clip)
        return self._measured.get_or_make(
            (mesh.ground, self.pose), lambda: ToolGuesser(self._loaded.document, mesh.ground, clips)
        )

    def _load(self) -> LoadedAsset:
        with guarded(self.asset):
            loaded = LoadedAsset.read(self.asset, self.read_options)
        self.notes += [each for each in loaded.notes if each not in self.notes]
        inputs = [self.asset, *loaded.document.files, *self.read_options.anims]
        self._watched_asset = self._watched_asset.instead(inputs)
        self._protect(loaded)
        return loaded

    def _protect(self, loaded: LoadedAsset) -> None:
        """Never write the tools file over a file that is read."""
        options, settings = self.read_options, self.settings()
        presets = (*settings.preset_files, *options.presets)
        self._store.protect([self.asset, *loaded.document.files, *options.anims, *presets])

    def _shown_settings(self, step: Step, draft: Draft | None = None) -> ToolsFile:
        """The shown tools of a step, or of a draft that follows it."""
        settings = self._settings_of(step.file) if draft is None else draft.settings
        if not step.solo:
            return settings
        sources = {each.name: exchange_sides(each.name) if each.mirrored else each.name for each in settings.effects}
        return settings.only({name for name, source in sources.items() if source in step.solo})

    def _attached(self) -> AttachedTools:
        """Attach the current tools, quickly: refined if that was done already, else provisionally."""
        current = self._draft or self._base
        if self._refined is not None and self._refined[0] is current:
            return self._refined[1]
        if self._shown is None or self._shown[0] is not current:
            # A drag goes on from the tools of a moment ago.
            dragged = self._shown is not None and self._shown[1].provisional
            before = self._shown if dragged else self._refined or self._shown
            settings = self._shown_settings(self._base, self._draft)
            self._shown = current, self._loaded.attach(settings, None if before is None else before[1])
            if not self._shown[1].provisional and current is self._base:
                self._refined = self._shown
        return self._shown[1]

    def _clip(self, name: str | None) -> Clip | None:
        if name == POSE:
            return self._pose_clip
        return None if name is None else clip_named(self.clips, name, where=self.asset)
