// Flesh that swings after a joint: springs n'' + 2ζω n' + ω² n = w · (g - c''), where c is the joint's place. A frame is cut
// into steps of a 360th of a second or less, in which c runs straight: along the path on which a clip takes the joint, where
// that is known, and beside that on the cubic through the last four frames. All springs together keep within a limit of 1.

import { atRest, limited, swung } from './swing.js';

/** Metres per second by which no body changes its speed within a frame: a game has put it elsewhere, or a clip loops. */
const LEAP = 10;
/** The same where a clip's time runs back: a walk of a short step may be put back there. */
const LEAP_ANEW = 2.5;
/** A frame that takes this many times as long as the one before, and so many seconds: the body's way here is unknown. */
const HITCH = 2;
const LONG = 0.05;
/** Steps per second, at least. */
const STEPS = 360;

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const AXES = [0, 1, 2];
const NONE = [0, 0, 0];
/** What is known of the motion of a joint without its clip: see `KeyCurves.during`. */
export const UNKNOWN = { path: () => NONE, beside: NONE, back: NONE };

/** A joint's place in the world, its axes of unit length, and its scale over that at rest. */
function carried({ at, scale }, m) {
  const columns = [0, 4, 8].map((k) => [m[k], m[k + 1], m[k + 2]]);
  const [a, b, c] = columns;
  const volume = dot(a, [b[1] * c[2] - b[2] * c[1], b[2] * c[0] - b[0] * c[2], b[0] * c[1] - b[1] * c[0]]);
  const turn = columns.map((column) => column.map((x) => x / (Math.hypot(...column) || 1)));
  const place = AXES.map((i) => a[i] * at[0] + b[i] * at[1] + c[i] * at[2] + m[i + 12]);
  return { place, turn, ratio: Math.cbrt(Math.abs(volume)) / scale };
}

/** How the springs are moved by a joint of these axes and this scale: by mode w, in the world, and the place of rest. */
function moving({ gravity, modes }, turn, ratio) {
  const shown = ratio < 1e-6 ? 0 : 1 / ratio;
  // Gravity as it was at rest is in the mesh already.
  const pull = AXES.map((i) => -turn[0][i] * gravity[0] - turn[1][i] * gravity[1] - turn[2][i] * gravity[2]);
  pull[1] -= Math.hypot(...gravity);
  const ways = modes.map(({ load, gain }) => AXES.map((i) => gain * shown * dot(load, turn.map((axis) => axis[i]))));
  return { ways, loads: ways.map((way, k) => dot(way, pull) / (2 * Math.PI * modes[k].frequency) ** 2) };
}

const blend = (from, to, part) => from.map((x, i) => x + part * (to[i] - x));

/** Powers of time since the last frame of the cubic through the last moves: the latest first, in `steps` seconds. */
function cubic(moves, steps, i) {
  const [h, h1, h2] = steps;
  const slope = (k) => moves[k][i] / steps[k];
  const bend = (k) => (slope(k) - slope(k + 1)) / (steps[k] + steps[k + 1]);
  const two = moves.length > 1 ? bend(0) : 0;
  const three = moves.length > 2 ? (two - bend(1)) / (h + h1 + h2) : 0;
  return [0, slope(0) - h * two - h * (h1 ?? 0) * three, two + ((h1 ?? 0) - h) * three, three];
}

/** Take the state on by a frame that brings the joint to a place: on the clip's path, and beside that on a cubic. */
function advance(state, modes, place, { ways, loads }, { elapsed, ratio, path, back, anew }) {
  const begin = { place, ways, loads };
  if (!state.swing || !(elapsed >= 0)) {
    Object.assign(state, begin, { swing: atRest(loads), moves: [], steps: [], velocity: null });
    return;
  }
  const [earlier] = state.moves;
  const [first, last] = [path(0), path(1)];
  const moved = place.map((x, i) => x - state.place[i] - (last[i] - first[i]));
  let leap = moved.map((x, i) => x - (earlier ? (earlier[i] * elapsed) / state.steps[0] : 0));
  // In no time nothing moves: the body is put elsewhere. A player may put a walk back, or let it go on.
  const begins = elapsed > 0 && dot(moved, back) > dot(back, back) / 2;
  if (begins) leap = back;
  if (begins || elapsed === 0 || (earlier && Math.hypot(...leap) > (anew ? LEAP_ANEW : LEAP) * ratio * elapsed))
    leap.forEach((x, i) => (moved[i] -= x));
  if (elapsed > 0) {
    const known = elapsed > Math.max(HITCH * state.steps[0], LONG) ? 0 : 2;
    state.moves = [moved, ...state.moves.slice(0, known)];
    state.steps = [elapsed, ...state.steps.slice(0, known)];
    const powers = AXES.map((i) => cubic(state.moves, state.steps, i));
    const count = Math.max(Math.ceil(STEPS * elapsed - 1e-6), 1);
    const span = elapsed / count;
    let [here, { velocity }] = [NONE, state];
    for (let step = 0; step < count; step++) {
      const [before, along] = [step / count, path((step + 1) / count)];
      const t = span * (step + 1);
      const there = AXES.map((i) => along[i] - first[i] + t * (powers[i][1] + t * (powers[i][2] + t * powers[i][3])));
      const ahead = there.map((x, i) => (x - here[i]) / span);
      // A body that was already moving when it was first seen had flesh that moved along.
      const kick = ahead.map((x, i) => (velocity ?? ahead)[i] - x);
      const kicks = modes.map(({ frequency }, k) => dot(blend(state.ways[k], ways[k], before), kick) / (2 * Math.PI * frequency));
      state.swing = swung(state.swing, modes, kicks, blend(state.loads, loads, before), span);
      [here, velocity] = [there, ahead];
    }
    state.velocity = velocity;
  }
  Object.assign(state, begin);
}

/**
 * The weights of a region's morph targets, in the order of `fleshExtras.targets`.
 *
 * fleshExtras    one of `extras.wrinkle.flesh`
 * jointMatrixOf  a joint's name to its matrix to world space: 16 numbers, by columns
 * state          of the region, kept from call to call: an object, {} to begin with, at rest
 * elapsed        seconds since the last call; where it is not known, flesh is at rest
 * clip, time     name and seconds, to know where a clip begins anew
 * known          `path`, `beside` and `back`, where a clip's motion is known: see `KeyCurves.during`
 */
export function fleshWeights(fleshExtras, jointMatrixOf, { state = {}, elapsed, clip, time, ...known } = {}) {
  const { path, beside, back } = { ...UNKNOWN, ...known };
  const { place: shown, turn, ratio } = carried(fleshExtras, jointMatrixOf(fleshExtras.joint));
  const place = shown.map((x, i) => x + beside[i]);
  const anew = clip === state.clip && time < state.time;
  Object.assign(state, { clip, time });
  advance(state, fleshExtras.modes, place, moving(fleshExtras, turn, ratio), { elapsed, ratio, path, back, anew });
  const numbers = limited(state.swing[0]).map((each) => (ratio < 1e-6 ? 0 : each));
  const least = Math.min(0, ...numbers);
  return [...numbers.map((each) => (each - least) / 2), -least];
}
