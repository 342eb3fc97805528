// Loads glTF files with three.js in node.

import { readFile } from 'node:fs/promises';
import path from 'node:path';
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

/** A file's JSON, and what three.js makes of it. */
export async function load(file) {
  const { json, chunk } = parse(await readFile(file));
  const whole = await embedded(withoutTextures(json), chunk, path.dirname(file));
  const loader = new GLTFLoader();
  loader.setMeshoptDecoder(MeshoptDecoder);
  return { json, gltf: await loader.parseAsync(JSON.stringify(whole), '') };
}
