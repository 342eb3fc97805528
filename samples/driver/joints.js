// Joints and other nodes of a three.js scene, by the names that they have in the file.

import { quoted } from './body.js';

/** An object's name in the file: GLTFLoader changes names that it finds hard to bind, and keeps the file's. */
export const nameOf = ({ userData, name }) => userData.name ?? name;

/** The objects below a root that have a name in the file. */
export function named(root, name) {
  const found = [];
  root.traverse((object) => nameOf(object) === name && found.push(object));
  return found;
}

/** The names from the root down to an object, with / before each. */
const pathOf = (object) => (object ? `${pathOf(object.parent)}/${nameOf(object)}` : '');

/** The meshes of one node that have morph targets: all have the same, unlike those of nodes below it. */
export function morphMeshes(node) {
  const found = [];
  node.traverse((each) => each.morphTargetDictionary && found.push(each));
  const targetsOf = (mesh) => Object.keys(mesh.morphTargetDictionary).join('\n');
  return found.filter((each) => targetsOf(each) === targetsOf(found[0]));
}

/**
 * A function from a joint's name to its object, or undefined.
 *
 * Joints of the body's own skin go first, as characters of one file often share names; then those of other skins, and
 * at last any object. A body without skin is its own joint.
 */
export function jointFinder(root, body, meshes, warn) {
  const bones = meshes.flatMap(({ skeleton }) => skeleton?.bones ?? []);
  const objects = [];
  root.traverse((object) => objects.push(object));
  const ranks = [bones.length ? bones : [body], objects.filter(({ isBone }) => isBone)];
  ranks.push(objects.filter(({ userData }) => userData.name !== undefined), objects);
  const found = new Map();
  return (name) => {
    if (!found.has(name)) {
      const havingIts = (test) => ranks.map((rank) => [...new Set(rank)].filter(test));
      // Where joints share a name, extras have a path in its place.
      const having = havingIts((object) => nameOf(object) === name);
      if (name.includes('/')) having.push(...havingIts((object) => pathOf(object).endsWith(`/${name}`)));
      const [first, second] = having.find(({ length }) => length) ?? [];
      if (second) warn(`several joints are named ${quoted([name])}; the first is taken`);
      found.set(name, first);
    }
    return found.get(name);
  };
}
