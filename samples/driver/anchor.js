// Anchors of tools and touches: points of the skin that joints and morph targets carry.

/** A point times a 4×4 matrix, stored by columns. */
const moved = (m, [x, y, z]) => [0, 1, 2].map((i) => m[i] * x + m[i + 4] * y + m[i + 8] * z + m[i + 12]);
const determinant = (m) =>
  m[0] * (m[5] * m[10] - m[6] * m[9]) + m[4] * (m[2] * m[9] - m[1] * m[10]) + m[8] * (m[1] * m[6] - m[2] * m[5]);

/** A tool's anchors: two, or all of its path. */
export const anchorsOf = ({ origin, target, anchors = [origin, target] }) => anchors;

/** An anchor's place in the world, and its joints' scale against rest. */
export function anchor({ joints, weights, positions, scales, morphs = {} }, jointMatrixOf, morphWeightOf) {
  const place = [0, 0, 0];
  let scale = 0;
  joints.forEach((joint, k) => {
    const matrix = jointMatrixOf(joint);
    const point = [...positions[k]];
    for (const [name, moves] of Object.entries(morphs))
      moves[k].forEach((move, i) => (point[i] += morphWeightOf(name) * move));
    moved(matrix, point).forEach((x, i) => (place[i] += weights[k] * x));
    scale += (weights[k] * Math.cbrt(Math.abs(determinant(matrix)))) / scales[k];
  });
  return { place, scale };
}
