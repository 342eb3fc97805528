// Runs the text of a pixel shader all over a texture, each texture's texel under its pixel: base64 of RGBA bytes.
//
// `images` are files by the names of what a shader samples, such as Normal1, and `vectors` numbers by those of its uniforms.

const VERTEX = `#version 300 es
out vec2 uv;
void main() {
  uv = vec2(gl_VertexID & 1, gl_VertexID >> 1) * 2.0;
  gl_Position = vec4(uv * 2.0 - 1.0, 0.0, 1.0);
}`;

export async function blended(text, size, images, vectors) {
  const gl = Object.assign(document.createElement('canvas'), { width: size, height: size }).getContext('webgl2', { preserveDrawingBuffer: true });
  const program = gl.createProgram();
  for (const [kind, source] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, text]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
  gl.useProgram(program);
  for (let k = 0; k < gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS); k += 1) {
    const { name } = gl.getActiveUniform(program, k);
    const place = gl.getUniformLocation(program, name);
    const vector = Object.keys(vectors).find((each) => name.endsWith(each));
    if (vector) gl.uniform4fv(place, vectors[vector]);
    else {
      // A sampler's name begins with that of its texture.
      const image = Object.keys(images).find((each) => name.split('sampler')[0].includes(each));
      const picture = await createImageBitmap(await (await fetch(images[image])).blob(), { premultiplyAlpha: 'none', colorSpaceConversion: 'none' });
      gl.activeTexture(gl.TEXTURE0 + k);
      gl.bindTexture(gl.TEXTURE_2D, gl.createTexture());
      gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, gl.RGBA, gl.UNSIGNED_BYTE, picture);
      for (const filter of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, filter, gl.NEAREST);
      gl.uniform1i(place, k);
    }
  }
  gl.drawArrays(gl.TRIANGLES, 0, 3);
  const found = new Uint8Array(4 * size * size);
  gl.readPixels(0, 0, size, size, gl.RGBA, gl.UNSIGNED_BYTE, found);
  return btoa(Array.from(found, (byte) => String.fromCharCode(byte)).join(''));
}
