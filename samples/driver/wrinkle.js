// Tools and muscles: weights by the length of a segment or path between anchors, against its rest length.

import { anchor, anchorsOf } from './anchor.js';
import { activation, split, tabulated } from './muscle.js';
import { between } from './polyline.js';
import { lagged } from './spring.js';

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
  const { rest_length: nominal, rest_length_morph: morph, targets, lag } = toolExtras;
  const { tension, lows = [] } = toolExtras;
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
  const found = tabulated(toolExtras, 1 - ends / length, 1 - distance / length);
  const factor = ((toolExtras.strengths?.[clip] ?? toolExtras.strength ?? 1) * length) / nominal;
  return split(found.map((weight) => factor * weight), lows);
}
