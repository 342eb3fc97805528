// Draws files in turns, and leaves in `window.found` the median milliseconds of a frame of each, or what went wrong.

import * as THREE from 'three';
import { GLTFLoader } from 'three/addons/loaders/GLTFLoader.js';

const SIZE = 512; // pixels along a side

/** A file that is shown, as a function of the time. */
async function shown(renderer, url, name) {
  const gltf = await new GLTFLoader().loadAsync(url);
  const scene = new THREE.Scene();
  scene.add(gltf.scene, new THREE.HemisphereLight(0xffffff, 0x404040, 3));
  gltf.scene.traverse((each) => {
    each.frustumCulled = false;
  });
  const box = new THREE.Box3().setFromObject(gltf.scene);
  const radius = box.getSize(new THREE.Vector3()).length() / 2;
  const middle = box.getCenter(new THREE.Vector3());
  const camera = new THREE.PerspectiveCamera(40, 1, radius / 10, radius * 10);
  camera.position.copy(middle).add(new THREE.Vector3(0, 0, 3 * radius));
  camera.lookAt(middle);
  const mixer = new THREE.AnimationMixer(gltf.scene);
  const clip = gltf.animations.find((each) => each.name === name);
  mixer.clipAction(clip).play();
  const pixel = new Uint8Array(4);
  const gl = renderer.getContext();
  return (share) => {
    mixer.setTime(share * clip.duration);
    renderer.render(scene, camera);
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel); // waits until all is drawn
  };
}

async function main() {
  const { count, clip, frames } = await (await fetch('asked.json')).json();
  const renderer = new THREE.WebGLRenderer();
  renderer.setSize(SIZE, SIZE);
  const shows = [];
  for (let k = 0; k < count; k += 1) shows.push(await shown(renderer, `${k}.glb`, clip));
  const times = shows.map(() => []);
  for (let frame = -3; frame < frames; frame += 1) {
    shows.forEach((show, k) => {
      const start = performance.now();
      show(Math.max(frame, 0) / frames);
      if (frame >= 0) times[k].push(performance.now() - start);
    });
    await new Promise(requestAnimationFrame);
  }
  return times.map((each) => each.sort((a, b) => a - b)[Math.floor(frames / 2)]);
}

main().then(
  (found) => (window.found = found),
  (error) => (window.found = String(error?.stack ?? error)),
);
