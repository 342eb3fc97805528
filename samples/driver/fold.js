// Folds whose skin touches and never crosses: shapes of contact, looked up by the angle of the joint that folds.

import { between } from './polyline.js';

/** The rotation in a 4×4 matrix, stored by columns: three columns of unit length. */
const turn = (m) => [0, 4, 8].map((k) => m.slice(k, k + 3)).map((c) => c.map((x) => x / (Math.hypot(...c) || 1)));
const dot = (a, b) => a.reduce((sum, x, i) => sum + x * b[i], 0);

/**
 * The weights of a fold's morph targets, in the order of `foldExtras.targets`, where touching skin is kept apart.
 *
 * foldExtras     one of `extras.wrinkle.folds`
 * jointMatrixOf, morphWeightOf  as of `wrinkleWeights`
 */
export function foldWeights(foldExtras, jointMatrixOf, morphWeightOf = () => 0) {
  const { joint, parent, rest: [x, y, z, w], axis, angles, weights, targets, own: alone = [] } = foldExtras;
  // A clip that was baked may have targets of its own, which stand for all.
  if (alone.some(morphWeightOf)) return targets.map(() => 0);
  const own = turn([...jointMatrixOf(joint)]);
  const above = parent === undefined ? [[1, 0, 0], [0, 1, 0], [0, 0, 1]] : turn([...jointMatrixOf(parent)]);
  const stored = [
    [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
    [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
    [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
  ];
  // Against the parent, by rows; and what that is from the stored pose.
  const local = above.map((row) => own.map((column) => dot(row, column)));
  const d = local.map((row) => stored.map((each) => dot(row, each)));
  const sines = [d[2][1] - d[1][2], d[0][2] - d[2][0], d[1][0] - d[0][1]];
  const angle = 2 * Math.atan2(dot(axis, sines), 1 + d[0][0] + d[1][1] + d[2][2]);
  return targets.map((_, k) => between(angles, weights.map((row) => row[k]), angle));
}
