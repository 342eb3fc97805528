// Shapes looked up by the turn of a joint: those of contact, where skin touches and never crosses, and those of fields.

import { addPath, dot } from './path.js';
import { between } from './polyline.js';

/** The rotation in a 4×4 matrix, stored by columns: three columns of unit length. */
const turn = (m) => [0, 4, 8].map((k) => m.slice(k, k + 3)).map((c) => c.map((x) => x / (Math.hypot(...c) || 1)));
/** Below this a turn has no axis; and the sum of the shares of `leaning` beyond which weights are held. */
const [LEAST_SINE, FARTHEST] = [1e-5, 2];

/**
 * The weights of a fold's morph targets, in their order.
 *
 * foldExtras     one of `extras.wrinkle.folds`, or of the `turns` of a field
 * jointMatrixOf, clip  as of `wrinkleWeights`
 */
export function foldWeights(foldExtras, jointMatrixOf, { clip } = {}) {
  const { joint, parent, rest: [x, y, z, w], axis } = foldExtras;
  const { angles, weights, leaning = [], null: nothing, paths = [] } = foldExtras;
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
  const along = dot(axis, sines);
  const cosine = 1 + d[0][0] + d[1][1] + d[2][2];
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
  const turned = sines.map((each) => each / (2 * Math.sqrt(Math.max(cosine, LEAST_SINE ** 2))));
  const whole = paths.reduce((sum, path) => sum + addPath(path, turned, sums), 1);
  return sums.map((sum) => (strength * sum) / whole);
}

/** The weights of a field's morph targets: those of its turns, one after the other. */
export function fieldWeights({ turns, strengths, strength }, jointMatrixOf, how) {
  return turns.flatMap((turn) => foldWeights({ ...turn, strengths, strength }, jointMatrixOf, how));
}
