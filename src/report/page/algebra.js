// Vectors as arrays of three, rotations as quaternions [x, y, z, w], matrices as 16 numbers
// column by column, which is how WebGL takes them.

const added = (a, b) => a.map((x, k) => x + b[k]);
const scaled = (a, factor) => a.map((x) => factor * x);
const dot = (a, b) => a.reduce((sum, x, k) => sum + x * b[k], 0);
const norm = (a) => Math.hypot(...a);
const unit = (a) => scaled(a, 1 / (norm(a) || 1));
const mixed = (a, b, share) => a.map((x, k) => x + share * (b[k] - x));
const cross = ([a, b, c], [x, y, z]) => [b * z - c * y, c * x - a * z, a * y - b * x];

// The vector, turned about a unit axis by an angle in radians.
function rotated(vector, axis, angle) {
  const [c, s] = [Math.cos(angle), Math.sin(angle)];
  const along = scaled(axis, (1 - c) * dot(axis, vector));
  return added(added(scaled(vector, c), scaled(cross(axis, vector), s)), along);
}

function product(a, b) {
  const result = new Array(16).fill(0);
  for (let column = 0; column < 4; column++) {
    for (let row = 0; row < 4; row++) {
      for (let k = 0; k < 4; k++) result[4 * column + row] += a[4 * k + row] * b[4 * column + k];
    }
  }
  return result;
}

// From the world to the eye: right is x, up is y, towards the eye is z.
function viewMatrix(right, up, toward, eye) {
  const columns = [0, 1, 2].map((k) => [right[k], up[k], toward[k], 0]);
  return [...columns.flat(), -dot(right, eye), -dot(up, eye), -dot(toward, eye), 1];
}

// `slope` is the tangent of half the vertical angle of view.
function perspective(slope, aspect, near, far) {
  const depth = near - far;
  return [1 / (slope * aspect), 0, 0, 0, 0, 1 / slope, 0, 0, 0, 0, (near + far) / depth, -1, 0, 0, (2 * near * far) / depth, 0];
}

// A similarity, given as four rows, taken apart: what can be interpolated.
function decomposed(rows) {
  const scale = Math.cbrt(dot(rows[0].slice(0, 3), cross(rows[1].slice(0, 3), rows[2].slice(0, 3))));
  const r = rows.slice(0, 3).map((row) => row.slice(0, 3).map((x) => x / scale));
  // By the largest of the four parts, so that nothing is divided by a small number.
  const squares = [
    1 + r[0][0] - r[1][1] - r[2][2],
    1 - r[0][0] + r[1][1] - r[2][2],
    1 - r[0][0] - r[1][1] + r[2][2],
    1 + r[0][0] + r[1][1] + r[2][2],
  ];
  const [sx, sy, sz] = [r[2][1] + r[1][2], r[0][2] + r[2][0], r[1][0] + r[0][1]];
  const [dx, dy, dz] = [r[2][1] - r[1][2], r[0][2] - r[2][0], r[1][0] - r[0][1]];
  const parts = [
    [squares[0], sz, sy, dx],
    [sz, squares[1], sx, dy],
    [sy, sx, squares[2], dz],
    [dx, dy, dz, squares[3]],
  ];
  const turn = unit(parts[squares.indexOf(Math.max(...squares))]);
  return { turn, scale, shift: rows.slice(0, 3).map((row) => row[3]) };
}

function composed({ turn: [x, y, z, w], scale, shift }) {
  const columns = [
    [1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)],
    [2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)],
    [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)],
  ];
  return [...columns.flatMap((column) => [...scaled(column, scale), 0]), ...shift, 1];
}

const applied = (m, [x, y, z]) => [0, 1, 2].map((row) => m[row] * x + m[4 + row] * y + m[8 + row] * z + m[12 + row]);

// The rotation that is a share of the shorter way from one to another.
function slerp(from, onto, share) {
  const cosine = dot(from, onto);
  const end = cosine < 0 ? scaled(onto, -1) : onto;
  const angle = Math.acos(Math.min(Math.abs(cosine), 1));
  if (angle < 1e-6) return unit(mixed(from, end, share));
  return unit(added(scaled(from, Math.sin((1 - share) * angle)), scaled(end, Math.sin(share * angle))));
}
