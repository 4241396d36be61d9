// The camera: it turns about an axis that is up, about what the page shows.

// Tangent of half the vertical angle of view: 35 degrees.
const SLOPE = Math.tan((17.5 * Math.PI) / 180);
// How near to the axis it may look, as a cosine.
const STEEPEST = 0.998;
// Distances, in those from which all is seen.
const [NEAREST, FARTHEST] = [1e-3, 30];
const AXES = [[0, 1, 0], [0, 0, 1], [0, -1, 0], [0, 0, -1], [1, 0, 0], [-1, 0, 0]];

function makeCamera(look) {
  // Unit vectors up and to the eye, what is in the middle relative to the middle of the frame,
  // and how far away, where 1 shows all of the frame.
  let axis = look.upright;
  let toward = look.toward;
  let offset = [0, 0, 0];
  let far = 1;
  // The frame in view, a ball, and width over height.
  let frame = { center: [0, 0, 0], radius: 1 };
  let aspect = 1;

  const right = () => unit(cross(axis, toward));
  const up = () => cross(toward, right());
  const distance = () => {
    const slope = SLOPE * Math.min(aspect, 1);
    return (1.05 * far * frame.radius * Math.hypot(1, slope)) / slope;
  };

  // Turns, in radians, to the right and upwards.
  function turn(across, upward) {
    toward = unit(rotated(toward, axis, across));
    const tilted = rotated(toward, right(), -upward);
    if (Math.abs(dot(tilted, axis)) < STEEPEST) toward = unit(tilted);
  }

  // Moves what is seen; one unit is half the height of the view.
  function pan(x, y) {
    const unitLength = distance() * SLOPE;
    offset = added(offset, added(scaled(right(), -x * unitLength), scaled(up(), -y * unitLength)));
  }

  return {
    turn,
    pan,
    // The point at (x, y) from the middle, in half heights, stays there.
    zoom(factor, [x, y] = [0, 0]) {
      const next = Math.min(Math.max(far * factor, NEAREST), FARTHEST);
      const share = 1 - next / far;
      pan(-share * x, -share * y);
      far = next;
    },
    frameOn(next) { frame = next; },
    // From how far away the places are in view, but for those far outside of the frame: strays.
    distanceFor(places) {
      const [x, y] = [right(), up()];
      let farthest = 0;
      for (const place of places) {
        const p = added(place, scaled(frame.center, -1));
        if (norm(p) > 1.15 * frame.radius) continue;
        const aside = Math.max(Math.abs(dot(y, p)), Math.abs(dot(x, p)) / aspect) / SLOPE;
        farthest = Math.max(farthest, dot(toward, p) + aside);
      }
      return (1.08 * far * farthest) / distance();
    },
    resize(next) { aspect = next; },
    // Back to where all is seen from `distance`.
    reset(distance = 1) {
      [axis, toward, offset, far] = [look.upright, look.toward, [0, 0, 0], Math.min(Math.max(distance, 0.3), 1)];
    },
    // Another axis up.
    nextUp() {
      const now = AXES.findIndex((other) => dot(other, axis) > 0.99);
      const next = (now + 1) % AXES.length;
      axis = AXES[next];
      // From above there would be no way up on the screen.
      if (Math.abs(dot(toward, axis)) > 0.95) toward = unit(added(toward, scaled(AXES[(next + 1) % AXES.length], 0.6)));
    },
    // The matrices that are drawn with.
    matrices() {
      const eye = added(added(frame.center, offset), scaled(toward, distance()));
      const near = distance() / 200;
      return {
        view: viewMatrix(right(), up(), toward, eye),
        projection: perspective(SLOPE, aspect, near, distance() + 50 * frame.radius),
        near,
        distance: distance(),
      };
    },
  };
}
