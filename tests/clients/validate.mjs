// The Khronos validator.

import { readFile } from 'node:fs/promises';
import path from 'node:path';
import validator from 'gltf-validator';

/** What it says of a file, external buffers and images included. */
export async function validate(file) {
  const report = await validator.validateBytes(new Uint8Array(await readFile(file)), {
    maxIssues: 0,
    writeTimestamp: false,
    externalResourceFunction: async (uri) =>
      new Uint8Array(await readFile(path.resolve(path.dirname(file), decodeURIComponent(uri)))),
  });
  const { numErrors, numWarnings, messages } = report.issues;
  return { numErrors, numWarnings, messages };
}
