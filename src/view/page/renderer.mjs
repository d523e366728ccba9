// Textures, programs and draws. The only code that talks to the GPU.

import { counters, errorTexture, interleave, section, texelNumbers } from "./data.mjs";
import { COVER, MODES, PICTURE, contractionShader } from "./shaders.mjs";
import { Placement, cameraRays, times } from "./camera.mjs";

const UNIT = { samples: 0, ranges: 1, radiances: 2, errors: 3, sky: 4, numbers: 5, transfer: 6, surroundings: 8 };

export class Renderer {
  /** Uploads everything; `data` is not needed afterwards. */
  constructor(canvas, data) {
    const gl = canvas.getContext("webgl2", { alpha: false, antialias: false, preserveDrawingBuffer: true });
    if (!gl) throw new Error("this browser has no WebGL2, which the page needs to draw");
    if (!gl.getExtension("EXT_color_buffer_float")) {
      throw new Error("this GPU cannot render to 16-bit floats (EXT_color_buffer_float), which relighting needs");
    }
    this.gl = gl;
    this.canvas = canvas;
    this.header = data.header;
    this.placement = new Placement(data.header.volume);
    this.norm = 1;
    this.held = []; // textures by their unit
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    this.uploadVolume(data);
    this.uploadTransfer(data);
    this.picture = this.program(PICTURE);
    const { texture, scene } = data.header;
    this.contraction = this.program(contractionShader(texture.bands, scene ? scene.luminaires.length : null, this.width));
    const light = gl.getUniformBlockIndex(this.contraction.handle, "Light");
    gl.uniformBlockBinding(this.contraction.handle, light, 0);
    this.weights = gl.createBuffer();
    gl.bindBufferBase(gl.UNIFORM_BUFFER, 0, this.weights);
    this.framebuffer = gl.createFramebuffer();
    gl.bindVertexArray(gl.createVertexArray());
    this.setConstants();
  }

  setConstants() {
    const { gl, picture, contraction, header, placement } = this;
    gl.useProgram(picture.handle);
    for (const name of ["samples", "ranges", "radiances", "errors", "sky"]) gl.uniform1i(picture.at(name), UNIT[name]);
    gl.uniform3fv(picture.at("cells"), placement.cells);
    gl.uniform3fv(picture.at("texels"), header.texture.texels);
    gl.uniform3iv(picture.at("blocks"), header.volume.blocks);
    gl.uniform1f(picture.at("side"), header.volume.sign);
    // The gradient comes with the sign of the solid side; the normal points to the other.
    gl.uniformMatrix3fv(picture.at("normalFromGradient"), true, placement.normalFromGradient);
    gl.useProgram(contraction.handle);
    gl.uniform1i(contraction.at("numbers"), UNIT.numbers);
    gl.uniform1i(contraction.at("transfer"), UNIT.transfer);
    gl.uniform1i(contraction.at("surroundings"), UNIT.surroundings);
  }

  texture(unit, target, filter) {
    const { gl } = this;
    gl.activeTexture(gl.TEXTURE0 + unit);
    if (this.held[unit]) gl.deleteTexture(this.held[unit]);
    const texture = gl.createTexture();
    this.held[unit] = texture;
    gl.bindTexture(target, texture);
    gl.texParameteri(target, gl.TEXTURE_MIN_FILTER, filter);
    gl.texParameteri(target, gl.TEXTURE_MAG_FILTER, filter);
    for (const wrap of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T, gl.TEXTURE_WRAP_R]) {
      gl.texParameteri(target, wrap, gl.CLAMP_TO_EDGE);
    }
    return texture;
  }

  upload3D(unit, filter, internal, format, type, dims, numbers) {
    const { gl } = this;
    const most = gl.getParameter(gl.MAX_3D_TEXTURE_SIZE);
    if (Math.max(...dims) > most) throw new Error(`${dims.join(" × ")} is more than this GPU's ${most} along an axis`);
    const texture = this.texture(unit, gl.TEXTURE_3D, filter);
    gl.texStorage3D(gl.TEXTURE_3D, 1, internal, ...dims);
    if (numbers) gl.texSubImage3D(gl.TEXTURE_3D, 0, 0, 0, 0, ...dims, format, type, numbers);
    return texture;
  }

  uploadVolume(data) {
    const { gl } = this;
    const { samples, blocks, coding } = data.header.volume;
    const isByte = coding === "byte";
    const Type = isByte ? Uint8Array : Uint16Array;
    const [one, two, type] = isByte ? [gl.R8, gl.RG8, gl.UNSIGNED_BYTE] : [gl.R16F, gl.RG16F, gl.HALF_FLOAT];
    this.upload3D(UNIT.samples, gl.LINEAR, one, gl.RED, type, samples, section(data, "samples", Type));
    this.upload3D(UNIT.ranges, gl.NEAREST, two, gl.RG, type, blocks, section(data, "ranges", Type));
  }

  /** Takes another texture of the same volume, with the same bands; contract it next. */
  takeTransfer(data) {
    this.header = data.header;
    this.uploadTransfer(data);
    this.setConstants();
  }

  uploadTransfer(data) {
    const { gl } = this;
    const { texels, coding } = data.header.texture;
    this.width = Math.min(4096, gl.getParameter(gl.MAX_TEXTURE_SIZE));
    const numbers = texelNumbers(data);
    this.upload3D(UNIT.numbers, gl.NEAREST, gl.R32UI, gl.RED_INTEGER, gl.UNSIGNED_INT, texels, numbers);
    const errors = errorTexture(data, numbers);
    this.upload3D(UNIT.errors, gl.LINEAR, gl.R8, gl.RED, gl.UNSIGNED_BYTE, texels, errors);
    this.uploadPlanes(UNIT.transfer, data, "transfer", coding === "byte");
    if (data.header.scene) this.uploadPlanes(UNIT.surroundings, data, "surroundings", false);
    this.radiances = this.upload3D(UNIT.radiances, gl.LINEAR, gl.RGBA16F, gl.RGBA, gl.HALF_FLOAT, texels, null);
    const error = gl.getError();
    if (error !== gl.NO_ERROR) throw new Error(`the GPU refused the textures (error ${error}): too large for its memory?`);
  }

  /** The planes of a section, four to a layer: the valid texels row by row. */
  uploadPlanes(unit, data, name, isByte) {
    const { gl } = this;
    const { valid } = data.header.texture;
    const planes = section(data, name, isByte ? Int8Array : Uint16Array);
    const groups = Math.ceil(planes.length / valid / 4), height = Math.ceil(valid / this.width);
    this.texture(unit, gl.TEXTURE_2D_ARRAY, gl.NEAREST);
    gl.texStorage3D(gl.TEXTURE_2D_ARRAY, 1, isByte ? gl.RGBA8_SNORM : gl.RGBA16F, this.width, height, groups);
    for (let g = 0; g < groups; g++) {
      const type = isByte ? gl.BYTE : gl.HALF_FLOAT;
      const numbers = interleave(planes, valid, g, this.width * height);
      gl.texSubImage3D(gl.TEXTURE_2D_ARRAY, 0, 0, 0, g, this.width, height, 1, gl.RGBA, type, numbers);
    }
  }

  program(fragment) {
    const { gl } = this;
    const handle = gl.createProgram();
    for (const [type, text] of [[gl.VERTEX_SHADER, COVER], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(type);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
      gl.attachShader(handle, shader);
    }
    gl.linkProgram(handle);
    if (!gl.getProgramParameter(handle, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(handle));
    const places = new Map();
    const at = (name) => {
      if (!places.has(name)) places.set(name, gl.getUniformLocation(handle, name));
      return places.get(name);
    };
    return { handle, at };
  }

  /** Shows a small lat-long picture (half floats) behind the surface. */
  setSky(width, height, halves) {
    const { gl } = this;
    this.texture(UNIT.sky, gl.TEXTURE_2D, gl.LINEAR);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_S, gl.REPEAT);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGB16F, width, height, 0, gl.RGB, gl.HALF_FLOAT, halves);
  }

  /**
   * Multiplies all texels with a light on the GPU. `light` has `weights` (four numbers a coefficient), `norm` by which
   * radiance is to be multiplied again, `albedo`, `emitted`, `powers` (three numbers a luminaire), `shown` (layers and
   * tail), and for points without texels `open` and `cut`, with `openAlbedo`.
   */
  contract(light) {
    const { gl, contraction, picture } = this;
    const [mx, my, mz] = this.header.texture.texels;
    this.norm = light.norm;
    gl.bindBuffer(gl.UNIFORM_BUFFER, this.weights);
    gl.bufferData(gl.UNIFORM_BUFFER, light.weights, gl.DYNAMIC_DRAW);
    gl.useProgram(contraction.handle);
    gl.uniform3fv(contraction.at("albedo"), light.albedo);
    gl.uniform3fv(contraction.at("emitted"), light.emitted);
    if (light.powers.length > 0) gl.uniform3fv(contraction.at("powers"), light.powers);
    gl.uniform1fv(contraction.at("shown"), light.shown);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.framebuffer);
    gl.viewport(0, 0, mx, my);
    for (let z = 0; z < mz; z++) {
      gl.framebufferTextureLayer(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, this.radiances, 0, z);
      gl.uniform1i(contraction.at("slice"), z);
      gl.drawArrays(gl.TRIANGLES, 0, 3);
    }
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.useProgram(picture.handle);
    gl.uniform3fv(picture.at("albedo"), light.openAlbedo);
    gl.uniform3fv(picture.at("emitted"), light.emitted);
    gl.uniform3fv(picture.at("openLight"), light.open);
    gl.uniform3fv(picture.at("cut"), light.cut);
    counters.contractions++;
  }

  /** Draws into what is bound, `width` × `height` pixels. */
  draw(view, width, height, mode, supersampling) {
    const { gl, picture, placement } = this;
    const rays = cameraRays(placement, view, width / height);
    gl.useProgram(picture.handle);
    gl.viewport(0, 0, width, height);
    gl.uniform2f(picture.at("size"), width, height);
    gl.uniform3fv(picture.at("origin"), placement.cellPoint(rays.origin));
    for (const name of ["originX", "originY", "direction", "directionX", "directionY"]) {
      gl.uniform3fv(picture.at(name), placement.cellVector(rays[name]));
    }
    // The probe's frame: the glTF frame, turned back about y.
    const angle = (-view.rotation * Math.PI) / 180;
    const turn = [Math.cos(angle), 0, Math.sin(angle), 0, 1, 0, -Math.sin(angle), 0, Math.cos(angle)];
    for (const [uniform, ray] of [["skyRay", rays.sky], ["skyX", rays.skyX], ["skyY", rays.skyY]]) {
      gl.uniform3fv(picture.at(uniform), times(turn, times(placement.gltfFromWorld, ray)));
    }
    gl.uniform1f(picture.at("level"), this.textureNumber(view.isovalue));
    gl.uniform1f(picture.at("exposure"), this.norm * 2 ** view.exposure);
    gl.uniform1f(picture.at("skyStrength"), view.strength / this.norm);
    gl.uniform1i(picture.at("supersampling"), supersampling);
    gl.uniform1i(picture.at("mode"), mode);
    gl.uniform4fv(picture.at("background"), view.background);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    counters.frames++;
    this.lastRays = rays;
  }

  /** An isovalue (in the file's values) as the texture's numbers. */
  textureNumber(isovalue) {
    const { slope, inter, scale, offset } = this.header.volume;
    return ((isovalue - inter) / slope - offset) / scale;
  }

  /** The picture on the canvas; of it only `rows` from `first` on, if they are given. */
  show(view, mode, supersampling, first = 0, rows = this.canvas.height) {
    const { gl, canvas } = this;
    gl.enable(gl.SCISSOR_TEST);
    gl.scissor(0, first, canvas.width, rows);
    this.draw(view, canvas.width, canvas.height, mode, supersampling);
    gl.disable(gl.SCISSOR_TEST);
  }

  /** Numbers of a small picture (four a pixel), rows from the bottom. */
  read(view, width, height, mode, supersampling = 1) {
    const { gl } = this;
    const target = gl.createTexture();
    gl.activeTexture(gl.TEXTURE0 + 7);
    gl.bindTexture(gl.TEXTURE_2D, target);
    gl.texStorage2D(gl.TEXTURE_2D, 1, gl.RGBA32F, width, height);
    const framebuffer = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, framebuffer);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, target, 0);
    this.draw(view, width, height, mode, supersampling);
    const numbers = new Float32Array(4 * width * height);
    gl.readPixels(0, 0, width, height, gl.RGBA, gl.FLOAT, numbers);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.deleteFramebuffer(framebuffer);
    gl.deleteTexture(target);
    return numbers;
  }

  /** Waits until the GPU has done what it was told. */
  finish() {
    const { gl } = this;
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
  }

  /** Texture fetches to a pixel (mean over all, and over covered ones) and milliseconds to a frame at full size. */
  measure(view, frames) {
    const { canvas } = this;
    const width = Math.min(320, canvas.width), height = Math.max(1, Math.round((width * canvas.height) / canvas.width));
    const numbers = this.read(view, width, height, MODES.fetches);
    let all = 0, covered = 0, pixels = 0;
    for (let i = 0; i < numbers.length; i += 4) {
      all += numbers[i];
      if (numbers[i + 1] > 0) [covered, pixels] = [covered + numbers[i], pixels + 1];
    }
    const times = [];
    for (let i = 0; i < frames; i++) {
      this.finish();
      const start = performance.now();
      this.show(view, MODES.light, 1);
      this.finish();
      times.push(performance.now() - start);
    }
    times.sort((a, b) => a - b);
    return {
      fetchesPerPixel: all / (width * height),
      fetchesPerCoveredPixel: pixels > 0 ? covered / pixels : 0,
      fetchesPerFrame: (all / (width * height)) * canvas.width * canvas.height,
      milliseconds: times[frames >> 1],
      pixels: [canvas.width, canvas.height],
      renderer: this.rendererName(),
    };
  }

  rendererName() {
    const { gl } = this;
    const info = gl.getExtension("WEBGL_debug_renderer_info");
    return gl.getParameter(info ? info.UNMASKED_RENDERER_WEBGL : gl.RENDERER);
  }
}
