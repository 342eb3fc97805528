// Poses glTF files with three.js as it would draw them: node pose.mjs < requests.json
//
// Standard input is a JSON list of requests:
//   file      .glb or .gltf
//   node      name or index of a node with a mesh
//   clip      name or index of an animation; null is the pose as stored
//   times     seconds, held at both ends of the clip
//   vertices  optional list: these alone
//   output    file to write: float32, (times, vertices, 3) world-space positions, the mesh's primitives one
//             after another in file order
//   normals   optional file to write: the same for unit normals
// Standard output is a JSON list of {vertices: number written, primitives: [vertex counts]}.

import { readFile, writeFile } from 'node:fs/promises';
import path from 'node:path';
import { AnimationMixer, Matrix3, Vector3, Vector4 } from 'three';
import { GLTFLoader } from 'three/addons/loaders/GLTFLoader.js';
import { MeshoptDecoder } from 'three/addons/libs/meshopt_decoder.module.js';

// What three.js expects of a browser.
globalThis.self ??= globalThis;
globalThis.ProgressEvent ??= class ProgressEvent extends Event {};

const JSON_CHUNK = 0x4e4f534a;

/** The JSON of a file and its binary chunk, if any. */
function parse(bytes) {
  if (bytes.toString('latin1', 0, 4) !== 'glTF') return { json: JSON.parse(bytes), chunk: null };
  let json = null;
  let chunk = null;
  for (let start = 12; start < bytes.length; ) {
    const size = bytes.readUInt32LE(start);
    const body = bytes.subarray(start + 8, start + 8 + size);
    if (bytes.readUInt32LE(start + 4) === JSON_CHUNK) json = JSON.parse(body);
    else chunk ??= body;
    start += 8 + size;
  }
  return { json, chunk };
}

/** Without pictures, which node cannot decode; the rest stays. */
function withoutTextures(json) {
  const bare = { ...json };
  for (const key of ['images', 'textures', 'samplers']) delete bare[key];
  const prune = (value) => {
    if (Array.isArray(value)) return value.map(prune);
    if (value === null || typeof value !== 'object') return value;
    const kept = Object.entries(value).filter(([key]) => !key.endsWith('Texture'));
    return Object.fromEntries(kept.map(([key, inner]) => [key, prune(inner)]));
  };
  if (json.materials) bare.materials = json.materials.map(prune);
  return bare;
}

/** Buffers as data URIs, so that the loader fetches nothing. */
async function embedded(json, chunk, folder) {
  const buffers = await Promise.all(
    (json.buffers ?? []).map(async (buffer) => {
      if (buffer.uri?.startsWith('data:')) return buffer;
      if (buffer.uri === undefined && chunk === null) return buffer;
      const bytes =
        buffer.uri === undefined ? chunk : await readFile(path.resolve(folder, decodeURIComponent(buffer.uri)));
      return { ...buffer, uri: `data:application/octet-stream;base64,${bytes.toString('base64')}` };
    }),
  );
  return { ...json, buffers };
}

async function load(file) {
  const { json, chunk } = parse(await readFile(file));
  const whole = await embedded(withoutTextures(json), chunk, path.dirname(file));
  const loader = new GLTFLoader();
  loader.setMeshoptDecoder(MeshoptDecoder);
  return { json, gltf: await loader.parseAsync(JSON.stringify(whole), '') };
}

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

async function pose({ file, node, clip, times, vertices, output, normals }, { json, gltf }) {
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

let text = '';
for await (const part of process.stdin) text += part;
const loaded = new Map();
const answers = [];
for (const request of JSON.parse(text)) {
  if (!loaded.has(request.file)) loaded.set(request.file, await load(request.file));
  answers.push(await pose(request, loaded.get(request.file)));
}
console.log(JSON.stringify(answers));
