// Springs that swing together within a limit of 1, by steps in which each is free.

import { decay } from './spring.js';

/** Greatest change of a swing per second, over its limit. */
const FASTEST = 24;
/** Iterations of Newton's method, which doubles its digits with each. */
const ITERATIONS = 30;

const sum = (numbers) => numbers.reduce((total, each) => total + each, 0);
const square = (numbers) => sum(numbers.map((x) => x * x));

/** A swing, none of which is beyond the limit. */
export const limited = (n) => n.map((x) => x / Math.max(Math.sqrt(square(n)), 1));

/** The places at which springs rest under steady loads F: |n| = F (1 - |n|⁴). */
export function rested(loads) {
  const size = Math.sqrt(square(loads));
  let found = Math.min(size, 1);
  for (let k = 0; k < ITERATIONS; k++) found -= (size * found ** 4 + found - size) / (4 * size * found ** 3 + 1);
  return loads.map((load) => (size > 0 ? (load * found) / size : 0));
}

/** Of a push, |n|⁴ of what goes further out does not act. */
function inward(n, push) {
  const out = square(n) * Math.max(sum(n.map((x, k) => x * push[k])), 0);
  return push.map((each, k) => each - out * n[k]);
}

/** Places n and speeds over ω after some seconds, which begin with `kicks` of the speeds, under steady `loads`. */
export function swung([n, speeds], springs, kicks, loads, seconds) {
  const turns = springs.map(({ frequency }) => 2 * Math.PI * frequency);
  const kicked = inward(n, kicks).map((kick, k) => speeds[k] + kick);
  const rest = inward(n, loads);
  const taken = square(kicked.map((speed, k) => speed * Math.max(turns[k] / FASTEST, 1)));
  const room = Math.max(1 - square(n), 0);
  const kept = taken > room ? Math.sqrt(room / taken) : 1;
  const ends = limited(n).map((x, k) => {
    const { damping } = springs[k];
    const [c, s] = decay(damping, turns[k] * seconds);
    const [y, u] = [x - rest[k], kept * kicked[k]];
    return [rest[k] + c * y + s * (u + damping * y), c * u - s * (y + damping * u)];
  });
  return [0, 1].map((part) => ends.map((end) => end[part]));
}
