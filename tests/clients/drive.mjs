// What three.js has of a clip: morph weights while it plays, and its tracks.

import { AnimationMixer } from 'three';
import { readFile } from 'node:fs/promises';
import { register } from 'node:module';
import { WrinkleDriver } from '../../samples/driver/driver.js';
import { load } from './load.mjs';

// Modules of the page get their three.js from here.
const resolve = `(name, context, next) =>
  next(name, name.startsWith('three') ? { ...context, parentURL: ${JSON.stringify(import.meta.url)} } : context)`;
register(`data:text/javascript,export const resolve = ${encodeURIComponent(resolve)}`);
const { WrinkleMaps } = await import('../../samples/driver/maps.js');

/**
 * Plays a clip.
 *
 * file   .glb or .gltf with the body
 * anim   the file with the clip; the body's where left out
 * clip   name of the animation; null is the pose as stored
 * times  seconds
 * node   name of the node with the mesh
 * drive  whether the page's driver sets the weights each frame
 * elapsed seconds since the time before, for each; left out, the times' own
 * loops  whether the driver brings springs to the beginning of a loop first
 * places  for each time where the player has put the body, [x, y, z]; left out, at the origin
 * into    {clip, shares}: for each time the share of another clip that is faded into; left out, there is none
 *
 * Gives {weights: for each time and part of the mesh those of the targets, targets: names}.
 */
export async function drive({ file, anim, clip, times, node, drive: driven, elapsed = [], loops = false, places = [], into }) {
  const body = await load(file);
  const clips = (anim ? await load(anim) : body).gltf.animations;
  const found = clips.find(({ name }) => name === clip);
  if (clip !== null && !found) throw new Error(`no clip ${clip}`);
  const root = body.gltf.scene;
  const mixer = new AnimationMixer(root);
  const action = found && mixer.clipAction(found).play();
  const next = into && mixer.clipAction(clips.find(({ name }) => name === into.clip)).play();
  const driver = driven ? new WrinkleDriver(root, clips) : null;
  const meshesOf = (isOne) => {
    const parts = [];
    root.traverse((object) => {
      if (isOne(object)) object.traverse((each) => each.morphTargetInfluences && parts.push(each));
    });
    return parts;
  };
  const named = meshesOf(({ userData }) => userData.name === node);
  // gltfpack puts a mesh below its node, without a name.
  const parts = named.length ? named : meshesOf(({ userData }) => userData.wrinkle !== undefined);
  const pose = (time) => {
    if (action) action.time = time;
    if (next) next.time = time;
    mixer.update(0);
  };
  if (loops) driver.settle(clip, found.duration, pose);
  const weights = times.map((time, frame) => {
    const share = into?.shares[frame];
    if (into) [action, next].forEach((each, k) => each.setEffectiveWeight(k ? share : 1 - share));
    pose(time);
    if (places[frame]) root.position.set(...places[frame]);
    driver?.update(clip, time, elapsed[frame], into ? { [into.clip]: { time, share } } : {});
    return parts.map((part) => [...part.morphTargetInfluences]);
  });
  return { weights, targets: Object.keys(parts[0].morphTargetDictionary) };
}

/** The weights, by target, that the page gives to the maps of a folder at times of a clip. */
export async function mapped(file, folder, clip, times) {
  const { gltf } = await load(file);
  const mixer = new AnimationMixer(gltf.scene);
  mixer.clipAction(gltf.animations.find(({ name }) => name === clip)).play();
  const maps = new WrinkleMaps(JSON.parse(await readFile(`${folder}/maps.json`)), gltf.scene, new Map());
  return times.map((time) => {
    mixer.setTime(time);
    gltf.scene.updateMatrixWorld();
    maps.update(clip, time);
    const vectors = maps.bodies.flatMap(({ uniforms }) => uniforms.flat());
    return Object.fromEntries(vectors.flatMap(({ targets, value }) => targets.map((target, k) => [target, value.toArray()[k]])));
  });
}

/** What the driver says on the console of a file. */
export async function warnings(file) {
  const { gltf } = await load(file);
  const said = [];
  const warn = console.warn;
  console.warn = (line) => said.push(line);
  try {
    new WrinkleDriver(gltf.scene).update(null, 0);
  } finally {
    console.warn = warn;
  }
  return said;
}

/** A clip's tracks: [{node, path, times, values}], nodes by their names in the file. */
export async function tracks(file, clip) {
  const { gltf } = await load(file);
  // gltfpack puts a quantised mesh below its node, without a name; three.js takes the object's number then.
  const named = ({ userData, parent }) => userData.name ?? (parent ? named(parent) : '');
  const names = {};
  gltf.scene.traverse((object) => (names[object.name || object.uuid] = named(object)));
  const found = gltf.animations.find(({ name }) => name === clip);
  const listed = found.tracks.map(({ name, times, values }) => {
    const [object, path] = name.split('.');
    return { node: names[object], path, times: [...times], values: [...values] };
  });
  return listed;
}
