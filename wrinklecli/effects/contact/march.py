"""March a surface from rest through a bend so that it touches itself and never crosses.

Skinning asks for a wrinkled, posed surface; the solver finds the nearest surface to it that keeps apart:

    min over x of ½ Σ m |c|² + ½ ℓ² |∇c|² + ½ ℓ⁴ |Δc|² + ½ p ΔV² + κ/d̂³ B(x; d̂, d_min),   c = x − skinned positions,

where B is the barrier of all pairs nearer than d̂ + d_min, and ΔV the change of volume by c. The rest pose crosses
nothing, and no step lets anything pass through, so the surface never crosses, however far skinning folds it through
itself. Other meshes belong to the same system, but are so stiff that they give way only where they pass through
themselves and would leave no room.

Source: M. Li et al., *Incremental Potential Contact*, SIGGRAPH 2020, by its library ipctk. Differs: quasi-static, no
friction, no material: only the correction c itself resists, so nothing moves where nothing touches.
"""

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from wrinklecli.effects.contact.response import ContactForces, Response, VolumeForces
from wrinklecli.effects.contact.tissue import SkinnedPose, SolverState, Tissue
from wrinklecli.numeric.arrays import Bools, Floats, inverses

# Newton steps per pose, at most.
_STEPS = 32
# A step shorter than this ends a pose, solver's units: two fifths of the gap,
_SETTLED = 0.4
# or this where nothing is near any more and all vertices go back to their pose.
_SETTLED_APART = 0.001
# A whole step in which nothing that touches before or after it moves further than this, solver's units, ends a pose,
# too. The next direction would take as long as this one. With the barrier's gap of 0.7, a tube in a sleeve took one way
# in a clip and another in the motion of its joint, and players differed from the bake by half of contact; with 0.4,
# two hips take a target more.
_FOLLOWED = 0.45
# Vertices that are not free are in their places within this distance, solver's units: rounding.
_ARRIVED = 1e-9
# Longest movement of a touching vertex in a step, solver's units: twice both gaps. With 4, hips kept crossings.
_FARTHEST_TOUCHING = 2.0
# Longest movement of any other vertex, which has nothing in its way, solver's units: half of a limb's radius.
_FARTHEST = 32.0
# Longest movement to a pose that is tried without a look at what touches, solver's units: a longer one is hardly ever
# free.
_STRAIGHT = 4.0
# Halvings of a step that does not lower the energy, at most.
_HALVINGS = 12
# Fraction of the first-order decrease in energy that a step must reach (Armijo).
_DECREASE = 1e-4


def march(
    tissue: Tissue,
    poses: Iterable[SkinnedPose],
    start: SolverState | None = None,
    response: Response | None = None,
) -> Iterator[SolverState]:
    """Solve poses one after another, each from the correction of the one before, which the skin carries along.

    Poses must be near enough to each other for the surface to follow. Without a start, the first pose begins the march
    and must cross nothing. A `response` knows what touched before.
    """
    state, response = start, response or tissue.response()
    for posed in poses:
        state = SolverState(posed.positions, posed) if state is None else _solve(tissue, response, state, posed)
        yield state


def _solve(tissue: Tissue, response: Response, state: SolverState, posed: SkinnedPose) -> SolverState:
    """Move to the next pose."""
    carried, correction = np.zeros_like(posed.positions), state.correction
    rows = np.flatnonzero(correction.any(axis=1))
    turns = posed.matrices[rows] @ inverses(state.posed.matrices[rows])
    carried[rows] = np.einsum("vij,vj->vi", turns, correction[rows])
    wanted = posed.positions + carried
    if carried.any() and np.abs(wanted - state.positions).max() > _STRAIGHT:
        return _newton(tissue, response, state.positions, posed, tissue.collisions(state.positions))
    fraction = tissue.free_fraction(state.positions, wanted)
    positions = state.positions + fraction * (wanted - state.positions)
    near = tissue.collisions(positions)
    if fraction >= 1.0 and not len(near) and not carried.any():
        # Exactly the pose: the way there and back rounds.
        return SolverState(posed.positions, posed)
    return _newton(tissue, response, positions, posed, near)


def _newton(tissue: Tissue, response: Response, positions: Floats, posed: SkinnedPose, near: Any) -> SolverState:
    """Lower the energy by projected Newton steps, none of which lets anything pass through anything."""
    volumes = tissue.pieces.volumes(posed.positions)
    energy = _energy(tissue, positions, posed, volumes, near)
    settled, steps = False, 0
    held = ~tissue.free
    for _ in range(_STEPS):
        steps += 1
        direction, slope = _direction(tissue, response, positions, posed, volumes, near)
        arriving = np.abs((posed.positions - positions)[held]).max(initial=0.0) > _ARRIVED
        if not arriving and np.abs(direction).max() < (_SETTLED if len(near) else _SETTLED_APART):
            settled = True
            break
        touching = _touching(tissue, near, positions)
        # The part of a step, along (vertices, 3) directions, that moves no vertex too far; some are touching.
        lengths = np.abs(direction).max(axis=1) / np.where(touching, _FARTHEST_TOUCHING, _FARTHEST)
        part = 1.0 / max(float(lengths.max()), 1.0)
        fraction = part * tissue.free_fraction(positions, positions + part * direction)
        for _halving in range(_HALVINGS):
            # Vertices that are not free go to their places even if the energy rises.
            trial = positions + fraction * direction
            trial_near = tissue.collisions(trial)
            trial_energy = _energy(tissue, trial, posed, volumes, trial_near)
            if arriving or trial_energy <= energy + _DECREASE * fraction * slope:
                break
            fraction /= 2.0
        else:
            break
        followed = fraction >= 1.0 and len(trial_near) > 0
        if followed:
            touching |= _touching(tissue, trial_near, trial)
            followed = float(np.abs(direction[touching]).max(initial=0.0)) < _FOLLOWED
        positions, near, energy = trial, trial_near, trial_energy
        if followed:
            settled = True
            break
    if settled:
        if not len(near):
            # Exactly the pose: where nothing touches any more, contact moves nothing.
            return SolverState(posed.positions, posed, steps=steps)
        positions = np.where(held[:, None], posed.positions, positions)
    return SolverState(positions, posed, settled, steps, near)


def _touching(tissue: Tissue, near: Any, positions: Floats) -> Bools:
    """(vertices,) True for vertices that the barrier pushes at (vertices, 3) positions."""
    return np.asarray(tissue.gradient(near, positions).any(axis=1))


def _energy(tissue: Tissue, positions: Floats, posed: SkinnedPose, volumes: Floats, near: Any) -> float:
    """The energy of (vertices, 3) positions; `volumes` are (pieces,) under the skinned positions."""
    correction = positions - posed.positions
    elastic = 0.5 * float(np.sum(correction * (tissue.stiffness @ correction)))
    pressed = 0.5 * float(tissue.pressures @ (tissue.pieces.volumes(positions) - volumes) ** 2)
    return elastic + pressed + float(tissue.barrier(near, tissue.mesh, tissue.placed(positions)))


def _direction(
    tissue: Tissue, response: Response, positions: Floats, posed: SkinnedPose, volumes: Floats, near: Any
) -> tuple[Floats, float]:
    """(vertices, 3) Newton step, which takes vertices that are not free to their places, and the energy's slope."""
    free, touching = tissue.free, tissue.rows
    correction = positions - posed.positions
    barrier = tissue.gradient(near, positions)
    direction = np.where(free[:, None], 0.0, -correction)
    gradients = tissue.pieces.gradients(positions)
    excess = tissue.pieces.volumes(positions) - volumes
    resisting = VolumeForces(
        gradients[:, free],
        tissue.moves_under(gradients[:, free]),
        tissue.pressures,
        excess - np.tensordot(gradients, correction, axes=2),
    )
    hessian = tissue.hessian(near, positions)
    numbers = np.flatnonzero(np.diff(hessian.indptr).reshape(-1, 3).any(axis=1) & free[touching])
    coordinates, rows = (3 * numbers[:, None] + np.arange(3)).reshape(-1), touching[numbers]
    hessian = hessian[coordinates]
    contacts = ContactForces(
        (np.cumsum(free) - 1)[rows],
        -barrier[rows] - (hessian @ direction[touching].reshape(-1)).reshape(-1, 3),
        hessian[:, coordinates],
        correction[rows],
    )
    direction[free] = response.equilibrium(contacts, resisting) - correction[free]
    if not np.isfinite(direction).all():
        raise FloatingPointError("a step of contact is no number")
    gradient = tissue.stiffness @ correction + np.tensordot(tissue.pressures * excess, gradients, axes=1) + barrier
    return direction, float(np.sum(gradient * direction))
