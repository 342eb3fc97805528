// Writes streams.json: node streams.mjs, beside an `npm install meshoptimizer`.
//
// Each stream carries what meshoptimizer's own decoder makes of it.

import { createHash } from 'node:crypto';
import { writeFile } from 'node:fs/promises';
import { MeshoptDecoder, MeshoptEncoder } from 'meshoptimizer';

await Promise.all([MeshoptEncoder.ready, MeshoptDecoder.ready]);

let seed = 1;
const random = () => (seed = (Math.imul(seed, 1103515245) + 12345) & 0x7fffffff) / 0x7fffffff;
const streams = [];
const VECTORS = 32;

function add(stored, count, stride, mode, filter, version) {
  const data = MeshoptEncoder.encodeGltfBuffer(stored, count, stride, mode, version);
  const decoded = new Uint8Array(count * stride);
  MeshoptDecoder.decodeGltfBuffer(decoded, count, stride, data, mode, filter);
  const exact = filter === 'NONE' || filter === 'EXPONENTIAL';
  streams.push({
    count, stride, mode, filter, version,
    data: Buffer.from(data).toString('base64'),
    ...(exact
      ? { sha256: createHash('sha256').update(decoded).digest('hex') }
      : { decoded: Buffer.from(decoded).toString('base64') }),
  });
}

for (const version of [0, 1]) {
  for (const [stride, count] of [[4, 1], [4, 257], [8, 17], [12, 90], [20, 40], [64, 18], [256, 33]]) {
    for (const spread of [1, 20, 256]) {
      const bytes = new Uint8Array(count * stride);
      bytes.forEach((_, i) => {
        const scale = i % stride % 5 === 0 ? 0.2 : i % stride % 7 === 0 ? 0 : 1;
        bytes[i] = (i >= stride ? bytes[i - stride] : 7) + Math.floor((random() - 0.5) * spread * scale);
      });
      if (count * stride < 800 || (spread === 20 && version === 1)) {
        add(bytes, count, stride, 'ATTRIBUTES', 'NONE', version);
      }
    }
    const words = new Uint16Array((count * stride) / 2).map((_, i) => Math.sin(i / 50) * 3000 + random() * 40);
    if (words.length < 420) add(new Uint8Array(words.buffer), count, stride, 'ATTRIBUTES', 'NONE', version);
    const floats = new Float32Array((count * stride) / 4).map((_, i) => Math.sin(i / 50) + random() / 1000);
    if (floats.length < 260) add(new Uint8Array(floats.buffer), count, stride, 'ATTRIBUTES', 'NONE', version);
  }
  const vectors = (size) =>
    new Float32Array(
      Array.from({ length: VECTORS }, () => {
        const vector = Array.from({ length: size }, () => random() * 2 - 1);
        return Array.from({ length: 4 }, (_, k) => (k < size ? vector[k] / Math.hypot(...vector) : 0.5));
      }).flat(),
    );
  const filtered = (name, stride, stored) => add(stored, VECTORS, stride, 'ATTRIBUTES', name, version);
  for (const [stride, bits] of [[4, 8], [4, 5], [8, 16], [8, 10]]) {
    filtered('OCTAHEDRAL', stride, MeshoptEncoder.encodeFilterOct(vectors(3), VECTORS, stride, bits));
    filtered('COLOR', stride, MeshoptEncoder.encodeFilterColor(vectors(4).map(Math.abs), VECTORS, stride, bits));
  }
  for (const bits of [16, 12, 4]) filtered('QUATERNION', 8, MeshoptEncoder.encodeFilterQuat(vectors(4), VECTORS, 8, bits));
  for (const bits of [23, 8]) {
    const spread = vectors(4).map((x) => x * 10 ** (random() * 20 - 10));
    filtered('EXPONENTIAL', 16, MeshoptEncoder.encodeFilterExp(spread, VECTORS, 16, bits, 'Separate'));
  }
}

for (const quads of [1, 24]) {
  for (const stride of [2, 4]) {
    for (const order of ['grid', 'jumps', 'noise']) {
      const indices = [];
      for (let quad = 0; quad < quads; ++quad) {
        const a = Math.floor(quad / 8) * 9 + (quad % 8);
        const jump = order === 'jumps' && quad % 3 === 0 ? Math.floor(random() * 3000) : 0;
        indices.push(a, a + 1, a + 9 + jump, a + 1, a + 10, a + 9);
      }
      if (order === 'noise') indices.forEach((_, i) => (indices[i] = Math.floor(random() * (stride === 2 ? 6e4 : 4e9))));
      const typed = stride === 2 ? Uint16Array.from(indices) : Uint32Array.from(indices);
      for (const mode of ['TRIANGLES', 'INDICES']) {
        add(new Uint8Array(typed.buffer), indices.length, stride, mode, 'NONE', 0);
      }
    }
  }
}

await writeFile(new URL('streams.json', import.meta.url), `[\n${streams.map((each) => JSON.stringify(each)).join(',\n')}\n]\n`);
