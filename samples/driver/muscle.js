// Muscles that are activated, as they get thicker though their ends stay, and muscles whose belly moves.

import { between } from './polyline.js';

/** The activation of a muscle, from 0 to 1: by keys of a clip, or the weight of another morph target. */
export function activation({ keys, morph }, morphWeightOf, clip, time) {
  if (morph) return Math.min(Math.max(morphWeightOf(morph), 0), 1);
  const found = keys?.[clip];
  return found ? between(found.map(([t]) => t), found.map(([, a]) => a), time) : 0;
}

/** Weights of a belly that moves with the distance of its ends, by shortenings without and with what activation takes. */
export function travelled({ shortenings, weights, gains, lows }, ends, belly) {
  const gain = between(shortenings, gains, belly);
  const found = weights[0].map((_, k) => gain * between(shortenings, weights.map((row) => row[k]), ends));
  if (!lows) return found;
  const below = found.flatMap((weight, k) => (lows[k] > 0 ? [Math.max(-weight, 0) / lows[k]] : []));
  return [...found.map((weight, k) => (lows[k] > 0 ? Math.max(weight, 0) : weight)), ...below];
}
