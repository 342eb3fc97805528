"""A hand that slides the skin of a touch by the mouse."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from kit.touch import GRIP, SECONDS, plate, touch
from wrinklecli.drive.touch import TouchDrive
from wrinklecli.editor.hand import slide_to
from wrinklecli.editor.session import Session
from wrinklecli.effects.touch.attach import AttachedTouch
from wrinklecli.numeric.arrays import Floats

RISE = 0.05  # metres of the eye above the skin


def session_of(folder: Path, *, bend: float = 0.0, **keys: Any) -> Session:
    (folder / "tools.yaml").write_text(
        yaml.safe_dump({"version": 1, "refinement": {"max_levels": 0}, "touches": [touch(**keys)]})
    )
    return Session(plate(bend=bend).write(folder / "plate.glb"), folder / "tools.yaml")


def ray_to(forward: float, sideways: float, time: float = 0.0, height: float = 0.0) -> tuple[Floats, Floats]:
    """A ray aslant to a place on the plate, as the clip `drag` turns it about +y."""
    angle = 0.25 * np.pi * time / SECONDS
    place, eye = np.array([forward, height, -sideways]), np.array([0.02, RISE, 0.01])
    turn = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
    return turn @ eye, turn @ (place - eye)


def positions(session: Session, time: float) -> Floats:
    (mesh,) = session.meshes("drag", time)
    return mesh.positions


@pytest.mark.slow
def test_skin_that_a_hand_holds_is_where_a_clip_takes_it(tmp_path: Path) -> None:
    """At a slide that the clip has too; whatever the clip does there, the hand's slide is shown."""
    session = session_of(tmp_path)
    session.refine()
    for time, slide in ((0.6, (GRIP, 0.0)), (1.0, (0.0, GRIP))):
        session.hand = None
        clip = positions(session, time)
        hand = session.hold("spot", "drag", time, *ray_to(*slide, time=time))
        assert hand is not None
        assert hand.contact[:2] == pytest.approx(slide, abs=1e-3 * GRIP)
        assert hand.slips
        assert positions(session, time) == pytest.approx(clip, abs=2e-3 * GRIP)
        half = session.hold("spot", "drag", time, *ray_to(-slide[0] / 2, -slide[1] / 2, time=time))
        assert half is not None
        assert not half.slips
        assert np.abs(positions(session, time) - clip).max() > GRIP
    assert session.text == (tmp_path / "tools.yaml").read_text(), "it is no edit"
    session.set_value("spot", ("grip",), GRIP / 2)
    assert positions(session, 1.0) == pytest.approx(positions(session_of(tmp_path, grip=GRIP / 2), 1.0), abs=1e-9)


def test_skin_springs_back_and_is_forgotten_then(tmp_path: Path) -> None:
    session = session_of(tmp_path, release={"frequency": 4, "damping": 0.7})
    hand = session.hold("spot", None, 0.0, *ray_to(GRIP, 0.0))
    assert hand is not None
    slides = []
    for seconds in np.linspace(0.0, 1.0, 101).tolist():
        left = hand.let_go(seconds)
        slides.append(0.0 if left is None else float(left.contact[0]))
        assert left is None or left.contact[2] >= 0.0
    assert slides[0] == pytest.approx(GRIP, rel=1e-3)
    assert min(slides) == pytest.approx(-GRIP * np.exp(-np.pi * 0.7 / np.sqrt(1 - 0.7**2)), rel=0.05), "it overshoots"
    gone = slides.index(0.0)
    assert 0.1 < 0.01 * gone < 0.6
    assert max(map(abs, slides[gone - 2 : gone])) < 0.02 * GRIP


def test_what_is_no_touch_is_not_held(tmp_path: Path) -> None:
    session = session_of(tmp_path)
    assert session.hold("other", None, 0.0, *ray_to(GRIP, 0.0)) is None
    origin, direction = ray_to(GRIP, 0.0)
    assert session.hold("spot", None, 0.0, -origin, -direction) is None, "from below the skin"
    assert session.hold("spot", None, 0.0, origin, -direction) is None, "away from it"
    assert session.hand is None


@pytest.mark.quick(1)
@pytest.mark.parametrize("slide", [(0.004, 0.003), (-0.006, 0.001), (0.0, -0.008)])
def test_a_ray_meets_curved_skin_where_it_is(tmp_path: Path, slide: tuple[float, float]) -> None:
    session = session_of(tmp_path, bend=20.0)
    (below,) = session.attached().values()
    assert isinstance(below.attached, AttachedTouch)
    drive: TouchDrive = below.attached.drive
    assert drive.places[0].bend[0] == pytest.approx(-10.0, rel=0.1)
    height = float(drive.places[0].bend @ [slide[0] ** 2, slide[0] * slide[1], slide[1] ** 2])
    found = slide_to(drive, below.ground.rig.own, None, 0.0, *ray_to(*slide, height=height))
    assert found == pytest.approx(slide, abs=1e-6)


@pytest.mark.quick(1)
@pytest.mark.parametrize(
    ("start", "way"), [((0, 0, 0.01), (1, 0, 0)), ((0, 0, 0.01), (0, 0, 1)), ((0, 0, -0.01), (0, 0, -1))]
)
def test_a_ray_along_the_skin_away_or_from_below_meets_nothing(
    tmp_path: Path, start: tuple[float, ...], way: tuple[float, ...]
) -> None:
    (below,) = session_of(tmp_path).attached().values()
    assert isinstance(below.attached, AttachedTouch)
    drive, rig = below.attached.drive, below.ground.rig.own
    (middle,), (axes,), _, _ = drive.axes_in(rig, None, np.zeros(1))
    assert slide_to(drive, rig, None, 0.0, middle + axes @ start, axes @ way) is None
