// The turns of joints, and weights along those of one, or of two, in a clip that was baked.

/** Below this a turn has no axis. */
const LEAST_SINE = 1e-5;
/** The sine of half of 10°, and the squared distance below which two turns are the same. */
const [NEAR, SAME] = [0.0872, 1e-10];
export const dot = (a, b) => a.reduce((sum, x, i) => sum + x * b[i], 0);

/** The rotation in a 4×4 matrix, stored by columns: three columns of unit length. */
const turn = (m) => [0, 4, 8].map((k) => m.slice(k, k + 3)).map((c) => c.map((x) => x / (Math.hypot(...c) || 1)));

/** How a joint is turned from its stored pose: four times sine and cosine of half the angle, and by its axis the sine. */
export function turnOf({ joint, parent, rest: [x, y, z, w] }, jointMatrixOf) {
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
  const cosine = 1 + d[0][0] + d[1][1] + d[2][2];
  return { sines, cosine, turned: sines.map((each) => each / (2 * Math.sqrt(Math.max(cosine, LEAST_SINE ** 2)))) };
}

/** Adds the weights along the turns of a baked clip, linear between rows, the nearer the more; returns the shares. */
export function addPath({ turns, weights }, turn, sums) {
  let whole = 0;
  for (let row = 0; row + 1 < turns.length; row++) {
    const way = turns[row + 1].map((x, i) => x - turns[row][i]);
    const apart = turn.map((x, i) => x - turns[row][i]);
    const along = Math.min(Math.max(dot(apart, way) / (dot(way, way) || 1), 0), 1);
    const rest = apart.map((x, i) => x - along * way[i]);
    const share = Math.max(NEAR ** 2 / Math.max(dot(rest, rest), SAME) - 1, 0);
    sums.forEach((_, k) => (sums[k] += share * ((1 - along) * weights[row][k] + along * weights[row + 1][k])));
    whole += share;
  }
  return whole;
}
