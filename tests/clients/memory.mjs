// What three.js allocates on a GPU for the morph targets of a file.

import { WebGLMorphtargets } from 'three/src/renderers/webgl/WebGLMorphtargets.js';
import { load } from './load.mjs';

const LARGEST = 16384; // texels along a side, of nearly all GPUs

/** The bytes of the textures that three.js makes of a file's meshes, as it does before it draws them. */
export async function targetBytes(file) {
  const { gltf } = await load(file);
  let bytes = 0;
  const setValue = (_, name, texture) => (bytes += name === 'morphTargetsTexture' ? texture.image.data.byteLength : 0);
  const program = { getUniforms: () => ({ setValue }) };
  const targets = new WebGLMorphtargets({}, { maxTextureSize: LARGEST }, {});
  gltf.scene.traverse((each) => each.morphTargetInfluences && targets.update(each, each.geometry, program));
  return bytes;
}
