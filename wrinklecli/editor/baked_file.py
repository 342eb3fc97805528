"""The saved tools baked, as `wrinkle bake` does it, and what the written file itself shows at a moment."""

import os
from dataclasses import dataclass

from wrinklecli.baking.job import BakeOptions
from wrinklecli.baking.pipeline import bake
from wrinklecli.character.clip import Clip, read_clips
from wrinklecli.editor.asset import LoadedAsset
from wrinklecli.editor.attached import PlayableMesh, ShownMesh
from wrinklecli.editor.session import Session
from wrinklecli.gltf.document import Document, read_document
from wrinklecli.numeric.guard import Progress, guarded, no_progress
from wrinklecli.numeric.memory import Memory
from wrinklecli.tools.records import ToolsFile


@dataclass(frozen=True, slots=True)
class BakedFile:
    """A baked file, read again.

    Attributes:
        told: What was made, in lines.
        text: Of the tools file that was baked.
        document: The file.
        laid: Its meshes, whose wrinkles are morph targets like others.
        clips: Its own, by name.
    """

    told: str
    text: str
    document: Document
    laid: tuple[PlayableMesh, ...]
    clips: dict[str, Clip]

    def plays(self, clip: str | None) -> bool:
        """Whether it has a clip; it has the stored pose, where that is None, but no made-up motion."""
        return clip is None or clip in self.clips

    def meshes(self, clip: str | None, time: float) -> list[ShownMesh]:
        """All meshes at a time of a clip, seconds, as the file plays it."""
        found = None if clip is None else self.clips[clip]
        return [ShownMesh(each.node, each, each.posed(found, time)) for each in self.laid]


def bake_saved(session: Session, progress: Progress = no_progress) -> BakedFile:
    """Bake the saved file of a session, beside it; it may run beside what is shown meanwhile.

    Raises:
        WrinkleError: As `wrinkle bake`.
    """
    reading, asset = session.reading, os.path.splitext(os.path.basename(session.asset))[0]
    out, text = os.path.join(os.path.dirname(session.path), f"{asset}_wrinkled.glb"), session.saved_text
    options = BakeOptions(
        anims=reading.anims,
        allow_external=reading.allow_external,
        max_memory=reading.max_memory,
        replace=True,  # as `stage` shows it
    )
    report = bake(session.asset, session.path, out, options, progress=progress)
    with guarded(out):
        document = read_document(out, allow_external=reading.allow_external, memory=Memory(reading.max_memory))
        clips = read_clips(document)
        laid = LoadedAsset(document, clips).laid(ToolsFile(path=out, tools=()))
    told = "\n".join((f"{out}: {report.summary}", *report.warnings))
    return BakedFile(told, text, document, laid.meshes, {clip.name: clip for clip in clips})
