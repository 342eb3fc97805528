// Answers requests of the tests until its input ends: node serve.mjs
//
// Each line of standard input is a JSON list: the name of a module beside this one, the name of a function in it, and
// its arguments. Each line of standard output is {answer} or {error}, in the order of the requests.

import { createInterface } from 'node:readline';

// Standard output is for answers alone.
console.log = console.info = console.error;

for await (const line of createInterface({ input: process.stdin })) {
  let reply;
  try {
    const [module, name, ...args] = JSON.parse(line);
    reply = { answer: await (await import(`./${module}.mjs`))[name](...args) };
  } catch (error) {
    reply = { error: error?.stack ?? String(error) };
  }
  process.stdout.write(`${JSON.stringify(reply)}\n`);
}
