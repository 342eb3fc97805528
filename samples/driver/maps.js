// Wrinkle maps in three.js: what `wrinkle maps` writes, blended into a mesh's own material by the same weights as morph
// targets. The mesh stays as it is. Other engines need the same few lines in their material's normal.

import { DataTexture, RepeatWrapping, ShaderChunk, TextureLoader, Vector4 } from 'three';
import { Body } from './body.js';
import { jointFinder, nameOf, named } from './joints.js';

const texel = (...values) => Object.assign(new DataTexture(new Uint8Array(values), 1, 1), { needsUpdate: true });
const [FLAT, WHITE] = [texel(128, 128, 255, 255), texel(255, 255, 255, 255)];

/** GLSL of one set: the sum of masks times weights, then its slopes and its share of the sky. */
const shaderOf = ({ masks }, k) => `{
  float m = ${masks.length ? masks.map((_, i) => `dot( texture2D( wrinkleMask${k}_${i}, vWrinkleUv ), wrinkleWeight${k}_${i} )`).join(' + ') : `wrinkleWeight${k}_0.x`};
  vec3 n = texture2D( wrinkleNormal${k}, vWrinkleUv ).xyz * 2.0 - 1.0;
  wrinkleSlope += m * n.xy / max( n.z, 0.1 );
  wrinkleSeen *= 1.0 + m * ( texture2D( wrinkleSky${k}, vWrinkleUv ).r - 1.0 );
}`;

/** GLSL of the texture coordinates of the maps: three.js declares those of the asset's own textures alone. */
const coordinatesOf = ({ texCoord, KHR_texture_transform: { offset = [0, 0], rotation = 0, scale = [1, 1] } = {} }) => {
  const attribute = texCoord < 4 ? `uv${texCoord || ''}` : `texcoord_${texCoord}`;
  const vec = (...values) => `vec2( ${values.map((value) => value.toFixed(8)).join(', ')} )`;
  const [c, s] = [Math.cos(rotation), Math.sin(rotation)];
  return {
    declared: `${texCoord ? `#ifndef USE_UV${texCoord}\nattribute vec2 ${attribute};\n#endif\n` : ''}varying vec2 vWrinkleUv;`,
    set: `vWrinkleUv = mat2( ${vec(c, -s)}, ${vec(s, c)} ) * ( ${attribute} * ${vec(...scale)} ) + ${vec(...offset)};`,
  };
};

/** Plays the maps of one folder on the meshes below a root. */
export class WrinkleMaps {
  static async load(folder, root) {
    const data = await (await fetch(`${folder}/maps.json`)).json();
    const files = data.materials.flatMap(({ sets }) => sets.flatMap(({ normal, ao, weights }) => [normal, ao, ...weights.map(({ mask }) => mask)]));
    const loader = new TextureLoader().setPath(`${folder}/`);
    const distinct = [...new Set(files.filter(Boolean))];
    const images = await Promise.all(distinct.map((file) => loader.loadAsync(file)));
    for (const image of images) Object.assign(image, { flipY: false, wrapS: RepeatWrapping, wrapT: RepeatWrapping, anisotropy: 8 });
    return new WrinkleMaps(data, root, new Map(distinct.map((file, k) => [file, images[k]])));
  }

  constructor({ materials, nodes }, root, images) {
    this.bodies = nodes.map(({ node, wrinkle }) => {
      const [object] = named(root, node);
      const meshes = [];
      object.traverse((each) => each.isMesh && meshes.push(each));
      const jointOf = jointFinder(root, object, meshes, console.warn);
      const uniforms = materials.filter((each) => each.node === node).map((each) => this.blend(each, meshes, images));
      // The first has the asset's own morph targets, which raise brows and move the anchors of tools.
      const [{ morphTargetDictionary: numbers = {}, morphTargetInfluences: influences = [] }] = meshes;
      const morphWeightOf = (target) => influences[numbers[target]] ?? 0;
      const body = new Body(wrinkle, { hasJoint: jointOf, warn: (line) => console.warn(`wrinkle: ${node}: ${line}`) });
      return { body, jointOf, morphWeightOf, uniforms };
    });
  }

  /** Lets the materials of meshes blend maps; the vectors of weights, each with the targets of its components. */
  blend(described, meshes, images) {
    const { name, material: number, sets } = described;
    const coordinates = coordinatesOf(described);
    const known = sets.map(({ normal, ao, weights }) => {
      const masks = [...new Set(weights.map(({ mask }) => mask).filter(Boolean))];
      const rows = (masks.length ? masks : [undefined]).map((file) => weights.filter(({ mask }) => mask === file));
      const vectors = rows.map((row) => ({ targets: row.map(({ target }) => target), value: new Vector4() }));
      return { normal: images.get(normal) ?? FLAT, sky: images.get(ao) ?? WHITE, masks: masks.map((file) => images.get(file)), vectors };
    });
    const uniforms = {};
    known.forEach(({ normal, sky, masks, vectors }, k) => {
      Object.assign(uniforms, { [`wrinkleNormal${k}`]: { value: normal }, [`wrinkleSky${k}`]: { value: sky } });
      masks.forEach((value, i) => (uniforms[`wrinkleMask${k}_${i}`] = { value }));
      vectors.forEach((vector, i) => (uniforms[`wrinkleWeight${k}_${i}`] = vector));
    });
    const declared = Object.keys(uniforms).map((key) => `uniform ${key.startsWith('wrinkleWeight') ? 'vec4' : 'sampler2D'} ${key};`);
    for (const mesh of meshes.filter((each) => number === null || nameOf(each.material) === name || meshes.length === 1)) {
      // Other meshes may have the material, too, without maps or with weights of their own.
      const material = (mesh.material = mesh.material.clone());
      const { channel, offset, repeat, rotation } = material.map ?? FLAT;
      material.normalMap ??= Object.assign(texel(128, 128, 255, 255), { channel, offset, repeat, rotation });
      material.customProgramCacheKey = () => JSON.stringify([coordinates, sets]);
      material.onBeforeCompile = (shader) => {
        Object.assign(shader.uniforms, uniforms);
        shader.vertexShader = `${coordinates.declared}\n${shader.vertexShader}`
          .replace('#include <uv_vertex>', `#include <uv_vertex>\n${coordinates.set}`);
        const sum = `mapN.xy *= normalScale;
          vec2 wrinkleSlope = vec2( 0.0 );
          ${known.map(shaderOf).join('\n')}
          #ifndef USE_TANGENT
            wrinkleSlope.y = - wrinkleSlope.y; // such tangents run along the texture's v, which points down
          #endif
          mapN = normalize( vec3( mapN.xy / max( mapN.z, 0.1 ) + wrinkleSlope, 1.0 ) );`;
        shader.fragmentShader = `${declared.join('\n')}\nvarying vec2 vWrinkleUv;\nfloat wrinkleSeen = 1.0;\n${shader.fragmentShader}`
          .replace('#include <normal_fragment_maps>', ShaderChunk.normal_fragment_maps.replace('mapN.xy *= normalScale;', sum))
          .replace('#include <aomap_fragment>', '#include <aomap_fragment>\nreflectedLight.indirectDiffuse *= wrinkleSeen;');
      };
      material.needsUpdate = true;
    }
    return known.flatMap(({ vectors }) => vectors);
  }

  /** As `WrinkleDriver.update`. */
  update(clip, time, elapsed = 0) {
    for (const { body, jointOf, morphWeightOf, uniforms } of this.bodies) {
      const found = body.weights((name) => jointOf(name).matrixWorld.elements, { morphWeightOf, clip, time, elapsed });
      for (const { targets, value } of uniforms.flat()) value.set(...[0, 1, 2, 3].map((i) => found[targets[i]] ?? 0));
    }
  }
}
