// The sample driver's answers to the vectors of `samples/driver/vectors.json`, without three.js.

import { readFile } from 'node:fs/promises';
import { Body, LAYOUT } from '../../samples/driver/body.js';

/**
 * By case `runs`, for each frame of each run the weights of the case's targets, `unseen`, how often each run is played
 * before it is shown, and `problems`, what the driver says of a
 * file that lacks the first joint and the first target, and of one of a later layout.
 */
export async function play(path) {
  const cases = Object.entries(JSON.parse(await readFile(path)));
  return Object.fromEntries(
    cases.map(([name, each]) => [name, { runs: each.runs.map((run) => weightsOf(each, run)), unseen: unseenOf(each), problems: problemsOf(each) }]),
  );
}

const unseenOf = ({ wrinkle, runs }) => runs.map(({ seconds }) => new Body(wrinkle).unseenRounds(seconds));

function problemsOf({ wrinkle, joints, targets }) {
  const problems = [];
  const isNot = ([first]) => (name) => name !== first;
  const warn = (line) => problems.push(line);
  new Body(wrinkle, { hasJoint: isNot(joints), hasTarget: isNot(targets), warn });
  new Body({ ...wrinkle, layout: LAYOUT + 1 }, { warn });
  return problems;
}

function weightsOf({ wrinkle, joints, morphs, targets }, { clip, times, elapsed, matrices, morphs: rows, hands }) {
  const body = new Body(wrinkle);
  return elapsed.map((seconds, frame) => {
    const k = frame % times.length;
    const [touch] = body.touches;
    const [forward, sideways, depth] = hands?.[k] ?? [];
    const found = body.weights((joint) => matrices[k][joints.indexOf(joint)], {
      ...{ clip, time: times[k], elapsed: seconds ?? NaN },
      hands: hands?.[k] ? { [touch.name]: { slide: [forward, sideways], depth } } : {},
      morphWeightOf: (name) => rows[k]?.[morphs.indexOf(name)] ?? 0,
    });
    return targets.map((name) => found[name]);
  });
}
