// Straight lines between a clip's keys kick flesh at each key. A bake lets it follow a smooth curve through the keys.

import { UNKNOWN } from './flesh.js';

const AXES = [0, 1, 2];
const PROPERTIES = ['position', 'quaternion', 'scale'];
/** Seconds of a clip in a second beyond which it has been put to another time. */
const FASTEST = 4;
/** Keys by which a loop goes on at both ends: slopes depend on no others. */
const AROUND = 2;
/** Pieces of a clip of few keys, and samples a second of one that is smooth between its keys, as the bake has them. */
const PIECES = 4;
const SAMPLES = 60;
/** Part of a clip below which two keys are a jump of the pose, which no curve follows: the later one counts. */
const APART = 3e-5;
/** Difference of a quaternion or scale below which a clip ends in the pose of its beginning. */
const SAME = 1e-3;
/** A loop's change of velocity, over that at the keys beside its ends, or over all change in it, at most. */
const BESIDE = 2;
const OVERALL = 0.1;

/** The one of two numbers that is nearer to 0; 0 if their signs differ. */
const least = (a, b) => (a * b > 0 ? (Math.abs(a) < Math.abs(b) ? a : b) : 0);

/** Slopes of a smooth curve through numbers at sorted times, which goes nowhere between equal ones: see README.md. */
function slopes(times, values) {
  const last = times.length - 1;
  const spans = times.slice(1).map((time, k) => time - times[k]);
  const steps = spans.map((span, k) => (values[k + 1] - values[k]) / span);
  const inner = Array.from({ length: last - 1 }, (_, k) => (steps[k + 1] - steps[k]) / (spans[k] + spans[k + 1]));
  const at = [inner[0], ...inner, inner[last - 2]];
  const bends = spans.map((_, k) => least(at[k], at[k + 1]));
  const found = values.map((_, k) => {
    if (!k || k === last) return 0;
    const mean = (spans[k] * steps[k - 1] + spans[k - 1] * steps[k]) / (spans[k] + spans[k - 1]);
    const tended = least(steps[k - 1] + bends[k - 1] * spans[k - 1], steps[k] - bends[k] * spans[k]);
    const most = Math.max(3 * Math.abs(least(steps[k - 1], steps[k])), 1.5 * Math.abs(tended));
    return least(mean, Math.sign(tended) * most);
  });
  found[0] = least(2 * steps[0] - found[1], 3 * steps[0]);
  found[last] = least(2 * steps[last - 1] - found[last - 1], 3 * steps[last - 1]);
  return found;
}

/** The curve through points at sorted times; a loop goes on as it went, and `whole` is its way. */
function curveThrough(times, points, loops, whole) {
  const last = times.length - 1;
  const span = times[last] - times[0];
  const around = loops ? AROUND : 0;
  const all = Array.from({ length: last + 1 + 2 * around }, (_, k) => {
    const round = loops ? Math.floor((k - around) / last) : 0;
    const key = k - around - round * last;
    return { time: times[key] + round * span, point: points[key].map((x, i) => x + round * whole[i]) };
  });
  const bySlope = AXES.map((i) => slopes(all.map(({ time }) => time), all.map(({ point }) => point[i])).slice(around));
  return (time) => {
    const round = loops ? Math.floor((time - times[0]) / span) : 0;
    const now = Math.min(Math.max(time - round * span, times[0]), times[last]);
    const after = times.findIndex((each) => each > now);
    const k = after < 0 ? last - 1 : after - 1;
    const wide = times[k + 1] - times[k];
    const t = (now - times[k]) / wide;
    return AXES.map((i) => {
      const [from, to, out, into] = [points[k][i], points[k + 1][i], bySlope[i][k], bySlope[i][k + 1]];
      const place = from * (1 + 2 * t) * (1 - t) ** 2 + to * t ** 2 * (3 - 2 * t);
      return round * whole[i] + place + wide * t * (1 - t) * (out * (1 - t) - into * t);
    });
  };
}

/** True if places go on from the last as they began at the first, apart from where they are. */
function goesRound(times, points) {
  const velocities = points.slice(1).map((point, k) => point.map((x, i) => (x - points[k][i]) / (times[k + 1] - times[k])));
  const change = (a, b) => Math.hypot(...AXES.map((i) => velocities.at(a)[i] - velocities.at(b)[i]));
  const ranges = AXES.map((i) => velocities.map((each) => each[i])).map((axis) => Math.max(...axis) - Math.min(...axis));
  return change(0, -1) <= Math.max(BESIDE * Math.max(change(1, 0), change(-1, -2)), OVERALL * Math.hypot(...ranges));
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
  const times = every.filter((time, k) => k === every.length - 1 || every[k + 1] - time > APART * (end - start));
  const points = times.map(placeAt);
  const closed = moving.filter(({ name }) => !name.endsWith('.position')).every(closes);
  const loops = closed && goesRound(times, points);
  const whole = points.at(-1).map((x, i) => x - points[0][i]);
  return { placeAt, curveAt: curveThrough(times, points, loops, whole), seconds: loops ? end - start : 0, whole };
}

/** The curves of all clips below a root, each made when it is first asked for. */
export class KeyCurves {
  constructor(root, clips) {
    Object.assign(this, { root, clips, made: new Map() });
  }

  /**
   * How a clip takes a place that a joint carries through a frame, in the world's axes; {} where that is not known.
   *
   * Gives `path`, a function from 0 at the frame's beginning to 1 at its end to the curve's place, `beside`, from the place
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
    const path = (part) => turned(runs ? curve.curveAt(time - (1 - part) * ran) : here);
    const back = turned(curve.whole.map((x) => (anew && runs ? -x : 0)));
    return { path, beside: turned(here.map((x, i) => x - shown[i])), back };
  }

  /** The same while clips blend, `playing`: a list of `{ clip, time, before, share }` whose shares add up to 1. */
  blended(joint, at, playing, elapsed) {
    const found = playing.map(({ clip, time, before }) => ({ ...UNKNOWN, ...this.during(joint, at, clip, time, before, elapsed) }));
    const mean = (placeOf) => AXES.map((i) => found.reduce((sum, known, k) => sum + playing[k].share * placeOf(known)[i], 0));
    const path = (part) => mean((known) => known.path(part));
    return { path, beside: mean(({ beside }) => beside), back: mean(({ back }) => back) };
  }
}
