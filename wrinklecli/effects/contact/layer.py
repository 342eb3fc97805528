"""Contact on a mesh: the folds that tools ask for, on the surface as the wrinkles move it."""

from collections.abc import Sequence
from functools import partial
from importlib.util import find_spec
from typing import TYPE_CHECKING, ClassVar

from wrinklecli.character.clip import Clip
from wrinklecli.character.mesh_names import MeshNames
from wrinklecli.effects.attached import AnyAttached
from wrinklecli.effects.effect import Effect, EffectKind, Layer, MeshPlan, SamplingOptions
from wrinklecli.effects.field.layer import FieldLayer
from wrinklecli.effects.wrinkle.layer import carried_patches_of
from wrinklecli.errors import BakeError, listed, nearest
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.document import Document
from wrinklecli.gltf.shape import Json
from wrinklecli.surface.ground import Ground
from wrinklecli.tools.records import EffectTool, ToolsFile, WrinkleTool

if TYPE_CHECKING:
    from wrinklecli.effects.contact.fold import Fold


@dataclass(frozen=True, slots=True)
class ContactLayer(Layer):
    """The folds of a mesh whose contact is resolved.

    Attributes:
        tools_without_fold: Names of the tools that ask for contact, but whose ends nothing brings together.
    """

    folds: tuple["Fold", ...]
    tools_without_fold: tuple[str, ...]

    section: ClassVar[str] = "folds"  # as that of effects, whose module other bakes do not import
    is_solved: ClassVar[bool] = True

    def effects(
        self, plan: MeshPlan, clips: Sequence[Clip], before: Sequence[Effect], how: SamplingOptions
    ) -> list[Effect]:
        """Resolve the folds in clips. Wrinkles are lowered where contact cannot keep them apart."""
        # Imported here, as other bakes need none of it.
        from wrinklecli.effects.contact.sample import resolve_folds

        return resolve_folds(self.folds, plan, before, clips, how)

    def warnings(self, _plan: MeshPlan, _clips: Sequence[Clip]) -> list[str]:
        """Warnings about tools that ask for contact in vain."""
        return [
            f"{name}: no joint nor morph target brings its ends together: contact is left as it is"
            for name in self.tools_without_fold
        ]


class ContactKind(EffectKind[EffectTool, AnyAttached]):
    """Contact has no tools of its own: wrinkling tools ask for it."""

    @property
    def is_installed(self) -> bool:
        """True if the extra `contact` is installed."""
        return find_spec("ipctk") is not None

    def lines(self, _entry: Json) -> list[str]:
        """Nothing, as `check` solves no fold."""
        return []

    def attach(self, _tools: Sequence[EffectTool], _ground: Ground, _settings: ToolsFile) -> Sequence[AnyAttached]:
        """Nothing."""
        return ()

    def plan(self, plan: MeshPlan, ground: Ground, _attached: Sequence[tuple[int, AnyAttached]]) -> ContactLayer:
        """Find the folds of the tools that ask for contact.

        Raises:
            BakeError: The library that resolves contact is missing, or a node whose mesh is to be ignored.
        """
        carried = carried_patches_of(plan)
        chosen = [number for number, each in enumerate(carried) if each.patch.tool.contact is not None]
        tools = [carried[number].patch.tool for number in chosen]
        if not self.is_installed:
            message = "contact needs ipctk, which is not installed: pip install 'wrinklecli[contact]'"
            raise BakeError(message, where=tools[0].place("contact"))
        # Imported here, as other bakes need none of it.
        from wrinklecli.character.scene import drawn_with
        from wrinklecli.character.scene_surface import read_scene_meshes
        from wrinklecli.effects.contact.fold import find_folds

        _check_ignored(ground.document, tools)
        own = (ground.rig.node, *ground.contacts.copies, *ground.contacts.unread)
        others = [node for node in drawn_with(ground.document, ground.rig.node) if node not in own]
        obstacles = partial(read_scene_meshes, ground.document, others)
        raised = plan.layer(FieldLayer)
        fields = raised.parts if raised else ()
        folds, without = find_folds(
            carried, chosen, plan.fine, ground.rest, ground.rig, ground.neighbours.parts, obstacles, fields
        )
        return ContactLayer(tuple(folds), tuple(carried[number].patch.tool.name for number in without))


KIND = ContactKind()


def _check_ignored(document: Document, tools: Sequence[WrinkleTool]) -> None:
    """Refuse names of nodes that are not there, unless the tools file is for other assets too.

    Raises:
        BakeError: A line for each such name.
    """
    known = list(MeshNames.of(document).own.values())
    problems = [
        BakeError(
            f"node {name!r} is no node with a mesh{nearest(name, known)}; there are {listed(known)}",
            where=tool.place("contact"),
        )
        for tool in tools
        if tool.contact and not tool.optional
        for name in tool.contact.ignore
        if name not in known
    ]
    if problems:
        raise BakeError.of_all(problems)
