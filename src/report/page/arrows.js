// Motions that nothing holds, as arrows: straight ones slide, bent ones turn.

const ARROW_SHADER = {
  vertex: `
    uniform mat4 view, projection;
    layout(location = 0) in vec3 place;
    layout(location = 1) in vec3 normal;
    out float light;
    void main() {
      vec4 eye = view * vec4(place, 1.0);
      light = abs(dot(normalize(mat3(view) * normal), normalize(eye.xyz)));
      gl_Position = projection * eye;
    }`,
  fragment: `
    uniform vec3 colour;
    in float light;
    out vec4 pixel;
    void main() { pixel = vec4(colour * (0.7 + 0.3 * light), 1.0); }`,
};

const ARROW_COLOUR = rgbOf("#d55e00");
const SIDES = 16;

const across = (axis) => unit(cross(axis, Math.abs(axis[1]) < 0.9 ? [0, 1, 0] : [1, 0, 0]));

// A tube along a path: places with the direction and the radius there. `side` is a unit vector
// across all directions. Cylinders, cones and rings are tubes. Six numbers a vertex, place and
// normal, three vertices a triangle.
function tube(path, side) {
  const rings = path.map(({ place, along, radius }) =>
    Array.from({ length: SIDES + 1 }, (_, k) => {
      const normal = rotated(side, along, (2 * Math.PI * k) / SIDES);
      return [...added(place, scaled(normal, radius)), ...normal];
    }));
  const triangles = [];
  for (let k = 1; k < rings.length; k++) {
    for (let s = 0; s < SIDES; s++) {
      const [a, b, c, d] = [rings[k - 1][s], rings[k - 1][s + 1], rings[k][s], rings[k][s + 1]];
      triangles.push(...a, ...b, ...c, ...c, ...b, ...d);
    }
  }
  return triangles;
}

const straight = (ends, along) => tube(ends.map(([place, radius]) => ({ place, along, radius })), across(along));

function arrowTriangles({ center, axis, turns, slides }, radius) {
  const up = unit(axis);
  const thick = 0.012 * radius;
  const shaft = (half, width) => straight([-half, half].map((height) => [added(center, scaled(up, height)), width]), up);
  const head = ({ place, along }) =>
    straight([[place, 0], [place, 3.2 * thick], [added(place, scaled(along, 9 * thick)), 0]], along);
  const triangles = [];
  if (slides) {
    triangles.push(...shaft(0.75 * radius, thick));
    for (const along of [up, scaled(up, -1)]) {
      triangles.push(...head({ place: added(center, scaled(along, 0.75 * radius)), along }));
    }
  }
  if (turns) {
    const ring = (angle) => {
      const outward = rotated(across(up), up, angle);
      return { place: added(center, scaled(outward, 0.55 * radius)), along: cross(up, outward), radius: thick };
    };
    const path = Array.from({ length: 65 }, (_, k) => ring((1.6 * Math.PI * k) / 64));
    const [first, last] = [path[0], path[64]];
    triangles.push(...tube(path, up), ...head(last), ...head({ ...first, along: scaled(first.along, -1) }));
    if (!slides) triangles.push(...shaft(0.75 * radius, 0.4 * thick));
  }
  return triangles;
}

function makeArrows(gl, arrows, radius) {
  const program = makeProgram(gl, ARROW_SHADER);
  const vertices = arrows.flatMap((arrow) => arrowTriangles(arrow, radius));
  const count = vertices.length / 6;
  const part = (first) => Float32Array.from({ length: 3 * count }, (_, k) => vertices[6 * Math.floor(k / 3) + first + (k % 3)]);
  const buffers = [makeBuffer(gl, part(0), 0, 3), makeBuffer(gl, part(3), 1, 3)];
  return {
    draw({ view, projection }) {
      if (count === 0) return;
      // Over all else, so that points do not hide them.
      gl.clear(gl.DEPTH_BUFFER_BIT);
      program.use({ view, projection, colour: ARROW_COLOUR });
      for (const buffer of buffers) buffer.use();
      gl.drawArrays(gl.TRIANGLES, 0, count);
    },
  };
}
