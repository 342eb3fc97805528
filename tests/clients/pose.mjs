// Poses glTF files with three.js as it would draw them.

import { writeFile } from 'node:fs/promises';
import { AnimationMixer, Matrix3, Vector3, Vector4 } from 'three';
import { load } from './load.mjs';

/** The number of a named (or numbered) member of a list of the document. */
function find(list, wanted, what, file) {
  const index = typeof wanted === 'number' ? wanted : (list ?? []).findIndex(({ name }) => name === wanted);
  if (list?.[index] === undefined) throw new Error(`${file}: no ${what} ${JSON.stringify(wanted)}`);
  return index;
}

/** The meshes of a node, one for each primitive in file order, without those of its child nodes. */
function primitives(object, associations) {
  if (object.isMesh) return [object];
  const isOwn = (child) => child.isMesh && associations.get(child)?.nodes === undefined;
  const group = object.children.find((child) => child.isGroup && associations.get(child)?.nodes === undefined);
  return (group ?? object).children.filter(isOwn);
}

/** A mesh's normal as the vertex shader leaves it: morphed, skinned, by the normal matrix; unit. */
function vertexNormal(mesh, index, normalMatrix, target) {
  const { attributes, morphAttributes } = mesh.geometry;
  target.fromBufferAttribute(attributes.normal, index);
  const delta = new Vector3();
  (morphAttributes.normal ?? []).forEach((attribute, i) => {
    const weight = mesh.morphTargetInfluences[i];
    if (weight !== 0) target.addScaledVector(delta.fromBufferAttribute(attribute, index), weight);
  });
  if (mesh.isSkinnedMesh) {
    const direction = mesh.applyBoneTransform(index, new Vector4(target.x, target.y, target.z, 0));
    target.set(direction.x, direction.y, direction.z);
  }
  return target.applyMatrix3(normalMatrix).normalize();
}

async function posed({ file, node, clip, times, vertices, output, normals }, { json, gltf }) {
  const index = find(json.nodes, node, 'node', file);
  const object = await gltf.parser.getDependency('node', index);
  const meshes = primitives(object, gltf.parser.associations);
  if (meshes.length === 0) throw new Error(`${file}: node ${JSON.stringify(node)} has no mesh`);
  let root = object;
  while (root.parent) root = root.parent;

  const mixer = new AnimationMixer(root);
  const animation = clip === null ? null : gltf.animations[find(json.animations, clip, 'clip', file)];
  const action = animation && mixer.clipAction(animation).play();

  const counts = meshes.map((mesh) => mesh.geometry.attributes.position.count);
  const owners = meshes.flatMap((mesh, i) => Array.from({ length: counts[i] }, (_, vertex) => [mesh, vertex]));
  const chosen = vertices ? vertices.map((vertex) => owners[vertex]) : owners;
  const positions = new Float32Array(times.length * chosen.length * 3);
  const directions = normals ? new Float32Array(positions.length) : null;
  const target = new Vector3();
  let at = 0;
  for (const time of times) {
    if (action) {
      // Set, not advanced: a looping action would start again at its very end.
      action.time = Math.min(Math.max(time, 0), animation.duration);
      mixer.update(0);
    }
    root.updateMatrixWorld(true);
    const normalMatrices = new Map(meshes.map((mesh) => [mesh, new Matrix3().getNormalMatrix(mesh.matrixWorld)]));
    for (const [mesh, vertex] of chosen) {
      mesh.getVertexPosition(vertex, target).applyMatrix4(mesh.matrixWorld).toArray(positions, at);
      if (directions) vertexNormal(mesh, vertex, normalMatrices.get(mesh), target).toArray(directions, at);
      at += 3;
    }
  }
  mixer.stopAllAction();
  mixer.uncacheRoot(root);
  await writeFile(output, positions);
  if (normals) await writeFile(normals, directions);
  return { vertices: chosen.length, primitives: counts };
}

/**
 * Poses nodes of files, each file read once. A request has
 *
 * file      .glb or .gltf
 * node      name or index of a node with a mesh
 * clip      name or index of an animation; null is the pose as stored
 * times     seconds, held at both ends of the clip
 * vertices  optional list: these alone
 * output    file to write: float32, (times, vertices, 3) world-space positions, the mesh's primitives one after
 *           another in file order
 * normals   optional file to write: the same for unit normals
 *
 * and its answer {vertices: number written, primitives: [vertex counts]}.
 */
export async function pose(requests) {
  const loaded = new Map();
  const answers = [];
  for (const request of requests) {
    if (!loaded.has(request.file)) loaded.set(request.file, await load(request.file));
    answers.push(await posed(request, loaded.get(request.file)));
  }
  return answers;
}
