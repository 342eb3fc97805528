"""Contact resolved on demand: what it shows is what a bake writes, and it can be cancelled."""

import multiprocessing
import time
from pathlib import Path
from queue import Queue

import numpy as np
import pytest

pytest.importorskip("ipctk", reason="needs the extra `contact`")

import wrinklecli
from kit.folds import CLIP, elbow
from kit.player import Gltf
from kit.work import PATIENCE
from wrinklecli.editor.baked_file import BakedFile
from wrinklecli.editor.contact_trial import ContactTrial, RunningTrial, trial_of
from wrinklecli.editor.free_pose import POSE, FreePose
from wrinklecli.editor.session import Session
from wrinklecli.errors import WrinkleError
from wrinklecli.numeric.guard import log_progress


def solved(trial: ContactTrial) -> BakedFile:
    """The outcome of a trial, once it is done."""
    found: Queue[BakedFile | WrinkleError] = Queue()
    RunningTrial(trial, log_progress, found.put)
    result = found.get(timeout=PATIENCE)
    assert isinstance(result, BakedFile), result
    return result


def trial(session: Session, clip: str) -> ContactTrial:
    (tool,) = session.tools()
    return trial_of(session, tool, clip)


@pytest.mark.slow
@pytest.mark.long
def test_it_shows_what_a_bake_writes(tmp_path: Path) -> None:
    asset, tools = elbow().write(tmp_path, contact="resolve")
    shown = solved(trial(Session(asset, tools), CLIP))
    wrinklecli.bake(asset, tools, tmp_path / "out.glb")
    (mesh,) = shown.meshes(CLIP, 1.0)
    (baked,) = Gltf(tmp_path / "out.glb").pose("limb", CLIP, [1.0])
    assert np.abs(mesh.positions - np.unique(baked, axis=0)[:, None]).sum(axis=2).min(axis=0).max() < 1e-5
    assert shown.plays(CLIP)
    assert not shown.plays("another clip")


@pytest.mark.slow
@pytest.mark.long
def test_a_pose_by_hand_is_resolved(tmp_path: Path) -> None:
    session = Session(*elbow().write(tmp_path, contact="resolve"))
    session.take_pose(FreePose().with_turn("forearm", "z", 100.0))
    shown = solved(trial(session, POSE))
    (mesh,), (edited,) = shown.meshes(POSE, 0.0), session.meshes(POSE, 0.0)
    apart = np.abs(mesh.positions[:, None] - edited.positions).sum(axis=2).min(axis=0)
    assert apart.max() > 0.002
    assert (apart < 1e-6).mean() > 0.2


@pytest.mark.slow
def test_cancel_ends_its_process(tmp_path: Path) -> None:
    session = Session(*elbow().write(tmp_path, contact="resolve"))
    found: list[object] = []
    running = RunningTrial(trial(session, CLIP), log_progress, found.append)
    (process,) = multiprocessing.active_children()
    time.sleep(0.5)
    running.cancel()
    assert not process.is_alive()
    assert not found
