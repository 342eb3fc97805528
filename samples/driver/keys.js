// Straight lines between a clip's keys kick flesh at each key. A bake lets it follow a smooth curve through the keys.

import { UNKNOWN } from './flesh.js';

const AXES = [0, 1, 2];
const PROPERTIES = ['position', 'quaternion', 'scale'];
/** Seconds of a clip in a second beyond which it has been put to another time. */
const FASTEST = 4;
/** Keys by which a loop goes on at both ends: what lies farther bends the curve by less than a 10,000th as much. */
const AROUND = 8;
/** Pieces of a clip of few keys, and samples a second of one that is smooth between its keys, as the bake has them. */
const PIECES = 4;
const SAMPLES = 60;
/** Part of a clip below which two keys are a jump of the pose, which no curve follows: the later one counts. */
const APART = 3e-5;
/** Difference of a quaternion or scale below which a clip ends in the pose of its beginning. */
const SAME = 1e-3;

/** A curve through points at sorted times, smooth to the second derivative and straight at its ends. */
function spline(times, points) {
  const last = times.length - 1;
  const steps = times.slice(1).map((time, k) => time - times[k]);
  const slope = (k, i) => (points[k + 1][i] - points[k][i]) / steps[k];
  const bends = points.map(() => [0, 0, 0]);
  const parts = [0];
  for (let k = 1; k < last; k++) {
    const pivot = 2 * (steps[k - 1] + steps[k]) - steps[k - 1] * parts[k - 1];
    parts[k] = steps[k] / pivot;
    bends[k] = AXES.map((i) => (6 * (slope(k, i) - slope(k - 1, i)) - steps[k - 1] * bends[k - 1][i]) / pivot);
  }
  for (let k = last - 1; k > 0; k--) bends[k] = AXES.map((i) => bends[k][i] - parts[k] * bends[k + 1][i]);
  return (time) => {
    const after = times.findIndex((each) => each > time);
    const k = after < 0 ? last - 1 : Math.max(after - 1, 0);
    const [t, h] = [time - times[k], steps[k]];
    return AXES.map((i) => {
      const [low, high] = [bends[k][i], bends[k + 1][i]];
      return points[k][i] + t * (slope(k, i) - (h * (2 * low + high)) / 6 + t * (low / 2 + (t * (high - low)) / (6 * h)));
    });
  };
}

/** What the clip's tracks do to a place that a joint below `root` carries. */
function carriedBy(clip, root, joint, at) {
  const [chain, moving] = [[], []];
  for (let object = joint; object && object !== root; object = object.parent) {
    const copy = object.clone(false);
    const tracks = PROPERTIES.flatMap((property) => {
      const names = [object.name, object.uuid].map((name) => `${name}.${property}`);
      return clip.tracks.filter(({ name }) => names.includes(name)).map((track) => ({ property, track }));
    });
    moving.push(...tracks.map(({ track }) => track).filter(changes));
    chain.push({ copy, ways: tracks.map(({ property, track }) => [copy[property], track.createInterpolant()]) });
  }
  const placeAt = (time) => {
    const point = joint.position.clone().fromArray(at);
    for (const { copy, ways } of chain) {
      for (const [vector, way] of ways) vector.fromArray(way.evaluate(time));
      copy.updateMatrix();
      point.applyMatrix4(copy.matrix);
    }
    return point.toArray();
  };
  return { placeAt, moving };
}

const sizeOf = ({ values, times }) => values.length / times.length;
const changes = (track) => track.values.some((x, k) => x !== track.values[k % sizeOf(track)]);
const isSmooth = ({ createInterpolant }) => createInterpolant.isInterpolantFactoryMethodGLTFCubicSpline;

/** True if a track ends as it begins; a quaternion and its negative are the same. */
function closes(track) {
  const [first, last] = [track.values.slice(0, sizeOf(track)), track.values.slice(-sizeOf(track))];
  return [1, -1].some((sign) => first.every((x, k) => Math.abs(x - sign * last[k]) < SAME));
}

/** The place that a joint carries in a clip, and the smooth curve through its keys; null where the clip leaves it. */
function curveOf(clip, root, joint, at) {
  const { placeAt, moving } = carriedBy(clip, root, joint, at);
  if (!moving.length) return null;
  const [start, end] = [Math.min(...clip.tracks.map(({ times }) => times[0])), clip.duration];
  const smooth = moving.every(isSmooth);
  const pieces = smooth ? Math.max(PIECES, Math.ceil(SAMPLES * (end - start))) : PIECES;
  const every = [...new Set([start, end, ...moving.flatMap(({ times }) => [...times])])];
  // A place on a straight line between keys lies beside the smooth curve.
  if (smooth || every.length <= PIECES)
    every.push(...Array.from({ length: pieces + 1 }, (_, k) => start + (k / pieces) * (end - start)));
  every.sort((a, b) => a - b);
  let times = every.filter((time, k) => k === every.length - 1 || every[k + 1] - time > APART * (end - start));
  let points = times.map(placeAt);
  const loops = moving.filter(({ name }) => !name.endsWith('.position')).every(closes);
  const last = times.length - 1;
  const whole = points[last].map((x, i) => x - points[0][i]);
  if (loops) {
    // A walk goes on as it went.
    const around = Array.from({ length: last + 1 + 2 * AROUND }, (_, k) => k - AROUND);
    const split = around.map((k) => [Math.floor(k / last), ((k % last) + last) % last]);
    points = split.map(([round, k]) => points[k].map((x, i) => x + round * whole[i]));
    times = split.map(([round, k]) => times[k] + round * (end - start));
  }
  return { placeAt, curveAt: spline(times, points), seconds: loops ? end - start : 0, whole };
}

/** The curves of all clips below a root, each made when it is first asked for. */
export class KeyCurves {
  constructor(root, clips) {
    Object.assign(this, { root, clips, made: new Map() });
  }

  /**
   * How a clip takes a place that a joint carries through a frame, in the world's axes; {} where that is not known.
   *
   * Gives `path`, the curve's places at the frame's beginning, a third, two thirds and its end, `beside`, from the place
   * that is shown to the curve, and `back`, how far a walk is put back where its clip begins anew.
   *
   * name, time, before  of the clip, and its seconds now and at the last frame
   */
  during(joint, at, name, time, before, elapsed) {
    const clip = this.clips.find((each) => each.name === name);
    if (!clip) return {};
    const key = `${clip.uuid} ${joint.uuid} ${at}`;
    if (!this.made.has(key)) this.made.set(key, curveOf(clip, this.root, joint, at));
    const curve = this.made.get(key);
    if (!curve) return {};
    const m = this.root.matrixWorld.elements;
    const turned = ([x, y, z]) => AXES.map((i) => m[i] * x + m[i + 4] * y + m[i + 8] * z);
    const here = curve.curveAt(time);
    const shown = curve.placeAt(time);
    const anew = time < before && curve.seconds > 0;
    const ran = time - before + (anew ? curve.seconds : 0);
    const runs = ran >= 0 && ran <= FASTEST * elapsed;
    const path = [1, 2 / 3, 1 / 3, 0].map((part) => turned(curve.curveAt(time - (runs ? part * ran : 0))));
    const back = turned(curve.whole.map((x) => (anew && runs ? -x : 0)));
    return { path, beside: turned(here.map((x, i) => x - shown[i])), back };
  }

  /** The same while clips blend, `playing`: a list of `{ clip, time, before, share }` whose shares add up to 1. */
  blended(joint, at, playing, elapsed) {
    const found = playing.map(({ clip, time, before }) => ({ ...UNKNOWN, ...this.during(joint, at, clip, time, before, elapsed) }));
    const mean = (placeOf) => AXES.map((i) => found.reduce((sum, known, k) => sum + playing[k].share * placeOf(known)[i], 0));
    const path = [0, 1, 2, 3].map((k) => mean((known) => known.path[k]));
    return { path, beside: mean(({ beside }) => beside), back: mean(({ back }) => back) };
  }
}
