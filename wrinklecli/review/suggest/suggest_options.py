"""The options of `suggest`, as one record."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import field
from functools import cached_property

from wrinklecli.character.posing import JointTurn, MorphWeight
from wrinklecli.choices import Substance
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.memory import MAX_MEMORY
from wrinklecli.tools.materials import Preset, presets
from wrinklecli.tools.read import load_presets


@dataclass(frozen=True)
class SuggestOptions:
    """The clips and meshes to look at, and the number of tools to suggest.

    Attributes:
        clips: Names of the clips to look at; all if empty.
        count: Greatest number of suggestions; a pair counts as one.
        node: Name of the node whose mesh to look at; None for all nodes whose meshes deform.
        face: Suggest the wrinkles of a face by its morph targets, and nothing else.
        muscles: Suggest muscles by the names of bones, and nothing else.
        flesh: Suggest regions of flesh by the names of bones and the thickness of the body, and nothing else.
        touch: Suggest touches where clips bring fingertips to skin, and nothing else.
        everything: Leave out neither hard parts, nor what another layer hides, nor what is not worth it.
        materials: What places are made of, by the name of a material, node or mesh, whatever the pictures show.
        presets: Files of presets, from which tools get theirs where an entry names their parts of a body.
        folder: Folder of the tools file to be, in which the paths of these files begin there.
        fps: Poses per second; at most 200 of a clip, evenly spaced, and fewer where mesh and clips are large.
        anims: Files with more clips, for joints of the same names.
        range_of_motion: Look at the range of motion too, even if the asset has clips.
        pose: Joints to turn; the pose is looked at alone.
        morphs: Weights of morph targets in this pose.
        allow_external: Read buffers outside the asset's folder too.
        max_memory: Bytes that the work may take.
        jobs: Processes that measure poses and look at tools. The file does not depend on their number.
    """

    clips: Sequence[str] = ()
    count: int = 8
    node: str | None = None
    face: bool = False
    muscles: bool = False
    flesh: bool = False
    touch: bool = False
    everything: bool = False
    materials: Mapping[str, Substance] = field(default_factory=dict)
    presets: Sequence[str | os.PathLike[str]] = ()
    folder: str = ""
    fps: float = 30.0
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
