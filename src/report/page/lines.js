// Connections as lines, as wide on the screen wherever they are.

const LINE_SHADER = {
  vertex: `
    uniform mat4 eyeFromSource, eyeFromTarget, projection;
    uniform vec3 together, apart;
    uniform vec2 pixelSize;
    uniform float width, near;
    layout(location = 0) in vec3 from;
    layout(location = 1) in vec3 onto;
    layout(location = 2) in float agrees;
    flat out vec3 colour;
    void main() {
      colour = agrees > 0.0 ? together : apart;
      vec4 a = eyeFromSource * vec4(from, 1.0);
      vec4 b = eyeFromTarget * vec4(onto, 1.0);
      // An end behind the eye has no place on the screen: the line begins where it comes into view.
      if (a.z > -near && b.z < -near) a = mix(a, b, (a.z + near) / (a.z - b.z));
      if (b.z > -near && a.z < -near) b = mix(b, a, (b.z + near) / (b.z - a.z));
      a = projection * a;
      b = projection * b;
      vec4 end = (gl_VertexID & 2) == 0 ? a : b;
      vec2 along = (b.xy / b.w - a.xy / a.w) / pixelSize;
      along = dot(along, along) > 0.0 ? normalize(along) : vec2(1.0, 0.0);
      float side = (gl_VertexID & 1) == 0 ? -1.0 : 1.0;
      end.xy += 0.5 * side * width * vec2(-along.y, along.x) * pixelSize * end.w;
      gl_Position = end;
    }`,
  fragment: `
    flat in vec3 colour;
    out vec4 pixel;
    void main() { pixel = vec4(colour, 1.0); }`,
};

const TOGETHER = "#009e73";
const APART = "#cc79a7";
const LINE_WIDTH = 1.3;

function makeLines(gl, weights) {
  const program = makeProgram(gl, LINE_SHADER);
  const instanced = true;
  const buffers = [
    makeBuffer(gl, floatsOf(weights.from), 0, 3, { instanced }),
    makeBuffer(gl, floatsOf(weights.onto), 1, 3, { instanced }),
    makeBuffer(gl, bytesOf(weights.agree), 2, 1, { instanced }),
  ];
  return {
    // `model` is where the source is now.
    draw({ view, projection, near, density, width, height }, model) {
      program.use({
        eyeFromSource: product(view, model),
        eyeFromTarget: view,
        projection,
        together: rgbOf(TOGETHER),
        apart: rgbOf(APART),
        pixelSize: [2 / width, 2 / height],
        width: LINE_WIDTH * density,
        near,
      });
      for (const buffer of buffers) buffer.use();
      gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, weights.drawn);
    },
  };
}
