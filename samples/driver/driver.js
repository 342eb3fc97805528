// Wrinkles in clips that were never baked: what `wrinkle bake` leaves in a node's extras is enough.
// `wrinkleWeights` needs neither a browser nor three.js; `WrinkleDriver` is how three.js uses it.

import { anchor, anchorsOf } from './anchor.js';
import { fleshWeights } from './flesh.js';
import { foldWeights } from './fold.js';
import { KeyCurves } from './keys.js';
import { jointFinder, morphMeshes, named, nameOf, quoted } from './joints.js';
import { activation, tabulated } from './muscle.js';
import { between } from './polyline.js';
import { lagged } from './spring.js';
import { placeOnSkin, touchWeights } from './touch.js';

export { fleshWeights, foldWeights, placeOnSkin, touchWeights };

/** Weights while the rest length changes: bumps rise group by group, each until it takes no more. */
function followed(curve, distance, length) {
  const { taut, compressible = 0, intervals, bumps, distances, capacities, parts, rises, mix, positive, least = 0 } = curve;
  const ends = taut * length - (1 - compressible) * (taut * length - distance);
  const chord = (2 * ends) / intervals;
  const capacity = distances ? between(distances, capacities, ends) : Infinity;
  let left = Math.max(taut * length - ends, 0);
  const heights = bumps.flatMap((count) => {
    const share = Math.min(left / count, capacity);
    left = Math.max(left - count * share, 0);
    const part = share / (chord + share) || 0;
    return rises[0].map((_, k) => (chord + share) * Math.sqrt(part) * between(parts, rises.map((row) => row[k]), part));
  });
  const sums = mix.map((row) => row.reduce((sum, factor, k) => sum + factor * heights[k], 0));
  return sums.map((weight) => ((positive ? weight : Math.abs(weight)) > least ? weight : 0));
}

/**
 * The weights of one tool's morph targets, in the order of `toolExtras.targets`.
 *
 * toolExtras     one of `extras.wrinkle.tools` or `extras.wrinkle.muscles`
 * jointMatrixOf  a joint's name to its matrix to world space: 16 numbers, by columns
 * morphWeightOf  the weight of another morph target by name, where faces move the anchors
 * clip, time     name and seconds, for tools with a strength or rest length of their own in a clip
 * state, elapsed for tools that lag: what `lagged` keeps of the tool from call to call, and seconds since the last
 */
export function wrinkleWeights(
  toolExtras,
  jointMatrixOf,
  { morphWeightOf = () => 0, clip, time = 0, state = {}, elapsed } = {},
) {
  const { rest_length: nominal, rest_length_morph: morph, curve, targets, lag } = toolExtras;
  const { tension } = toolExtras;
  const posed = anchorsOf(toolExtras).map((each) => anchor(each, jointMatrixOf, morphWeightOf));
  const scale = posed.reduce((sum, each) => sum + each.scale, 0) / posed.length;
  if (scale < 1e-6) {
    if (lag) lagged(state, lag, -1, elapsed);
    return targets.map(() => 0);
  }
  let length = nominal;
  if (morph) length += Math.min(Math.max(morphWeightOf(morph.name), 0), 1) * (morph.full - nominal);
  const keys = toolExtras.rest_length_keys?.[clip];
  if (keys) length = between(keys.map(([t]) => t), keys.map(([, l]) => l), time);
  const steps = posed.slice(1).map(({ place }, k) => Math.hypot(...place.map((x, i) => x - posed[k].place[i])));
  const ends = steps.reduce((sum, step) => sum + step) / scale;
  let distance = ends;
  // An activation shortens a muscle whose ends stay.
  if (tension) distance -= tension.length * activation(tension, morphWeightOf, clip, time);
  if (lag) {
    const x = Math.min(lagged(state, lag, lag.taut - distance / length, elapsed), lag.taut);
    distance = x > 0 ? (lag.taut - x) * length : Math.max(distance, lag.taut * length);
  }
  const found = curve
    ? followed(curve, distance, length)
    : tabulated(toolExtras, 1 - ends / length, 1 - distance / length);
  return found.map((weight) => weight * (toolExtras.strengths?.[clip] ?? toolExtras.strength ?? 1));
}

/**
 * Drives every body below a three.js object. Call `update` each frame, after the mixer and before rendering, with the
 * clip's name and time, and the seconds since the last call: without these, time's own, which stop where a clip loops.
 * The console says what is left out, and why. With the file's `clips`, flesh follows a smooth curve through their keys.
 */
export class WrinkleDriver {
  constructor(root, clips = root.animations) {
    Object.assign(this, { root, curves: new KeyCurves(root, clips), bodies: [], hands: {} });
    root.traverse((object) => object.userData.wrinkle && this.add(object, object.userData.wrinkle));
    if (!this.bodies.length) console.warn('wrinkle: nothing to drive: no object has extras.wrinkle and morph targets');
  }

  add(object, { muscles = [], tools = [], folds = [], flesh = [], touches = [], parts = [] }) {
    const warn = (line) => console.warn(`wrinkle: ${nameOf(object)}: ${line}`);
    // The other parts of a mesh that was split stand beside it.
    const places = parts.map((name) => named(this.root, name));
    parts.forEach((name, k) => places[k].length || warn(`there is no part ${quoted([name])}`));
    const meshes = [object, ...places.flat()].flatMap(morphMeshes);
    const jointOf = jointFinder(this.root, object, meshes, warn);
    const isThere = (drive) => {
      const { name, joint, parent = joint, targets, by } = drive;
      const called = name ?? `the fold of ${quoted([joint])}`;
      const anchors = joint === undefined ? [...anchorsOf(drive), ...(by ? [by] : [])] : [];
      const joints = joint === undefined ? anchors.flatMap((each) => each.joints) : [joint, parent];
      const absent = joints.filter((each) => !jointOf(each));
      const lost = targets.filter((target) => !meshes.some((each) => target in each.morphTargetDictionary));
      if (absent.length) warn(`${called} is left out, as there is no joint ${quoted(absent)}`);
      if (lost.length) warn(`${called} does not show, as there is no morph target ${quoted(lost)}`);
      return !absent.length;
    };
    // Muscles move the skin on which the anchors of tools are. A fold that no joint bends is driven as a tool.
    const [bent, risen] = [folds.filter(({ joint }) => joint), folds.filter(({ joint }) => !joint)];
    const jointMatrixOf = (name) => jointOf(name).matrixWorld.elements;
    const every = { tools: [...muscles, ...tools, ...risen], folds: bent, flesh, touches };
    const drives = Object.fromEntries(Object.entries(every).map(([kind, all]) => [kind, all.filter(isThere)]));
    const kept = [drives.tools, drives.flesh, drives.touches].map((all) => all.map(() => ({})));
    const [states, swings, tips] = kept;
    if (meshes.length) this.bodies.push({ ...drives, meshes, jointOf, jointMatrixOf, states, swings, tips });
  }

  /** Slides the skin of a touch forward and sideways, scene units; null lets it go. A VR hand or a mouse calls this. */
  touch(name, slide) {
    this.hands[name] = slide && { depth: this.hands[name]?.depth ?? 0, slide };
  }

  /** Dents the skin of a touch by a depth, scene units. */
  press(name, depth) {
    this.hands[name] = { slide: this.hands[name]?.slide ?? [0, 0], depth };
  }

  update(clip, time, elapsed = Math.max(time - this.time, 0)) {
    const before = this.clip === clip ? this.time : NaN;
    Object.assign(this, { clip, time });
    this.root.updateMatrixWorld();
    for (const { tools, folds, flesh, touches, meshes, states, swings, tips, jointOf, jointMatrixOf } of this.bodies) {
      const { morphTargetDictionary: numbers, morphTargetInfluences: influences } = meshes[0];
      const morphWeightOf = (name) => influences[numbers[name]] ?? 0;
      const show = ({ targets }, found) => {
        for (const { morphTargetDictionary: places, morphTargetInfluences: all } of meshes)
          targets.forEach((name, k) => name in places && (all[places[name]] = found[k]));
      };
      // The asset's own morph targets move other parts as the first.
      for (const { morphTargetDictionary: places, morphTargetInfluences: all } of meshes.slice(1))
        for (const [name, place] of Object.entries(places)) if (name in numbers) all[place] = influences[numbers[name]];
      // First, as wrinkles appear where flesh swings.
      for (const [k, each] of flesh.entries()) {
        const known = this.curves.during(jointOf(each.joint), each.at, clip, time, before, elapsed);
        show(each, fleshWeights(each, jointMatrixOf, { state: swings[k], elapsed, ...known }));
      }
      for (const [k, touch] of touches.entries()) {
        const how = { morphWeightOf, clip, time, state: tips[k], elapsed, hand: this.hands[touch.name] };
        show(touch, touchWeights(touch, jointMatrixOf, how));
      }
      for (const [k, tool] of tools.entries())
        show(tool, wrinkleWeights(tool, jointMatrixOf, { morphWeightOf, clip, time, state: states[k], elapsed }));
      for (const fold of folds) show(fold, foldWeights(fold, jointMatrixOf, morphWeightOf, clip));
    }
  }
}
