"""Contact in a fold: a surface that touches itself and never crosses, marched from rest through a bend.

The wrinkled, posed surface is what skinning asks for; the surface found is the nearest one to it that keeps apart:

    min over x of ½ Σ m |c|² + ½ ℓ² |∇c|² + ½ ℓ⁴ |Δc|² + ½ p ΔV² + κ/d̂³ B(x; d̂, d_min),   c = x − posed and wrinkled,

with B the barrier of all pairs nearer than d̂ + d_min, and ΔV what c takes away of the volume below. The rest pose
crosses nothing, and no step lets anything pass through: so none ever crosses, however far skinning folds the surface
through itself. Other meshes are of the same system, but so stiff that they give way only where they pass through
themselves and would leave no room.

Source: M. Li et al., *Incremental Potential Contact*, SIGGRAPH 2020, by its library ipctk. Differs: quasi-static, no
friction, no material: what resists is the correction c, so nothing moves where nothing touches.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from wrinklecli.effects.contact.response import Held, Pressed
from wrinklecli.effects.contact.tissue import Posed, State, Tissue
from wrinklecli.numeric.arrays import Floats, inverses

# Newton's steps of a frame at most, and the length of a step that ends them, solver's units: two fifths of the gap.
# Where nothing touches any more all goes back to its pose.
_STEPS, _SETTLED, _STILL = 32, 0.4, 0.001
# What is not free is in its place, up to rounding.
_ARRIVED = 1e-9
# Solver's units that a step moves anything by at most: further, hardly one is free, and more has to be looked at.
_FARTHEST = 4.0
# Halvings of a step that does not lower the energy.
_HALVINGS = 12


def march(tissue: Tissue, poses: Iterable[Posed], start: State | None = None) -> Iterator[State]:
    """Follow poses one after another, each begun from the correction of the one before, carried by the skin.

    Args:
        tissue: The surface.
        poses: Near enough to each other for the surface to follow.
        start: Where it begins; the first pose, which crosses nothing, where left out.
    """
    state = start
    for posed in poses:
        state = State(posed.positions, posed) if state is None else _step(tissue, state, posed)
        yield state


def _step(tissue: Tissue, state: State, posed: Posed) -> State:
    """Move to the next pose."""
    carried, correction = np.zeros_like(posed.positions), state.correction
    rows = np.flatnonzero(correction.any(axis=1))
    turns = posed.matrices[rows] @ inverses(state.posed.matrices[rows])
    carried[rows] = np.einsum("vij,vj->vi", turns, correction[rows])
    wanted = posed.positions + carried
    if carried.any() and np.abs(wanted - state.positions).max() > _FARTHEST:
        # What touches hardly moves on a straight way.
        return _newton(tissue, state.positions, posed, tissue.collisions(state.positions))
    way = tissue.way(state.positions, wanted)
    share = way.free_share()
    positions = state.positions + share * (wanted - state.positions)
    near = way.near(positions)
    if share >= 1.0 and not len(near) and not carried.any():
        return State(positions, posed)
    return _newton(tissue, positions, posed, near)


def _newton(tissue: Tissue, positions: Floats, posed: Posed, near: Any) -> State:
    """Lower the energy by projected Newton steps, none of which lets anything pass through anything."""
    wanted = _Wanted(posed.positions, tissue.pieces.volumes(posed.positions))
    energy = _energy(tissue, positions, wanted, near)
    settled = False
    held = ~tissue.free
    for _ in range(_STEPS):
        direction, slope = _direction(tissue, positions, wanted, near)
        arriving = np.abs((posed.positions - positions)[held]).max(initial=0.0) > _ARRIVED
        if not arriving and np.abs(direction).max() < (_SETTLED if len(near) else _STILL):
            settled = True
            break
        part = _FARTHEST / max(float(np.abs(direction).max()), _FARTHEST)
        way = tissue.way(positions, positions + part * direction)
        share = part * way.free_share()
        for _halving in range(_HALVINGS):
            trial = positions + share * direction
            trial_near = way.near(trial)
            trial_energy = _energy(tissue, trial, wanted, trial_near)
            if trial_energy <= energy + 1e-4 * share * slope or (arriving and trial_energy < energy):
                break
            share /= 2.0
        else:
            break
        positions, near, energy = trial, trial_near, trial_energy
    if settled:
        if not len(near):
            # To the bit: where nothing touches any more, contact moves nothing.
            return State(posed.positions, posed)
        positions = np.where(held[:, None], posed.positions, positions)
    return State(positions, posed, settled, near)


@dataclass(frozen=True, slots=True)
class _Wanted:
    """What a pose asks for.

    Attributes:
        positions: (vertices, 3) solver's units.
        volumes: (pieces,) under them.
    """

    positions: Floats
    volumes: Floats


def _energy(tissue: Tissue, positions: Floats, wanted: _Wanted, near: Any) -> float:
    correction = positions - wanted.positions
    elastic = 0.5 * float(np.sum(correction * (tissue.stiffness @ correction)))
    pressed = 0.5 * float(tissue.pressures @ (tissue.pieces.volumes(positions) - wanted.volumes) ** 2)
    return elastic + pressed + float(tissue.barrier(near, tissue.mesh, tissue.placed(positions)))


def _direction(tissue: Tissue, positions: Floats, wanted: _Wanted, near: Any) -> tuple[Floats, float]:
    """(vertices, 3) Newton's step, which takes what is not free to its place, and the slope of the energy along it."""
    free, touching = tissue.free, tissue.rows
    correction = positions - wanted.positions
    barrier = tissue.gradient(near, positions)
    direction = np.where(free[:, None], 0.0, -correction)
    gradients = tissue.pieces.gradients(positions)
    more = tissue.pieces.volumes(positions) - wanted.volumes
    pressed = Pressed(
        gradients[:, free],
        tissue.gives(gradients[:, free]),
        tissue.pressures,
        more - np.tensordot(gradients, correction, axes=2),
    )
    hessian = tissue.hessian(near, positions)
    numbers = np.flatnonzero(np.diff(hessian.indptr).reshape(-1, 3).any(axis=1) & free[touching])
    coordinates, rows = (3 * numbers[:, None] + np.arange(3)).reshape(-1), touching[numbers]
    held = Held(
        (np.cumsum(free) - 1)[rows],
        -barrier[rows] - (hessian[coordinates] @ direction[touching].reshape(-1)).reshape(-1, 3),
        hessian[coordinates][:, coordinates],
        correction[rows],
    )
    direction[free] = tissue.response.settled(held, pressed) - correction[free]
    gradient = tissue.stiffness @ correction + np.tensordot(tissue.pressures * more, gradients, axes=1) + barrier
    return direction, float(np.sum(gradient * direction))
