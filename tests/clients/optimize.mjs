// glTF-Transform, as its command line does: each function is a command with its options.

import { Logger, NodeIO } from '@gltf-transform/core';
import { ALL_EXTENSIONS } from '@gltf-transform/extensions';
import {
  dedup,
  flatten,
  inspect,
  instance,
  join,
  meshopt,
  palette,
  prune,
  resample,
  sparse,
  weld,
} from '@gltf-transform/functions';
import { MeshoptDecoder, MeshoptEncoder } from 'meshoptimizer';

async function transformed(input, output, transforms) {
  await Promise.all([MeshoptDecoder.ready, MeshoptEncoder.ready]);
  const io = new NodeIO()
    .registerExtensions(ALL_EXTENSIONS)
    .registerDependencies({ 'meshopt.decoder': MeshoptDecoder, 'meshopt.encoder': MeshoptEncoder });
  const document = await io.read(input);
  document.setLogger(new Logger(Logger.Verbosity.ERROR));
  const report = inspect(document);
  await document.transform(...transforms);
  await io.write(output, document);
  return JSON.parse(JSON.stringify(report, (key, value) => (key === 'format' ? undefined : value)));
}

/** Writes a file optimised, without simplification; what `inspect` says of the one that it was. */
export const optimize = (input, output) =>
  transformed(input, output, [dedup(), weld(), resample(), prune(), sparse(), meshopt({ encoder: MeshoptEncoder })]);

/** As `optimize --simplify false --resample false --compress false` of the command line, but for textures. */
export const tidy = (input, output) =>
  transformed(input, output, [
    dedup(),
    instance({ min: 5 }),
    palette({ min: 5 }),
    flatten(),
    join({ keepNamed: false, keepMeshes: false }),
    weld(),
    prune({ keepAttributes: false, keepIndices: false, keepLeaves: false, keepSolidTextures: false }),
    sparse(),
  ]);
