"""A fit to the skin of a touch holds for skin that is refined alike, and for no other."""

from typing import Any

import numpy as np
import pytest

from kit.bakes import place
from kit.touch import plate, touch
from wrinklecli.baking.job import BakeOptions, read_job
from wrinklecli.baking.plan import plan_meshes
from wrinklecli.effects.touch import attach
from wrinklecli.effects.touch.disc import Disc
from wrinklecli.effects.touch.layer import TouchLayer
from wrinklecli.effects.touch.skin import Place


def fold(x: float) -> dict[str, Any]:
    return {"name": f"fold{x}", "origin": [x, 0, -0.01], "target": [x, 0, 0.01], "width": 0.02, "bumps": 2}


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize(("tools", "fits"), [([], 1), ([fold(0.15)], 1), ([fold(0.06)], 2)])
def test_skin_is_fitted_once_unless_a_tool_refines_it_too(
    tools: list[Any], fits: int, tmp_path: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls, fit = [], attach._deltas

    def counted(*arguments: Any) -> Any:
        calls.append(arguments)
        return fit(*arguments)

    monkeypatch.setattr(attach, "_deltas", counted)
    file = tmp_path / "tools.yaml"
    file.write_text(str({"version": 1, "touches": [touch()], **({"tools": tools} if tools else {})}))
    (plan,) = plan_meshes(read_job(place(plate(size=0.36, cells=36)), file, BakeOptions(max_levels=2)))
    assert len(calls) == fits
    layer = plan.layer(TouchLayer)
    assert layer is not None
    (spot,) = layer.attached
    # Whichever it was, it is what a fit to all of this skin gives.
    assert layer.deltas[0] == pytest.approx(fit(spot.places[0], spot.drive, plan.fine), abs=1e-9 * spot.drive.grip)
    assert np.abs(layer.deltas[0]).max() > 0.5 * spot.drive.grip


def test_a_disc_has_the_coordinates_of_its_two_diameters() -> None:
    random = np.random.default_rng(1)
    axes = np.linalg.qr(random.normal(size=(3, 3)))[0]
    at, points = random.normal(size=3), random.normal(size=(9, 3))
    nothing: Any = None
    for disc in Disc(Place(at, axes, 0.1, 0.2), 0.3, 4.0, 1.0, nothing, nothing).both:
        (u, v), line = disc.coordinates(points), disc.path.locate(points)
        assert u == pytest.approx(line.u)
        assert np.abs(v) == pytest.approx(np.abs(line.across) / disc.half_width)
