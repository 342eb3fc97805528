// Poses glTF files with Babylon.js, without a screen: its loader, its animations, and the positions that it computes
// itself where a program asks for the shown mesh.

import { readFile, writeFile } from 'node:fs/promises';
import path from 'node:path';
// The packages of one file each: those of a module for each class have 10,800 files, and take npm 8 s of a processor.
import babylon from 'babylonjs';
import 'babylonjs-loaders';

const { LoadAssetContainerAsync, Logger, NullEngine, Scene, Vector3 } = babylon;
Logger.LogLevels = Logger.ErrorLogLevel;
const FRAMES_PER_SECOND = 60; // of the frames in which Babylon counts the times of glTF

/** The meshes of a node: itself, or, where it has several primitives, those below it, in file order. */
function parts(container, name) {
  const named = [...container.meshes, ...container.transformNodes].find((each) => each.name === name);
  if (named === undefined) throw new Error(`no node ${name}`);
  if (named.getTotalVertices?.() > 0) return [named];
  return container.meshes.filter((each) => each.parent === named && each.name.startsWith(`${name}_primitive`));
}

/**
 * Poses a node of a file.
 *
 * file    .glb
 * node    name of a node with a mesh
 * clip    name of an animation
 * times   seconds
 * output  file to write: float32, (times, vertices, 3) world-space positions, the mesh's primitives one after another
 *
 * Gives {vertices: number written}.
 */
export async function pose({ file, node, clip, times, output }) {
  const engine = new NullEngine();
  const scene = new Scene(engine);
  scene.useRightHandedSystem = true; // as glTF
  const bytes = new Uint8Array(await readFile(file));
  const container = await LoadAssetContainerAsync(bytes, scene, { pluginExtension: path.extname(file) });
  container.addAllToScene();
  for (const group of container.animationGroups) group.stop();
  const group = container.animationGroups.find(({ name }) => name === clip);
  if (group === undefined) throw new Error(`no clip ${clip}`);
  group.start(false);
  group.pause();
  const shown = [];
  const place = new Vector3();
  for (const time of times) {
    group.goToFrame(time * FRAMES_PER_SECOND);
    for (const each of [...container.transformNodes, ...container.meshes]) each.computeWorldMatrix(true);
    for (const skeleton of container.skeletons) skeleton.prepare(true);
    for (const part of parts(container, node)) {
      const positions = part.getPositionData(true, true);
      for (let at = 0; at < positions.length; at += 3) {
        const [x, y, z] = positions.subarray(at, at + 3);
        Vector3.TransformCoordinatesFromFloatsToRef(x, y, z, part.getWorldMatrix(), place);
        shown.push(place.x, place.y, place.z);
      }
    }
  }
  await writeFile(output, new Float32Array(shown));
  scene.dispose();
  engine.dispose();
  return { vertices: shown.length / 3 / times.length };
}
