// Shapes looked up by the turn of a joint: those of contact, where skin touches and never crosses, and those of fields.

import { addPath, dot, turnOf } from './path.js';
import { between } from './polyline.js';

/**
 * The weights of a fold's morph targets, in their order.
 *
 * foldExtras     one of `extras.wrinkle.folds`, or of the `turns` of a field
 * jointMatrixOf, clip  as of `wrinkleWeights`
 */
export function foldWeights(foldExtras, jointMatrixOf, { clip } = {}) {
  const { axis, angles, weights, paths = [], other } = foldExtras;
  const { sines, cosine, turned } = turnOf(foldExtras, jointMatrixOf);
  const angle = 2 * Math.atan2(dot(axis, sines), cosine);
  const sums = weights[0].map((_, k) => between(angles, weights.map((row) => row[k]), angle));
  const strength = foldExtras.strengths?.[clip] ?? foldExtras.strength ?? 1;
  // Where another joint folds the surface, too, rows of clips are by the turns of both.
  const both = other ? [...turned, ...turnOf(other, jointMatrixOf).turned] : turned;
  const rows = foldExtras.paths_with_other ?? paths;
  const whole = rows.reduce((sum, path) => sum + addPath(path, both, sums), 1);
  return sums.map((sum) => (strength * sum) / whole);
}

/** The weights of a field's morph targets: roots of the sums of the squares, with signs, that its turns have, at most 1. */
export function fieldWeights({ turns, targets, strengths, strength = 1 }, jointMatrixOf, { clip } = {}) {
  const sums = targets.map(() => 0);
  for (const turn of turns) {
    foldWeights(turn, jointMatrixOf).forEach((weight, k) => (sums[turn.raises[k]] += weight * Math.abs(weight)));
  }
  return sums.map((sum) => (strengths?.[clip] ?? strength) * Math.sqrt(Math.min(Math.max(sum, 0), 1)));
}
