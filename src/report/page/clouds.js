// Clouds as points that are lit from the eye, in one colour or by a value.

const POINT_SHADER = {
  vertex: `
    uniform vec3 low, size;
    uniform float reach, spacing, enlarge;
    attribute float value;
    varying float light, shade;
    void main() {
      vec4 eye = modelViewMatrix * vec4(low + size * position, 1.0);
      vec3 across = mat3(modelViewMatrix) * normal;
      float length2 = dot(across, across);
      light = length2 > 0.0 ? abs(dot(across, normalize(eye.xyz))) * inversesqrt(length2) : 1.0;
      shade = value * 255.0;
      gl_Position = projectionMatrix * eye;
      gl_PointSize = clamp(enlarge * spacing * reach / gl_Position.w, 1.5 * enlarge, 14.0 * enlarge);
    }`,
  fragment: `
    uniform vec3 colour, none, ramp[5];
    uniform bool valued;
    varying float light, shade;
    void main() {
      vec2 off = gl_PointCoord - 0.5;
      if (dot(off, off) > 0.25) discard;
      vec3 base = colour;
      if (valued) {
        float at = min(shade / 250.0, 1.0) * 4.0;
        base = mix(ramp[0], ramp[1], clamp(at, 0.0, 1.0));
        base = mix(base, ramp[2], clamp(at - 1.0, 0.0, 1.0));
        base = mix(base, ramp[3], clamp(at - 2.0, 0.0, 1.0));
        base = mix(base, ramp[4], clamp(at - 3.0, 0.0, 1.0));
        if (shade > 252.0) base = none;
      }
      gl_FragColor = vec4(base * (0.45 + 0.55 * light), 1.0);
    }`,
};

// Colours go to the screen as they are: no conversion on the way.
function plainColour(text) {
  const parts = /^#?([0-9a-f]{2})([0-9a-f]{2})([0-9a-f]{2})$/i.exec(text);
  return new THREE.Vector3(...parts.slice(1).map((part) => parseInt(part, 16) / 255));
}

function makeCloud(shown) {
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(shortsOf(shown.positions), 3, true));
  geometry.setAttribute("normal", new THREE.BufferAttribute(signedOf(shown.normals), 3, true));
  const values = {
    residual: bytesOf(shown.residuals),
    weight: shown.weights ? bytesOf(shown.weights) : new Uint8Array(shown.shown).fill(255),
  };
  const attribute = (kind) => new THREE.BufferAttribute(values[kind], 1, true);
  const attributes = { residual: attribute("residual"), weight: attribute("weight") };
  geometry.setAttribute("value", attributes.residual);
  const material = new THREE.ShaderMaterial({
    vertexShader: POINT_SHADER.vertex,
    fragmentShader: POINT_SHADER.fragment,
    uniforms: {
      low: { value: new THREE.Vector3(...shown.low) },
      size: { value: new THREE.Vector3(...shown.size) },
      spacing: { value: shown.spacing },
      reach: { value: 1 },
      enlarge: { value: 1 },
      colour: { value: new THREE.Vector3() },
      none: { value: new THREE.Vector3() },
      ramp: { value: RAMP.map(plainColour) },
      valued: { value: false },
    },
  });
  const points = new THREE.Points(geometry, material);
  points.frustumCulled = false;
  points.matrixAutoUpdate = false;
  return {
    points,
    uniforms: material.uniforms,
    colourBy(kind) {
      material.uniforms.valued.value = kind !== "cloud";
      if (kind !== "cloud") geometry.setAttribute("value", attributes[kind]);
    },
  };
}
