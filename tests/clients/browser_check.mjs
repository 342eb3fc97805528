// Shows a file in an engine in the browser, and sends back where its vertex shaders put the vertices.
//
// The page's address tells the `engine`, the `clip`, the `times`, and how many `indices` and `vertices` the mesh has:
// by these its draw call is known. What is sent is float32, (times, vertices, 4), `gl_Position` as it is.

const asked = new URLSearchParams(location.search);
const indices = Number(asked.get('indices'));
const vertices = Number(asked.get('vertices'));
let seen = null; // gl_Position of the mesh's last draw call

const gl2 = WebGL2RenderingContext.prototype;
const { linkProgram, drawElements } = gl2;
gl2.linkProgram = function (program) {
  this.transformFeedbackVaryings(program, ['gl_Position'], this.INTERLEAVED_ATTRIBS);
  linkProgram.call(this, program);
};
gl2.drawElements = function (mode, count, ...rest) {
  drawElements.call(this, mode, count, ...rest);
  if (count === indices) seen = capture(this);
};

/** Draws once more with the shaders and attributes that are set, each vertex as a point, to memory. */
function capture(gl) {
  const found = new Float32Array(4 * vertices);
  const feedback = gl.createTransformFeedback();
  const buffer = gl.createBuffer();
  gl.bindTransformFeedback(gl.TRANSFORM_FEEDBACK, feedback);
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
  gl.deleteTransformFeedback(feedback);
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
};

const frame = () => new Promise(requestAnimationFrame);

async function main() {
  const show = await engines[asked.get('engine')](asked.get('clip'));
  const shown = [];
  for (const time of asked.get('times').split(',').map(Number)) {
    show(time);
    // What has been set is drawn a frame or two later.
    for (let count = 0; count < 5; count += 1) await frame();
    seen = null;
    while (seen === null) {
      show(time);
      await frame();
    }
    shown.push(seen);
  }
  await fetch('shown', { method: 'POST', body: new Blob(shown) });
}

main().catch((error) => fetch('failed', { method: 'POST', body: String(error?.stack ?? JSON.stringify(error)) }));
