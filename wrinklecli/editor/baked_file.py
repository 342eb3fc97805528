"""Bake the saved tools as `wrinkle bake` does, and play the written file."""

import os

from wrinklecli.baking.job import BakeOptions
from wrinklecli.baking.pipeline import bake
from wrinklecli.character.clip import Clip, read_clips
from wrinklecli.editor.asset import LoadedAsset, ReadOptions
from wrinklecli.editor.attached import PlayableMesh, ShownMesh
from wrinklecli.editor.clip_cache import RecentResults
from wrinklecli.editor.session import Session
from wrinklecli.effects.kept import solutions_in
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.document import Document, read_document
from wrinklecli.numeric.guard import Progress, guarded, log_progress
from wrinklecli.numeric.memory import Memory
from wrinklecli.tools.records import ToolsFile


@dataclass(frozen=True, slots=True)
class BakedFile:
    """A baked file, read again, with lines about the bake and the text of the tools file that was baked.

    The wrinkles of its meshes (`sources`) are morph targets. `label` says what it is, on the page.
    """

    summary: str
    text: str
    document: Document
    sources: tuple[PlayableMesh, ...]
    clips: dict[str, Clip]
    label: str = "baked file"

    @classmethod
    def read(cls, path: str, options: ReadOptions, summary: str, text: str, label: str = "baked file") -> "BakedFile":
        """Read a file that was baked from a text.

        Raises:
            WrinkleError: The file cannot be read.
        """
        with guarded(path):
            memory = Memory(options.max_memory)
            document = read_document(path, allow_external=options.allow_external, memory=memory)
            clips = read_clips(document)
            attached = LoadedAsset(document, clips).attach(ToolsFile(path=path))
        return cls(summary, text, document, attached.meshes, {clip.name: clip for clip in clips}, label)

    def plays(self, clip: str | None) -> bool:
        """True if the file has a clip, or None is asked for: the stored pose. Clips that `wrinkle` made up are not."""
        return clip is None or clip in self.clips

    def meshes(self, clip: str | None, time: float) -> list[ShownMesh]:
        """All meshes at a time of a clip, seconds, as the file plays it."""
        played = None if clip is None else self.clips[clip]
        return [ShownMesh(each, each.posed(played, time)) for each in self.sources]


@dataclass(frozen=True, slots=True)
class _Solutions:
    """A store in memory: the next bake of a session solves no fold and no flesh again that has not changed."""

    results: RecentResults

    def find(self, key: str, _most: int) -> bytes | None:
        """The solution of a key; None if there is none."""
        data: bytes | None = self.results.get(key)
        return data

    def keep(self, key: str, data: bytes) -> None:
        """Keep a solution."""
        self.results.get_or_make(key, lambda: data)

    def refuse(self, _key: str, reason: str) -> None:
        """Nothing damages them."""
        raise AssertionError(reason)


def bake_saved(session: Session, progress: Progress = log_progress) -> BakedFile:
    """Bake the saved tools file of a session into the file's folder. The session may be used meanwhile.

    Raises:
        WrinkleError: The bake fails.
    """
    options, asset = session.read_options, os.path.splitext(os.path.basename(session.asset))[0]
    out, text = os.path.join(os.path.dirname(session.path), f"{asset}_wrinkled.glb"), session.saved_text
    bake_options = BakeOptions(
        anims=options.anims,
        allow_external=options.allow_external,
        max_memory=options.max_memory,
        replace=True,  # the editor too shows the original of a baked asset
    )
    with solutions_in(_Solutions(session.solutions)):
        report = bake(session.asset, session.path, out, bake_options, progress=progress)
    return BakedFile.read(out, options, "\n".join((f"{out}: {report.summary}", *report.warnings)), text)
