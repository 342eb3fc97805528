// glTF-Transform, as its command line's `optimize --compress meshopt` does.

import { Logger, NodeIO } from '@gltf-transform/core';
import { ALL_EXTENSIONS } from '@gltf-transform/extensions';
import { dedup, inspect, meshopt, prune, resample, sparse, weld } from '@gltf-transform/functions';
import { MeshoptDecoder, MeshoptEncoder } from 'meshoptimizer';

/** Writes a file optimised; what `inspect` says of the one that it was. */
export async function optimize(input, output) {
  await Promise.all([MeshoptDecoder.ready, MeshoptEncoder.ready]);
  const io = new NodeIO()
    .registerExtensions(ALL_EXTENSIONS)
    .registerDependencies({ 'meshopt.decoder': MeshoptDecoder, 'meshopt.encoder': MeshoptEncoder });
  const document = await io.read(input);
  document.setLogger(new Logger(Logger.Verbosity.ERROR));
  const report = inspect(document);
  await document.transform(dedup(), weld(), resample(), prune(), sparse(), meshopt({ encoder: MeshoptEncoder }));
  await io.write(output, document);
  return JSON.parse(JSON.stringify(report, (key, value) => (key === 'format' ? undefined : value)));
}
