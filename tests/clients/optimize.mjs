// Runs a file through glTF-Transform as its command line's `optimize --compress meshopt` does:
// node optimize.mjs IN OUT prints a JSON object: what `inspect` says of IN.

import { Logger, NodeIO } from '@gltf-transform/core';
import { ALL_EXTENSIONS } from '@gltf-transform/extensions';
import { dedup, inspect, meshopt, prune, resample, sparse, weld } from '@gltf-transform/functions';
import { MeshoptDecoder, MeshoptEncoder } from 'meshoptimizer';

const [input, output] = process.argv.slice(2);
await Promise.all([MeshoptDecoder.ready, MeshoptEncoder.ready]);
const io = new NodeIO()
  .registerExtensions(ALL_EXTENSIONS)
  .registerDependencies({ 'meshopt.decoder': MeshoptDecoder, 'meshopt.encoder': MeshoptEncoder });
const document = await io.read(input);
document.setLogger(new Logger(Logger.Verbosity.ERROR)); // others go to standard output
const report = inspect(document);
await document.transform(dedup(), weld(), resample(), prune(), sparse(), meshopt({ encoder: MeshoptEncoder }));
await io.write(output, document);
console.log(JSON.stringify(report, (key, value) => (key === 'format' ? undefined : value)));
