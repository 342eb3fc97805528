"""The options of `suggest`, as one record."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import field
from functools import cached_property

from wrinklecli.character.posing import JointTurn, MorphWeight
from wrinklecli.choices import FPS, Substance
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.memory import GPU_BUDGET, MAX_MEMORY
from wrinklecli.tools.materials import Preset, presets
from wrinklecli.tools.read import load_presets


@dataclass(frozen=True)
class SuggestOptions:
    """The clips and meshes to look at, and the number of tools to suggest.

    Attributes:
        clips: Names of the clips to look at; all if empty.
        count: Greatest number of suggestions; a pair counts as one.
        budget: Bytes on a GPU that all suggestions together may take, where each part of a mesh has only the morph
            targets that move it.
        node: Name of the node whose mesh to look at; None for all nodes whose meshes deform.
        face: Suggest only wrinkles of a face, by its morph targets.
        muscles: Suggest only muscles, by the names of bones.
        flesh: Suggest only regions of flesh, by the names of bones and the thickness of the body.
        touch: Suggest only touches, where clips bring fingertips to skin.
        everything: Keep hard and hidden parts, and suggestions with a low score.
        materials: The substance of places, by the name of a material, node or mesh; it overrides the textures.
        presets: Files of presets. A tool gets the preset whose `parts` name its part of a body.
        folder: Folder of the tools file; the paths of preset files in it are relative to this folder.
        fps: Poses per second; at most 200 of a clip, evenly spaced, and fewer where mesh and clips are large.
        anims: Files with more clips, for joints of the same names.
        range_of_motion: Look at the range of motion too, even if the asset has clips.
        pose: Joints to turn in one pose, which replaces the clips.
        morphs: Weights of morph targets in this pose.
        allow_external: Read buffers outside the asset's folder too.
        max_memory: Bytes that the work may take.
        jobs: Processes that measure poses and look at tools. The file does not depend on their number.
    """

    clips: Sequence[str] = ()
    count: int = 8
    budget: int = GPU_BUDGET
    node: str | None = None
    face: bool = False
    muscles: bool = False
    flesh: bool = False
    touch: bool = False
    everything: bool = False
    materials: Mapping[str, Substance] = field(default_factory=dict)
    presets: Sequence[str | os.PathLike[str]] = ()
    folder: str = ""
    fps: float = FPS
    anims: Sequence[str | os.PathLike[str]] = ()
    range_of_motion: bool = False
    pose: Sequence[JointTurn] = ()
    morphs: Sequence[MorphWeight] = ()
    allow_external: bool = False
    max_memory: int = MAX_MEMORY
    jobs: int = 1

    @cached_property
    def known_presets(self) -> Mapping[str, Preset]:
        """All materials by name: the built-in ones, and those of the files.

        Raises:
            ConfigError: A file cannot be read, or has problems.
        """
        known = dict(presets())
        for path in self.presets:
            known |= load_presets(os.fspath(path), known)
        return known

    @property
    def written_presets(self) -> list[str]:
        """The files of presets as the tools file names them."""
        folder = self.folder or os.curdir
        return [os.path.relpath(path, folder).replace(os.sep, "/") for path in self.presets]
