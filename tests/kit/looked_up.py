"""A fold with contact as a player shows it, beside what the bake shows: weights looked up, or solved and fitted."""

from dataclasses import dataclass

import numpy as np

from kit.player import Gltf
from wrinklecli.baking.baked_body import read_bodies
from wrinklecli.character.clip import clip_grid, read_clips
from wrinklecli.character.rig import read_rig
from wrinklecli.gltf.document import read_document

FPS = 30.0


@dataclass(frozen=True)
class Gap:
    """The difference between player and bake in a fold, in the frame and at the vertex where it is greatest.

    Attributes:
        share: Of the greatest move by contact in the clip.
        time: Seconds.
        largest: That move, bind units.
    """

    share: float
    time: float
    largest: float


def lookup_gaps(file: Gltf, clip: str) -> dict[str, Gap]:
    """The gap of each fold with contact in a clip of a baked file, by the name of the joint that folds.

    Folds in which contact moves nothing in the clip are left out.
    """
    document, gaps = read_document(file.path), {}
    (chosen,) = (each for each in read_clips(document) if each.name == clip)
    for body in read_bodies(document):
        node = file.node(body.node)
        rig, deltas = read_rig(document, node), file.deltas(node)
        times = clip_grid(chosen, rig, fps=FPS)
        played = file.weights(node, clip, times)
        for stored in body.drives:
            if stored.measures_segment:
                continue
            drive = stored.on({name: rig.names.index(name) for name in stored.joints}, rig.morph_names)
            shared = [rig.morph_names.index(name) for name in drive.targets]
            own = [rig.morph_names.index(name) for name in drive.own]
            baked = np.tensordot(played[:, shared + own], deltas[shared + own], axes=1)
            shown = np.tensordot(drive.weights_in(rig, chosen)(times), deltas[shared], axes=1)
            largest = float(np.linalg.norm(baked, axis=2).max())
            apart = np.linalg.norm(shown - baked, axis=2).max(axis=1)
            if largest:
                gaps[stored.name] = Gap(float(apart.max()) / largest, float(times[apart.argmax()]), largest)
    return gaps
