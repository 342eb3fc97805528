// Flesh that swings after a joint: springs in the world, y'' = ω² (c + 2ζ/ω c' - y) - 2ζω y', where c is the joint's
// place, and r = y - c moves the shapes. Each step is exact for a cubic through the last four frames' places, and for the
// path on which a clip takes the joint, where that is known.

import { decay } from './spring.js';

/** Metres per second by which no body changes its speed within a frame: a game has put it elsewhere, or a clip loops. */
const LEAP = 10;
/** The same where a clip's time runs back: a walk of a short step may be put back there. */
const LEAP_ANEW = 2.5;
/** A frame that takes this many times as long as the one before, and so many seconds: the body's way here is unknown. */
const HITCH = 2;
const LONG = 0.05;
/** Radians of a spring in a frame below which places run straight, as higher powers would cancel all digits. */
const STRAIGHT = 0.01;

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const AXES = [0, 1, 2];
const NONE = [0, 0, 0];
/** What is known of the motion of a joint without its clip: see `KeyCurves.during`. */
export const UNKNOWN = { path: [NONE, NONE, NONE, NONE], beside: NONE, back: NONE };

/** A joint's place in the world, its axes of unit length, and its scale over that at rest. */
function carried({ at, scale }, m) {
  const columns = [0, 4, 8].map((k) => [m[k], m[k + 1], m[k + 2]]);
  const [a, b, c] = columns;
  const volume = dot(a, [b[1] * c[2] - b[2] * c[1], b[2] * c[0] - b[0] * c[2], b[0] * c[1] - b[1] * c[0]]);
  const turn = columns.map((column) => column.map((x) => x / (Math.hypot(...column) || 1)));
  const place = AXES.map((i) => a[i] * at[0] + b[i] * at[1] + c[i] * at[2] + m[i + 12]);
  return { place, turn, ratio: Math.cbrt(Math.abs(volume)) / scale };
}

/** Powers of time since the last frame of the cubic through the last moves: the latest first, in `steps` seconds. */
function cubic(moves, steps, i) {
  const [h, h1, h2] = steps;
  const slope = (k) => moves[k][i] / steps[k];
  const bend = (k) => (slope(k) - slope(k + 1)) / (steps[k] + steps[k + 1]);
  const two = moves.length > 1 ? bend(0) : 0;
  const three = moves.length > 2 ? (two - bend(1)) / (h + h1 + h2) : 0;
  return [0, slope(0) - h * two - h * (h1 ?? 0) * three, two + ((h1 ?? 0) - h) * three, three];
}

/** Powers of time of the cubic through four places at even times, from the first to the last; it begins at 0. */
function onward(path, elapsed, i) {
  const [a, b, c, d] = path.map((place) => place[i]);
  const powers = [0, 18 * b - 11 * a - 9 * c + 2 * d, 18 * a - 45 * b + 36 * c - 9 * d, 27 * (b - c) + 9 * (d - a)];
  return powers.map((x, n) => x / 2 / elapsed ** n);
}

/** A spring's state after a frame in which it was drawn to the polynomial of these powers of the frame's fraction. */
function passed([y, u], powers, damping, turns) {
  const answer = [0, 0, 0, 0, 0, 0];
  for (let k = 3; k >= 0; k--)
    answer[k] =
      powers[k] - (2 * damping * (k + 1) * answer[k + 1]) / turns - ((k + 1) * (k + 2) * answer[k + 2]) / turns ** 2;
  const [c, s] = decay(damping, turns);
  const [p, q] = [y - answer[0], u - answer[1] / turns];
  const [end, speed] = [answer[0] + answer[1] + answer[2] + answer[3], answer[1] + 2 * answer[2] + 3 * answer[3]];
  return [end + c * p + s * (q + damping * p), speed / turns + c * q - s * (p + damping * q)];
}

/** The places where springs at rest are: the joint's own, and as far from it as gravity pulls. */
const settled = (modes, place, pull) =>
  modes.map(({ frequency }) => place.map((x, i) => [x + pull[i] / (2 * Math.PI * frequency) ** 2, 0]));

/** Take the state on by a frame that brings the joint to a place: on the clip's path, and beside that on a cubic. */
function advance(state, modes, place, pull, { elapsed, ratio, path, back, anew }) {
  if (!state.springs || !(elapsed >= 0)) {
    Object.assign(state, { springs: settled(modes, place, pull), moves: [], steps: [], place, pull });
    return;
  }
  const [earlier] = state.moves;
  const moved = place.map((x, i) => x - state.place[i] - (path[3][i] - path[0][i]));
  let leap = moved.map((x, i) => x - (earlier ? (earlier[i] * elapsed) / state.steps[0] : 0));
  // In no time nothing moves: the body is put elsewhere. A player may put a walk back, or let it go on.
  const begins = elapsed > 0 && dot(moved, back) > dot(back, back) / 2;
  if (begins) leap = back;
  if (begins || elapsed === 0 || (earlier && Math.hypot(...leap) > (anew ? LEAP_ANEW : LEAP) * ratio * elapsed)) {
    state.place = state.place.map((x, i) => x + leap[i]);
    for (const springs of state.springs) springs.forEach((spring, i) => (spring[0] += leap[i]));
    leap.forEach((x, i) => (moved[i] -= x));
  }
  if (elapsed > 0) {
    const known = elapsed > Math.max(HITCH * state.steps[0], LONG) ? 0 : 2;
    state.moves = [moved, ...state.moves.slice(0, known)];
    state.steps = [elapsed, ...state.steps.slice(0, known)];
    const powers = AXES.map((i) => {
      const ahead = onward(path, elapsed, i);
      return cubic(state.moves, state.steps, i).map((x, n) => x + ahead[n] + (n ? 0 : state.place[i]));
    });
    modes.forEach(({ frequency, damping }, k) => {
      const omega = 2 * Math.PI * frequency;
      const [turns, lag] = [omega * elapsed, (2 * damping) / omega];
      AXES.forEach((i) => {
        const p = powers[i];
        const drawn = [0, 1, 2, 3].map((n) => (p[n] + lag * (n + 1) * (p[n + 1] ?? 0)) * elapsed ** n);
        drawn[0] += state.pull[i] / omega ** 2;
        drawn[1] += (pull[i] - state.pull[i]) / omega ** 2;
        const straight = [drawn[0], drawn[1] + drawn[2] + drawn[3], 0, 0];
        const spring = state.springs[k][i];
        // A body that was already moving when it was first seen had flesh that moved along.
        if (!earlier) spring[1] = p[1] / omega;
        state.springs[k][i] = passed(spring, turns < STRAIGHT ? straight : drawn, damping, turns);
      });
    });
  }
  Object.assign(state, { place, pull });
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
  const { joint, gravity, modes } = fleshExtras;
  const { path, beside, back } = { ...UNKNOWN, ...known };
  const { place: shown, turn, ratio } = carried(fleshExtras, jointMatrixOf(joint));
  const place = shown.map((x, i) => x + beside[i]);
  // Gravity as it was at rest is in the mesh already.
  const pull = AXES.map((i) => -turn[0][i] * gravity[0] - turn[1][i] * gravity[1] - turn[2][i] * gravity[2]);
  pull[1] -= Math.hypot(...gravity);
  const anew = clip === state.clip && time < state.time;
  Object.assign(state, { clip, time });
  advance(state, modes, place, pull, { elapsed, ratio, path, back, anew });
  const numbers = modes.map(({ load, gain }, k) => {
    const moved = state.springs[k].map(([y], i) => y - place[i]);
    return ratio < 1e-6 ? 0 : (gain * dot(load, turn.map((axis) => dot(axis, moved)))) / ratio;
  });
  const length = Math.hypot(...numbers);
  const capped = numbers.map((each) => (length > 0 ? (each * Math.tanh(length)) / length : 0));
  const least = Math.min(0, ...capped);
  return [...capped.map((each) => (each - least) / 2), -least];
}
