// Muscles: one that is activated gets thicker though its ends stay, and the belly of one may travel.

import { between } from './polyline.js';

/** The activation of a muscle, from 0 to 1: by keys of a clip, or the weight of another morph target. */
export function activation({ keys, morph }, morphWeightOf, clip, time) {
  if (morph) return Math.min(Math.max(morphWeightOf(morph), 0), 1);
  const found = keys?.[clip];
  return found ? between(found.map(([t]) => t), found.map(([, a]) => a), time) : 0;
}

/** Weights by shortenings without and with what activation takes; a belly that travels has its place by the first. */
export function tabulated({ shortenings, weights, gains }, ends, belly) {
  const at = (x) => weights[0].map((_, k) => between(shortenings, weights.map((row) => row[k]), x));
  if (!gains) return at(belly);
  const gain = between(shortenings, gains, belly);
  return at(ends).map((weight) => gain * weight);
}

/** Weights below 0 on further targets, for engines that have no such weights. */
export function split(weights, lows) {
  const below = weights.flatMap((weight, k) => (lows[k] > 0 ? [Math.max(-weight, 0) / lows[k]] : []));
  return [...weights.map((weight, k) => (lows[k] > 0 ? Math.max(weight, 0) : weight)), ...below];
}
