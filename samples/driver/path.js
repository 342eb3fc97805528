// Weights along the turns of a joint in a clip that was baked.

/** The sine of half of 10°, and the squared distance below which two turns are the same. */
const [NEAR, SAME] = [0.0872, 1e-10];
export const dot = (a, b) => a.reduce((sum, x, i) => sum + x * b[i], 0);

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
