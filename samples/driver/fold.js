// Shapes looked up by the turn of a joint: those of contact, where skin touches and never crosses, and those of fields.

import { addPath, dot, LEAST_SINE, turnOf } from './path.js';
import { between } from './polyline.js';

/** The sum of the shares of `leaning` beyond which weights are held. */
const FARTHEST = 2;

/**
 * The weights of a fold's morph targets, in their order.
 *
 * foldExtras     one of `extras.wrinkle.folds`, or of the `turns` of a field
 * jointMatrixOf, clip  as of `wrinkleWeights`
 */
export function foldWeights(foldExtras, jointMatrixOf, { clip } = {}) {
  const { axis, angles, weights, leaning = [], null: nothing, paths = [], other } = foldExtras;
  const { sines, cosine, turned } = turnOf(foldExtras, jointMatrixOf);
  const along = dot(axis, sines);
  const angle = 2 * Math.atan2(along, cosine);
  // Turns about axes that lean from this one: the further towards one of these, the more its weights count.
  const slanted = Math.abs(along) > LEAST_SINE ? sines.map((each) => each / along) : [0, 0, 0];
  const asked = leaning.map(({ towards }) => Math.min(Math.max(dot(towards, slanted), 0), FARTHEST));
  const most = Math.max(asked.reduce((sum, share) => sum + share, 0), FARTHEST);
  const shares = asked.map((share) => (FARTHEST * share) / most);
  shares.unshift(1 - shares.reduce((sum, share) => sum + share, 0));
  const tables = [weights, ...leaning.map((each) => each.weights)];
  const found = weights[0].map((_, k) =>
    tables.reduce((sum, rows, j) => sum + shares[j] * between(angles, rows.map((row) => row[k]), angle), 0),
  );
  // No engine needs weights below 0: multiples of `nothing` move nothing.
  const least = nothing ? Math.min(0, ...found.map((weight, k) => weight / nothing[k])) : 0;
  const strength = foldExtras.strengths?.[clip] ?? foldExtras.strength ?? 1;
  const sums = found.map((weight, k) => weight - least * (nothing?.[k] ?? 0));
  // Where another joint folds the surface, too, rows of clips are by the turns of both.
  const both = other ? [...turned, ...turnOf(other, jointMatrixOf).turned] : turned;
  const rows = foldExtras.paths_with_other ?? paths;
  const whole = rows.reduce((sum, path) => sum + addPath(path, both, sums), 1);
  return sums.map((sum) => (strength * sum) / whole);
}

/** The weights of a field's morph targets: those of its turns, one after the other. */
export function fieldWeights({ turns, strengths, strength }, jointMatrixOf, how) {
  return turns.flatMap((turn) => foldWeights({ ...turn, strengths, strength }, jointMatrixOf, how));
}
