// Tissue that lags: x'' = ω² (d - x) - 2 ζ ω x', exact where d runs straight from frame to frame, however long one is.

/** What is left of a unit of place, and of a unit of speed, after so many radians: C and S of `Spring.decay`. */
export function decay(damping, turns) {
  if (damping < 1) {
    const swing = Math.sqrt(1 - damping ** 2);
    const fading = Math.exp(-damping * turns);
    return [fading * Math.cos(swing * turns), (fading * Math.sin(swing * turns)) / swing];
  }
  if (damping === 1) return [Math.exp(-turns), turns * Math.exp(-turns)];
  const swing = Math.sqrt(damping ** 2 - 1);
  const fading = Math.exp((swing - damping) * turns);
  const faster = Math.expm1(-2 * swing * turns);
  return [fading * (1 + faster / 2), (-fading * faster) / (2 * swing)];
}

/** How fast a spring settles: what is left of a swing fades at least like e to the minus this, times seconds. */
export function settling({ frequency, damping }) {
  const slower = damping > 1 ? damping + Math.sqrt(damping ** 2 - 1) : 1 / damping;
  return (2 * Math.PI * frequency) / slower;
}

/** The state after so many radians in which d runs straight from `from` to `to`: place and speed per radian. */
function passed({ x, speed }, damping, from, to, turns) {
  const slope = (to - from) / turns;
  const [c, s] = decay(damping, turns);
  const [y, u] = [x - from + 2 * damping * slope, speed - slope];
  return {
    x: to - 2 * damping * slope + c * y + s * (u + damping * y),
    speed: slope + c * u - s * (y + damping * u),
  };
}

/**
 * The shortening that tissue follows, which may be below 0.
 *
 * state    of the tool, kept from call to call: an object, {} to begin with, at rest
 * lag      of the tool's extras
 * short    the shortening now; below 0 where the segment is stretched, which counts as 0
 * elapsed  seconds since the last call; where it is not known, tissue does not lag
 */
export function lagged(state, { frequency, damping }, short, elapsed) {
  const { x = Math.max(short, 0), speed = 0, short: before = short } = state;
  const turns = 2 * Math.PI * frequency * elapsed;
  let now = { x, speed };
  if (Number.isNaN(turns)) now = { x: Math.max(short, 0), speed: 0 };
  if (turns > 0) {
    // Where it begins or ends to be shorter between two frames, there the line bends.
    const bend = before * short < 0 ? before / (before - short) : 1;
    const ends = [Math.max(before, 0), before * short < 0 ? 0 : Math.max(short, 0), Math.max(short, 0)];
    now = passed(now, damping, ends[0], ends[1], bend * turns);
    if (bend < 1) now = passed(now, damping, ends[1], ends[2], (1 - bend) * turns);
  }
  Object.assign(state, now, { short });
  return now.x;
}
