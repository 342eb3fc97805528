// Springs that swing together within a limit of 1, by steps in which each is free.

import { decay } from './spring.js';

/** Greatest change of a swing per second, over its limit. */
const FASTEST = 24;
/** Seconds over which a speed that the limit took counts against kicks the other way. */
const FADE = 1 / 30;
/** Iterations of Newton's method, which doubles its digits with each. */
const ITERATIONS = 30;

const sum = (numbers) => numbers.reduce((total, each) => total + each, 0);
const square = (numbers) => sum(numbers.map((x) => x * x));

/** A swing, none of which is beyond the limit. */
export const limited = (n) => n.map((x) => x / Math.max(Math.sqrt(square(n)), 1));

/** The places at which springs rest under steady loads F: |n| = F (1 - |n|⁴). */
function rested(loads) {
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

/** At rest under steady loads: places n, speeds over ω, and those that the limit took. */
export const atRest = (loads) => [rested(loads), loads.map(() => 0), loads.map(() => 0)];

/** The same after some seconds, which begin with `kicks` of the speeds, under steady `loads`. */
export function swung([n, speeds, lost], springs, kicks, loads, seconds) {
  const turns = springs.map(({ frequency }) => 2 * Math.PI * frequency);
  const pushes = inward(n, kicks);
  const size = square(lost);
  const against = Math.max(-sum(pushes.map((push, k) => push * lost[k])), 0);
  const share = size > 0 ? Math.min(against, size) / size : 0;
  const kicked = pushes.map((push, k) => speeds[k] + push + share * lost[k]);
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
  const fade = Math.exp(-seconds / FADE);
  const left = lost.map((each, k) => fade * ((1 - share) * each + (1 - kept) * kicked[k]));
  return [...[0, 1].map((part) => ends.map((end) => end[part])), left];
}
