// Wrinkles in clips that were never baked: what `wrinkle bake` leaves in a node's extras is enough.
// `Body` needs neither a browser nor three.js; `WrinkleDriver` is how three.js uses it.

import { Body, quoted } from './body.js';
import { fleshWeights } from './flesh.js';
import { fieldWeights, foldWeights } from './fold.js';
import { KeyCurves } from './keys.js';
import { jointFinder, morphMeshes, named, nameOf } from './joints.js';
import { placeOnSkin, touchWeights } from './touch.js';
import { wrinkleWeights } from './wrinkle.js';

/** Frames of a second of a clip that is played unseen. */
const FPS = 60;

export { Body, fieldWeights, fleshWeights, foldWeights, placeOnSkin, touchWeights, wrinkleWeights };

/**
 * Drives every body below a three.js object. Call `update` each frame, after the mixer and before rendering, with the
 * clip's name and time, and the seconds since the last call: without these, time's own, which stop where a clip loops.
 * The console says what is left out, and why. With the file's `clips`, flesh follows a smooth curve through their keys;
 * while clips blend, `others` names those beside the first: `{ CLIP: { time, share } }`, where 1 is all of the motion.
 */
export class WrinkleDriver {
  constructor(root, clips = root.animations) {
    Object.assign(this, { root, curves: new KeyCurves(root, clips), bodies: [], hands: {}, times: {} });
    root.traverse((object) => object.userData.wrinkle && this.add(object, object.userData.wrinkle));
    if (!this.bodies.length) console.warn('wrinkle: nothing to drive: no object has extras.wrinkle and morph targets');
  }

  add(object, wrinkle) {
    const warn = (line) => console.warn(`wrinkle: ${nameOf(object)}: ${line}`);
    // The other parts of a mesh that was split stand beside it.
    const { parts = [] } = wrinkle;
    const places = parts.map((name) => named(this.root, name));
    parts.forEach((name, k) => places[k].length || warn(`there is no part ${quoted([name])}`));
    const meshes = [object, ...places.flat()].flatMap(morphMeshes);
    const jointOf = jointFinder(this.root, object, meshes, warn);
    const hasTarget = (target) => meshes.some((each) => target in each.morphTargetDictionary);
    const body = new Body(wrinkle, { hasJoint: jointOf, hasTarget, warn });
    const jointMatrixOf = (name) => jointOf(name).matrixWorld.elements;
    if (meshes.length) this.bodies.push({ body, meshes, jointOf, jointMatrixOf });
  }

  /** Slides the skin of a touch forward and sideways, scene units; null lets it go. A VR hand or a mouse calls this. */
  touch(name, slide) {
    this.hands[name] = slide && { depth: this.hands[name]?.depth ?? 0, slide };
  }

  /** Dents the skin of a touch by a depth, scene units. */
  press(name, depth) {
    this.hands[name] = { slide: this.hands[name]?.slide ?? [0, 0], depth };
  }

  /**
   * Brings springs to the beginning of a clip that loops, which begins as it ends: plays it unseen as often as they need.
   * Call it when the loop starts, with its name and seconds, and what poses the object at a time of the clip, such as
   * `(time) => mixer.setTime(time)`.
   */
  settle(clip, duration, pose) {
    const rounds = Math.max(0, ...this.bodies.map(({ body }) => body.unseenRounds(duration)));
    const frames = Math.max(Math.ceil(FPS * duration), 1);
    for (let frame = 0; frame <= rounds * frames; frame++) {
      const time = ((frame % frames) / frames) * duration;
      pose(time);
      this.update(clip, time, frame ? duration / frames : NaN); // at first all is at rest
    }
  }

  update(clip, time, elapsed = Math.max(time - this.time, 0), others = {}) {
    const rest = Object.values(others).reduce((sum, { share }) => sum - share, 1);
    const playing = Object.entries({ [clip]: { time, share: rest }, ...others }).map(([name, each]) => ({
      ...{ clip: name, before: this.times[name] ?? NaN },
      ...each,
    }));
    Object.assign(this, { time, times: Object.fromEntries(playing.map((each) => [each.clip, each.time])) });
    this.root.updateMatrixWorld();
    for (const { body, meshes, jointOf, jointMatrixOf } of this.bodies) {
      const { morphTargetDictionary: numbers, morphTargetInfluences: influences } = meshes[0];
      const found = body.weights(jointMatrixOf, {
        ...{ clip, time, elapsed, hands: this.hands },
        morphWeightOf: (name) => influences[numbers[name]] ?? 0,
        during: ({ joint, at }) => this.curves.blended(jointOf(joint), at, playing, elapsed),
      });
      for (const { morphTargetDictionary: places, morphTargetInfluences: all } of meshes)
        for (const [name, place] of Object.entries(places))
          if (name in found) all[place] = found[name];
          // The asset's own morph targets move other parts as the first.
          else if (name in numbers) all[place] = influences[numbers[name]];
    }
  }
}
