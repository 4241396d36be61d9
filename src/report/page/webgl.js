// Programs and buffers of WebGL2.

// A program, and a function that sets all of its uniforms by their names.
function makeProgram(gl, { vertex, fragment }) {
  const program = gl.createProgram();
  for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, `#version 300 es\nprecision highp float;\n${text}`);
    gl.compileShader(shader);
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS) && !gl.isContextLost()) {
    const logs = gl.getAttachedShaders(program).map((shader) => gl.getShaderInfoLog(shader));
    throw new Error(`a shader does not compile: ${logs.join(" ")} ${gl.getProgramInfoLog(program)}`);
  }
  const setters = {
    [gl.FLOAT]: "uniform1fv",
    [gl.FLOAT_VEC2]: "uniform2fv",
    [gl.FLOAT_VEC3]: "uniform3fv",
    [gl.FLOAT_MAT4]: "uniformMatrix4fv",
  };
  const uniforms = [];
  for (let k = 0; k < (gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS) ?? 0); k++) {
    const { name, type } = gl.getActiveUniform(program, k);
    const place = gl.getUniformLocation(program, name);
    const matrix = type === gl.FLOAT_MAT4;
    const set = (values) => (matrix ? gl[setters[type]](place, false, values) : gl[setters[type]](place, values));
    uniforms.push([name.replace("[0]", ""), set]);
  }
  return {
    use(values) {
      gl.useProgram(program);
      for (const [name, set] of uniforms) set([values[name]].flat(2));
    },
  };
}

// A buffer of numbers that belong to vertices, or to instances. `place` is the location in the
// shader, `size` how many numbers each has.
function makeBuffer(gl, numbers, place, size, { normalized = false, instanced = false } = {}) {
  const types = new Map([
    [Uint8Array, gl.UNSIGNED_BYTE],
    [Int8Array, gl.BYTE],
    [Uint16Array, gl.UNSIGNED_SHORT],
    [Float32Array, gl.FLOAT],
  ]);
  const type = types.get(numbers.constructor);
  const buffer = gl.createBuffer();
  gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
  gl.bufferData(gl.ARRAY_BUFFER, numbers, gl.STATIC_DRAW);
  return {
    // Every `step`th vertex.
    use(step = 1) {
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
      gl.enableVertexAttribArray(place);
      gl.vertexAttribPointer(place, size, type, normalized, step * size * numbers.BYTES_PER_ELEMENT, 0);
      gl.vertexAttribDivisor(place, instanced ? 1 : 0);
    },
  };
}
