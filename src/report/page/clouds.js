// Clouds as round points that are lit from the eye, in one colour or by a value.

const POINT_SHADER = {
  vertex: `
    uniform mat4 eyeFromCloud, projection;
    uniform vec3 low, size, own, none, ramp[5];
    uniform float reach, least, most, valued;
    layout(location = 0) in vec3 place;
    layout(location = 1) in vec3 normal;
    layout(location = 2) in float value;
    flat out vec3 colour;
    flat out float width;
    vec3 rampAt(float share) {
      float at = clamp(share, 0.0, 1.0) * 4.0;
      vec3 mixture = mix(ramp[0], ramp[1], min(at, 1.0));
      for (int k = 1; k < 4; k++) mixture = mix(mixture, ramp[k + 1], clamp(at - float(k), 0.0, 1.0));
      return mixture;
    }
    void main() {
      vec4 eye = eyeFromCloud * vec4(low + size * place, 1.0);
      vec3 across = mat3(eyeFromCloud) * normal;
      float length2 = dot(across, across);
      float light = length2 > 0.0 ? abs(dot(across, normalize(eye.xyz))) * inversesqrt(length2) : 1.0;
      vec3 base = valued == 0.0 ? own : value > 252.0 ? none : rampAt(value / 250.0);
      colour = base * (0.45 + 0.55 * light);
      gl_Position = projection * eye;
      width = clamp(reach / gl_Position.w, least, most);
      gl_PointSize = width;
    }`,
  // The edge is as wide as a pixel: its cover says how many samples of the pixel are drawn.
  fragment: `
    flat in vec3 colour;
    flat in float width;
    out vec4 pixel;
    void main() {
      float cover = clamp((0.5 - length(gl_PointCoord - 0.5)) * width + 0.5, 0.0, 1.0);
      if (cover < 0.25) discard;
      pixel = vec4(colour, cover);
    }`,
};

// Width of a point in distances to the next one: neighbours overlap.
const POINT_WIDTH = 1.6;
// Pixels of a screen of usual density.
const [LEAST_WIDTH, MOST_WIDTH] = [1.8, 14];
// A cloud that is hardly larger than a pixel is a dot as wide as this.
const SPECK_WIDTH = 7;

// Points that are measured to bring all into view.
const MEASURED = 4000;

// A cloud, unpacked once; `radius` is that of all that is shown.
function unpackCloud(shown, radius) {
  const places = shortsOf(shown.positions);
  const stride = Math.max(1, Math.floor(shown.shown / MEASURED));
  const place = (k) => shown.low.map((low, axis) => low + (shown.size[axis] * places[3 * k + axis]) / 65535);
  return {
    some: Array.from({ length: Math.ceil(shown.shown / stride) }, (_, k) => place(stride * k)),
    count: shown.shown,
    low: shown.low,
    size: shown.size,
    // Where all points lie in one place there is no distance.
    spacing: shown.spacing > 0 ? shown.spacing : 0.05 * radius,
    places,
    normals: new Int8Array(bytesOf(shown.normals).buffer),
    residual: bytesOf(shown.residuals),
    weight: shown.weights ? bytesOf(shown.weights) : new Uint8Array(shown.shown).fill(255),
  };
}

function makeCloud(gl, cloud) {
  const program = makeProgram(gl, POINT_SHADER);
  const places = makeBuffer(gl, cloud.places, 0, 3, { normalized: true });
  const normals = makeBuffer(gl, cloud.normals, 1, 3, { normalized: true });
  const values = {
    residual: makeBuffer(gl, cloud.residual, 2, 1),
    weight: makeBuffer(gl, cloud.weight, 2, 1),
  };
  return {
    // `scale` is that of `model`; every `step`th point is drawn, somewhat wider.
    draw({ view, projection, perUnit, distance, density, none }, { model, scale, colour, colourBy, enlarge, step }) {
      const extent = (norm(cloud.size) * scale * perUnit) / (distance * density);
      program.use({
        eyeFromCloud: product(view, model),
        projection,
        low: cloud.low,
        size: cloud.size,
        own: colour,
        none,
        ramp: RAMP_RGB,
        valued: colourBy === "cloud" ? 0 : 1,
        reach: POINT_WIDTH * enlarge * scale * cloud.spacing * perUnit * step ** 0.25,
        least: Math.max(LEAST_WIDTH, SPECK_WIDTH - extent) * enlarge * density,
        most: MOST_WIDTH * enlarge * density,
      });
      places.use(step);
      normals.use(step);
      (values[colourBy] ?? values.residual).use(step);
      gl.drawArrays(gl.POINTS, 0, Math.ceil(cloud.count / step));
    },
  };
}
