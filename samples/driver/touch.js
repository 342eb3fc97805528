// A tip that slides the skin: keyed by a clip, followed as it comes near, or asked for by the player.

import { anchor } from './anchor.js';
import { between } from './polyline.js';
import { decay } from './spring.js';

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];

const clamp = (x, low, high) => Math.min(Math.max(x, low), high);
/** A touch's places: its own, and the further ones of its row; and the row's length, scene units. */
const placesOf = (extras) => [extras, ...(extras.row ?? [])];
const lengthOf = ({ row = [], spacing = 0 }) => row.length * spacing;

/** The shares of a touch's places at a distance along its row: those of two neighbours sum to 1. */
function sharesAt(extras, along) {
  const passed = clamp(along, 0, lengthOf(extras)) / (extras.spacing ?? 1);
  return placesOf(extras).map((_, k) => Math.max(1 - Math.abs(passed - k), 0));
}

/**
 * Where a place of the world is, forward, sideways and above the skin of a touch, scene units at rest. Forward is along
 * the row of a touch that travels.
 *
 * What a player's own tip moves along the skin, the difference of two such places, is what `driver.touch` takes. Infinitely
 * far away where the skin is scaled to nothing.
 */
export function placeOnSkin(extras, place, jointMatrixOf, morphWeightOf = () => 0) {
  const { pad, row = [], spacing = 0 } = extras;
  const each = placesOf(extras).map((own) => placeAt(own, pad, place, jointMatrixOf, morphWeightOf));
  if (each.some(([forward]) => forward === Infinity)) return [Infinity, Infinity, Infinity];
  const along = row.reduce((sum, _, k) => sum + clamp(each[k][0], 0, spacing), 0);
  const shares = sharesAt(extras, along);
  return [spacing, 0, 0].map((step, i) => each.reduce((sum, own, k) => sum + shares[k] * (own[i] + k * step), 0));
}

function placeAt({ anchors, bend }, pad, place, jointMatrixOf, morphWeightOf) {
  const [middle, ...ends] = anchors.map((each) => anchor(each, jointMatrixOf, morphWeightOf).place);
  const [a, b, c] = ends.map((end) => end.map((x, i) => x - middle[i]));
  const way = place.map((x, i) => x - middle[i]);
  const volume = dot(a, cross(b, c)) / pad;
  if (!(Math.abs(volume) >= 1e-18 * pad ** 2)) return [Infinity, Infinity, Infinity];
  const [f, s, h] = [cross(b, c), cross(c, a), cross(a, b)].map((normal) => dot(way, normal) / volume);
  return [f, s, h - bend[0] * f * f - bend[1] * f * s - bend[2] * s * s];
}

/** The sine of the bend of the limb beyond a touch's joint, towards the skin. */
function bendOf({ anchors, limb }, jointMatrixOf, morphWeightOf) {
  const placed = (each) => anchor(each, jointMatrixOf, morphWeightOf).place;
  const [middle, ...ends] = anchors.map(placed);
  const [a, b, c] = ends.map((end) => end.map((x, i) => x - middle[i]));
  const [from, to] = limb.map(placed);
  const volume = dot(a, cross(b, c));
  const sine = volume && dot(to.map((x, i) => x - from[i]), cross(a, b)) / volume;
  return Math.min(Math.max(sine, -1), 1);
}

/** What is left of a slide so many seconds after the tip has let go. */
function remaining({ frequency, damping }, seconds) {
  const [c, s] = decay(damping, 2 * Math.PI * frequency * Math.max(seconds, 0));
  return c + damping * s;
}

/** The slide, the depth, and how far along the row, now: keyed, asked for, of the tip, or what is left of the last. */
function contact(extras, { jointMatrixOf, morphWeightOf, clip, time, state, elapsed, hand }) {
  const { keys, by, ends = {}, pad, grip, deepest, release } = extras;
  const rows = keys?.[clip];
  if (rows && !hand) {
    const [times, ...columns] = [0, 1, 2, 3].map((k) => rows.map((row) => row[k]));
    const left = remaining(release, time - times.at(-1));
    const [f, s, depth] = columns.map((column) => left * between(times, column, time));
    return { slide: [f, s], depth: Math.max(depth, 0), along: 0 };
  }
  if (!(elapsed >= 0)) Object.assign(state, { clip: undefined, tip: null, held: false, slide: [0, 0], left: [0, 0], along: 0, since: 0 });
  const at = () => anchor(by, jointMatrixOf, morphWeightOf).place;
  const place = by && !hand ? placeOnSkin(extras, at(), jointMatrixOf, morphWeightOf) : null;
  const tip = place && place[2] < Infinity ? place : null;
  const before = state.tip ?? tip;
  const away = tip && Math.hypot(tip[0] - clamp(tip[0], 0, lengthOf(extras)), tip[1]);
  const held = Boolean(hand) || (tip && tip[2] < deepest && away < pad + (state.held ? grip : 0));
  // Within a frame the tip comes or goes where it passes that height.
  const passed = tip && Boolean(held) !== Boolean(state.held) ? (before[2] - deepest) / (before[2] - tip[2] || 1) : 0;
  const part = Math.min(Math.max(passed, 0), 1);
  // When that is, a clip that was baked knows better than the heights at both ends of the frame.
  const end = clip === state.clip ? ends[clip]?.findLast((each) => state.time < each && each <= time) : undefined;
  const gone = end === undefined ? part : (end - state.time) / (time - state.time);
  const edge = tip && tip.map((x, i) => before[i] + part * (x - before[i]));
  let slide = state.slide ?? [0, 0];
  const [from, to] = held ? [state.held ? before : edge, tip] : [before, edge];
  if (hand) slide = hand.slide;
  else if (held || (state.held && tip)) slide = slide.map((x, i) => x + to[i] - from[i]);
  // Beyond its grip the tip slips.
  const slip = Math.min(1, grip / (Math.hypot(...slide) || 1));
  if (held || state.held) {
    const left = slide.map((x) => x * slip);
    const along = hand ? hand.along : (held ? tip : edge)?.[0] - left[0];
    Object.assign(state, { left, along: along ?? state.along ?? 0, since: state.tip && !held ? -gone * elapsed : 0 });
  }
  if (!held && elapsed > 0) state.since = (state.since ?? 0) + elapsed;
  const left = held ? 1 : remaining(release, state.since ?? 0);
  const depth = held ? Math.min(Math.max(hand ? hand.depth : -tip[2], 0), deepest) : 0;
  return Object.assign(state, { clip, time, tip, held, depth, slide: (state.left ?? [0, 0]).map((x) => left * x) });
}

/**
 * The weights of a touch's morph targets, in the order of `touchExtras.targets`.
 *
 * touchExtras    one of `extras.wrinkle.touches`
 * jointMatrixOf  a joint's name to its matrix to world space: 16 numbers, by columns
 * morphWeightOf  the weight of another morph target by name, where faces move the place
 * clip, time     name and seconds, for slides that a clip keys
 * state          of the touch, kept from call to call: an object, {} to begin with
 * elapsed        seconds since the last call; where it is not known, the skin is at rest
 * hand           {slide: [forward, sideways], depth, along} where the player's own tip touches, scene units; `along` is how
 *                far along the row the skin is that it slides
 */
export function touchWeights(
  touchExtras,
  jointMatrixOf,
  { morphWeightOf = () => 0, clip, time = 0, state = {}, elapsed, hand } = {},
) {
  const { grip, deepest, turn = 0, limb, row } = touchExtras;
  const how = { jointMatrixOf, morphWeightOf, clip, time, state, elapsed, hand };
  const { slide, depth, along = 0 } = contact(touchExtras, how);
  const far = Math.max(Math.hypot(...slide) / grip, 1);
  const [f, s] = slide.map((x) => x / grip / far);
  const ringsOf = ({ windows, rises }, share = 1) => {
    const length = share * Math.hypot(f, s);
    const [steps, heights] = [0, 1].map((k) => rises.map((each) => each[k]));
    const height = length > 0 ? (share * between(steps, heights, length)) / length : 0;
    return windows.map((angle) => height * Math.max(f * Math.cos(angle) + s * Math.sin(angle), 0));
  };
  const [c, n] = [Math.cos(turn), Math.sin(turn)];
  const [onward, across] = [c * f + n * s, c * s - n * f];
  const ways = [onward, across, -onward, -across].map((x) => Math.max(x, 0));
  if (row) {
    const shares = sharesAt(touchExtras, along);
    return placesOf(touchExtras).flatMap((own, k) => [shares[k] * ways[0], shares[k] * ways[2], ...ringsOf(own, shares[k])]);
  }
  const sine = limb ? bendOf(touchExtras, jointMatrixOf, morphWeightOf) : 0;
  const sides = limb ? [Math.max(sine, 0), Math.max(-sine, 0)] : [];
  const changes = sides.flatMap((side) => ways.map((way) => side * way));
  return [...ways, clamp(depth / deepest, 0, 1), ...ringsOf(touchExtras), ...changes];
}
