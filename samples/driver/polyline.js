// Values between the points of a polyline.

/** A value between the points of a polyline, held before the first and after the last. */
export function between(xs, ys, x) {
  const k = xs.findIndex((each) => each > x);
  if (k === 0) return ys[0];
  if (k < 0) return ys[ys.length - 1];
  return ys[k - 1] + ((ys[k] - ys[k - 1]) * (x - xs[k - 1])) / (xs[k] - xs[k - 1]);
}
