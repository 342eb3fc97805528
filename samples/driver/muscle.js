// Muscles that are activated: they get thicker though their ends stay.

import { between } from './polyline.js';

/** The activation of a muscle, from 0 to 1: by keys of a clip, or the weight of another morph target. */
export function activation({ keys, morph }, morphWeightOf, clip, time) {
  if (morph) return Math.min(Math.max(morphWeightOf(morph), 0), 1);
  const found = keys?.[clip];
  return found ? between(found.map(([t]) => t), found.map(([, a]) => a), time) : 0;
}
