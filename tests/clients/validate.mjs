// The Khronos validator: node validate.mjs FILE... prints a JSON object per line, in the order of the files.

import { readFile } from 'node:fs/promises';
import path from 'node:path';
import validator from 'gltf-validator';

for (const file of process.argv.slice(2)) {
  const report = await validator.validateBytes(new Uint8Array(await readFile(file)), {
    maxIssues: 0,
    writeTimestamp: false,
    externalResourceFunction: async (uri) =>
      new Uint8Array(await readFile(path.resolve(path.dirname(file), decodeURIComponent(uri)))),
  });
  const { numErrors, numWarnings, messages } = report.issues;
  console.log(JSON.stringify({ file, numErrors, numWarnings, messages }));
}
