// All drives of one node's `extras.wrinkle`, in the order in which they act: what a player does in a frame.

import { anchorsOf } from './anchor.js';
import { fleshWeights } from './flesh.js';
import { fieldWeights, foldWeights } from './fold.js';
import { settling } from './spring.js';
import { touchWeights } from './touch.js';
import { wrinkleWeights } from './wrinkle.js';

/** The drives in order, each with its function: flesh and muscles move the skin on which the anchors of tools are. */
const KINDS = {
  ...{ muscles: wrinkleWeights, flesh: fleshWeights, touches: touchWeights },
  ...{ tools: wrinkleWeights, fields: fieldWeights, folds: foldWeights },
};
/** The layout of the extras that this driver reads; extras that name none have layout 1. */
export const LAYOUT = 3;
/** Of a loop that begins at rest so much of a swing is left when it is shown; and rounds that it plays unseen at most. */
const LEFT = 0.001;
const MOST_ROUNDS = 100;

/** Names for a message. */
export const quoted = (names) => [...new Set(names)].map((name) => JSON.stringify(name)).join(', ');

/** The names of the joints that a drive needs. */
function jointsOf(drive) {
  const { joint, parent = joint, other, turns, by, limb = [], row = [] } = drive;
  if (turns) return turns.flatMap(jointsOf);
  if (joint !== undefined) return [joint, parent, ...(other ? jointsOf(other) : [])];
  return [...anchorsOf(drive), ...(by ? [by] : []), ...limb, ...row.flatMap(anchorsOf)].flatMap((each) => each.joints);
}

export class Body {
  /**
   * wrinkle   a node's `extras.wrinkle`
   * hasJoint, hasTarget  whether there is a joint, or a morph target, of a name
   * warn      gets a line for each drive that is left out or does not show, and why
   */
  constructor(wrinkle, { hasJoint = () => true, hasTarget = () => true, warn = () => {} } = {}) {
    const { layout = 1 } = wrinkle;
    if (layout !== LAYOUT) warn(`its extras have layout ${layout}, and this driver reads ${LAYOUT}: bake its source again, or take its version's driver`);
    const all = layout !== LAYOUT ? [] : Object.keys(KINDS);
    this.drives = all.flatMap((kind) => (wrinkle[kind] ?? []).map((drive) => ({ kind, drive, state: {} })));
    this.drives = this.drives.filter(({ drive }) => {
      const { name, joint, targets } = drive;
      const called = name ?? `the fold of ${quoted([joint])}`;
      const absent = jointsOf(drive).filter((each) => !hasJoint(each));
      const lost = targets.filter((target) => !hasTarget(target));
      if (absent.length) warn(`${called} is left out, as there is no joint ${quoted(absent)}`);
      if (lost.length) warn(`${called} does not show, as there is no morph target ${quoted(lost)}`);
      return !absent.length;
    });
  }

  /** The touches that are driven. */
  get touches() {
    return this.drives.flatMap(({ kind, drive }) => (kind === 'touches' ? [drive] : []));
  }

  /**
   * How often a clip of so many seconds that loops is to be played unseen, from rest, before it is shown: then it begins as
   * it ends, as it does in a bake. 0 without springs.
   */
  unseenRounds(duration) {
    const springs = this.drives.flatMap(({ drive: { lag, by, release, modes = [] } }) => (lag ? [lag] : by ? [release] : modes));
    const rounds = springs.map((spring) => Math.ceil(-Math.log(LEFT) / (settling(spring) * duration)));
    return Math.min(Math.max(0, ...rounds), MOST_ROUNDS);
  }

  /**
   * The weights of a frame, by morph target.
   *
   * jointMatrixOf  a joint's name to its matrix to world space: 16 numbers, by columns
   * morphWeightOf  the weight of another morph target by name
   * clip, time     name and seconds
   * elapsed        seconds since the last frame; without it nothing lags and swings
   * hands          {NAME: {slide, depth}} where the player's own tips touch
   * during         a drive of flesh to what is known of its motion: see `KeyCurves.during`
   */
  weights(jointMatrixOf, { morphWeightOf = () => 0, clip, time, elapsed, hands = {}, during = () => ({}) } = {}) {
    const found = {};
    const weightOf = (name) => found[name] ?? morphWeightOf(name);
    for (const { kind, drive, state } of this.drives) {
      const known = kind === 'flesh' ? during(drive) : {};
      const how = { morphWeightOf: weightOf, clip, time, state, elapsed, hand: hands[drive.name], ...known };
      // A fold that no joint bends is driven as a tool.
      const weightsOf = kind === 'folds' && !drive.joint ? wrinkleWeights : KINDS[kind];
      const values = weightsOf(drive, jointMatrixOf, how);
      // A clip that was baked may have targets of its own, which stand for all.
      const alone = (drive.own ?? []).some(weightOf);
      drive.targets.forEach((name, k) => (found[name] = alone ? 0 : values[k]));
    }
    return found;
  }
}
