/** @typedef {import("./background_pictures.js").Bitmap} Bitmap */

/** A program of two shaders, and its uniforms by name. */
class Program {
  /**
   * @param {WebGL2RenderingContext} gl
   * @param {{vertex: string, fragment: string}} shaders
   */
  constructor(gl, shaders) {
    this.gl = gl;
    this.program = gl.createProgram();
    for (const [type, source] of [
      [gl.VERTEX_SHADER, shaders.vertex],
      [gl.FRAGMENT_SHADER, shaders.fragment],
    ]) {
      const shader = /** @type {WebGLShader} */ (gl.createShader(/** @type {number} */ (type)));
      gl.shaderSource(shader, /** @type {string} */ (source));
      gl.compileShader(shader);
      gl.attachShader(this.program, shader);
    }
    gl.linkProgram(this.program);
    if (!gl.getProgramParameter(this.program, gl.LINK_STATUS) && !gl.isContextLost()) {
      throw new Error(
        `a program of the player cannot be used: ${gl.getProgramInfoLog(this.program)}`,
      );
    }
  }

  /** Draw with it from now on. */
  use() {
    this.gl.useProgram(this.program);
  }

  /**
   * Set a uniform number or vector of the program in use.
   * @param {string} name
   * @param {number[]} values one or two
   */
  set(name, ...values) {
    const place = this.gl.getUniformLocation(this.program, name);
    if (values.length === 2) this.gl.uniform2f(place, values[0], values[1]);
    else this.gl.uniform1f(place, values[0]);
  }

  /**
   * Set a uniform truth value of the program in use.
   * @param {string} name
   * @param {boolean} value
   */
  setFlag(name, value) {
    this.gl.uniform1i(this.gl.getUniformLocation(this.program, name), value ? 1 : 0);
  }

  /**
   * Let a uniform sampler of the program in use take the texture of a unit.
   * @param {string} name
   * @param {number} unit
   */
  setUnit(name, unit) {
    this.gl.uniform1i(this.gl.getUniformLocation(this.program, name), unit);
  }

  /**
   * Set a uniform matrix (4, 4), row by row, of the program in use.
   * @param {string} name
   * @param {number[]} matrix
   */
  setMatrix(name, matrix) {
    this.gl.uniformMatrix4fv(this.gl.getUniformLocation(this.program, name), true, matrix);
  }

  /**
   * Attributes of vertices in buffers: of each buffer its parts, name and number of floats.
   * @param {[WebGLBuffer, [string, number][]][]} buffers
   * @param {WebGLBuffer} indices
   */
  vertexArray(buffers, indices) {
    const { gl } = this;
    const array = gl.createVertexArray();
    gl.bindVertexArray(array);
    for (const [buffer, parts] of buffers) {
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
      const stride = 4 * parts.reduce((sum, [, count]) => sum + count, 0);
      let offset = 0;
      for (const [name, count] of parts) {
        const place = gl.getAttribLocation(this.program, name);
        if (place >= 0) {
          gl.enableVertexAttribArray(place);
          gl.vertexAttribPointer(place, count, gl.FLOAT, false, stride, offset);
        }
        offset += 4 * count;
      }
    }
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, indices);
    gl.bindVertexArray(null);
    return array;
  }
}

/** @type {WeakMap<WebGL2RenderingContext, Map<object, Program>>} */
const programs = new WeakMap();

/**
 * The program of two shaders, made once.
 * @param {WebGL2RenderingContext} gl
 * @param {{vertex: string, fragment: string}} shaders
 */
export function programOf(gl, shaders) {
  const known = programs.get(gl) ?? new Map();
  programs.set(gl, known);
  const program = known.get(shaders) ?? new Program(gl, shaders);
  known.set(shaders, program);
  return program;
}

/**
 * A buffer with content.
 * @param {WebGL2RenderingContext} gl
 * @param {Float32Array | Uint16Array | Uint32Array} content
 */
export function bufferOf(gl, content) {
  const target = content instanceof Float32Array ? gl.ARRAY_BUFFER : gl.ELEMENT_ARRAY_BUFFER;
  const buffer = gl.createBuffer();
  gl.bindVertexArray(null);
  gl.bindBuffer(target, buffer);
  gl.bufferData(target, content, gl.DYNAMIC_DRAW);
  return buffer;
}

/**
 * Write the first floats of a buffer.
 * @param {WebGL2RenderingContext} gl
 * @param {WebGLBuffer} buffer
 * @param {Float32Array} content
 */
export function writeBuffer(gl, buffer, content) {
  gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
  gl.bufferSubData(gl.ARRAY_BUFFER, 0, content);
}

/**
 * Write the indices of a buffer that vertex arrays have.
 * @param {WebGL2RenderingContext} gl
 * @param {WebGLBuffer} buffer
 * @param {Uint32Array} content
 */
export function writeIndices(gl, buffer, content) {
  gl.bindVertexArray(null);
  gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, buffer);
  gl.bufferSubData(gl.ELEMENT_ARRAY_BUFFER, 0, content);
}

/** A texture that bitmaps of one size are written to. */
export class Texture {
  /**
   * @param {WebGL2RenderingContext} gl
   * @param {number} width
   * @param {number} height
   */
  constructor(gl, width, height) {
    this.gl = gl;
    this.width = width;
    this.height = height;
    this.texture = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, this.texture);
    const levels = Math.floor(Math.log2(Math.max(width, height))) + 1;
    gl.texStorage2D(gl.TEXTURE_2D, levels, gl.RGBA8, width, height);
    for (const axis of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) {
      gl.texParameteri(gl.TEXTURE_2D, axis, gl.CLAMP_TO_EDGE);
    }
    this.setMipmaps(false);
  }

  /** @param {Uint8ClampedArray} values (height, width, 4) */
  write(values) {
    const { gl, width, height } = this;
    const bytes = new Uint8Array(values.buffer, values.byteOffset, values.length);
    gl.bindTexture(gl.TEXTURE_2D, this.texture);
    gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, bytes);
  }

  /**
   * Sample averages where there are several texels a pixel; or the nearest texels alone.
   * @param {boolean} isOn
   */
  setMipmaps(isOn) {
    this.useMipmaps(isOn);
    if (isOn) this.gl.generateMipmap(this.gl.TEXTURE_2D);
  }

  /**
   * Sample the mipmaps that `setMipmaps` has made, or the nearest texels alone, which is faster.
   * @param {boolean} isOn
   */
  useMipmaps(isOn) {
    const { gl } = this;
    gl.bindTexture(gl.TEXTURE_2D, this.texture);
    gl.texParameteri(
      gl.TEXTURE_2D,
      gl.TEXTURE_MIN_FILTER,
      isOn ? gl.LINEAR_MIPMAP_LINEAR : gl.LINEAR,
    );
  }

  /** Draw with it from now on. */
  use() {
    this.gl.bindTexture(this.gl.TEXTURE_2D, this.texture);
  }

  /** Free it. */
  close() {
    this.gl.deleteTexture(this.texture);
  }
}

/** The picture on a canvas, which has its size: WebGL's first row is the bottom one. */
export class CanvasPicture {
  /** @param {WebGL2RenderingContext} gl */
  constructor(gl) {
    this.gl = gl;
    this.framebuffer = gl.createFramebuffer();
    /** @type {Texture | null} what is written to it; made when it is needed */
    this.written = null;
  }

  /** Draw on all of it from now on. */
  use() {
    const { gl } = this;
    gl.viewport(0, 0, gl.drawingBufferWidth, gl.drawingBufferHeight);
  }

  /** Its pixels (height, width, 4). */
  read() {
    const { gl } = this;
    const { drawingBufferWidth: width, drawingBufferHeight: height } = gl;
    const pixels = new Uint8Array(4 * width * height);
    gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
    const turned = new Uint8ClampedArray(pixels.length);
    for (let row = 0; row < height; row++) {
      const from = 4 * width * (height - 1 - row);
      turned.set(pixels.subarray(from, from + 4 * width), 4 * width * row);
    }
    return turned;
  }

  /**
   * Replace it.
   * @param {Uint8ClampedArray} pixels (height, width, 4)
   */
  write(pixels) {
    const { gl } = this;
    const { drawingBufferWidth: width, drawingBufferHeight: height } = gl;
    const { READ_FRAMEBUFFER, COLOR_ATTACHMENT0, TEXTURE_2D } = gl;
    gl.bindFramebuffer(READ_FRAMEBUFFER, this.framebuffer);
    if (!this.written) {
      this.written = new Texture(gl, width, height);
      const { texture } = this.written;
      gl.framebufferTexture2D(READ_FRAMEBUFFER, COLOR_ATTACHMENT0, TEXTURE_2D, texture, 0);
    }
    this.written.write(pixels);
    gl.blitFramebuffer(0, 0, width, height, 0, height, width, 0, gl.COLOR_BUFFER_BIT, gl.NEAREST);
    gl.bindFramebuffer(READ_FRAMEBUFFER, null);
  }

  /** Free what it holds. */
  close() {
    this.written?.close();
    this.gl.deleteFramebuffer(this.framebuffer);
  }
}
