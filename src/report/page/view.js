// The view: scene, camera, and where the source stands.

const SMOOTH_MS = 700;

function makeView(canvas, data) {
  // Asked for here, as the library complains of a machine that has none.
  const context = canvas.getContext("webgl2", { antialias: true });
  if (!context) return null;
  const renderer = new THREE.WebGLRenderer({ canvas, context });
  renderer.outputColorSpace = THREE.LinearSRGBColorSpace;
  const scene = new THREE.Scene();
  const camera = new THREE.PerspectiveCamera(35, 1, 0.01, 100);
  const [source, target] = [makeCloud(data.source), makeCloud(data.target)];
  scene.add(target.points, source.points);
  const lines = data.weights ? makeLines(data.weights) : null;
  if (lines) scene.add(lines.lines);
  const arrows = new THREE.Group();
  data.arrows.forEach((arrow) => arrows.add(makeArrow(arrow, data.radius)));
  scene.add(arrows);
  let controls = null;

  const stands = data.stands.map(({ name, matrix, center, radius }) => {
    const [place, turn, scale] = [new THREE.Vector3(), new THREE.Quaternion(), new THREE.Vector3()];
    matrixOf(matrix).decompose(place, turn, scale);
    return { name, place, turn, scale, center: new THREE.Vector3(...center), radius };
  });
  const after = stands.findIndex((stand) => stand.name === "after");
  let now = stands[after];
  let wanted = false;
  let moving = 0;
  let enlarge = 1;

  function draw() {
    wanted = false;
    const distance = camera.position.distanceTo(controls.target);
    camera.near = distance / 200;
    camera.far = distance + 50 * data.radius;
    camera.updateProjectionMatrix();
    renderer.render(scene, camera);
  }

  // Nothing is drawn while nothing changes.
  function redraw() {
    if (!wanted) requestAnimationFrame(draw);
    wanted = true;
  }

  function between(from, onto, share) {
    return {
      place: from.place.clone().lerp(onto.place, share),
      turn: from.turn.clone().slerp(onto.turn, share),
      scale: from.scale.clone().lerp(onto.scale, share),
      center: from.center.clone().lerp(onto.center, share),
      radius: from.radius + share * (onto.radius - from.radius),
    };
  }

  // The camera keeps its way of looking, and what is to be seen in sight.
  function stand(next) {
    const offset = camera.position.clone().sub(controls.target);
    controls.target.add(next.center.clone().sub(now.center));
    camera.position.copy(controls.target).addScaledVector(offset, next.radius / now.radius);
    now = next;
    source.points.matrix.compose(now.place, now.turn, now.scale);
    source.points.matrixWorldNeedsUpdate = true;
    if (lines) lines.place(source.points.matrix);
    controls.update();
    redraw();
  }

  function moveTo(index) {
    cancelAnimationFrame(moving);
    const [from, onto] = [now, stands[index]];
    if (matchMedia("(prefers-reduced-motion: reduce)").matches) return stand(onto);
    const start = performance.now();
    const step = (time) => {
      const share = Math.min(Math.max((time - start) / SMOOTH_MS, 0), 1);
      stand(share < 1 ? between(from, onto, share * share * (3 - 2 * share)) : onto);
      if (share < 1) moving = requestAnimationFrame(step);
    };
    moving = requestAnimationFrame(step);
  }

  function reset() {
    const fit = 1 / Math.sin((Math.min(35, 35 * camera.aspect) / 2) * (Math.PI / 180));
    camera.up.set(...data.look.up);
    const away = 1.05 * fit * now.radius;
    camera.position.copy(now.center).addScaledVector(new THREE.Vector3(...data.look.toward), away);
    hold(now.center);
  }

  // The library takes the way up when controls are made.
  function hold(target) {
    controls?.dispose();
    controls = new THREE.OrbitControls(camera, canvas);
    controls.target.copy(target);
    controls.addEventListener("change", redraw);
    controls.update();
    redraw();
  }

  function turn(across, upward) {
    const offset = camera.position.clone().sub(controls.target);
    offset.applyAxisAngle(camera.up, across);
    const side = new THREE.Vector3().crossVectors(camera.up, offset).normalize();
    const tilted = offset.clone().applyAxisAngle(side, upward);
    if (Math.abs(tilted.clone().normalize().dot(camera.up)) < 0.99) offset.copy(tilted);
    camera.position.copy(controls.target).add(offset);
    controls.update();
    redraw();
  }

  const UPS = [[0, 1, 0], [0, 0, 1], [0, -1, 0], [0, 0, -1], [1, 0, 0], [-1, 0, 0]];
  let upward = 0;
  function nextUp() {
    upward = (upward + 1) % UPS.length;
    camera.up.set(...UPS[upward]);
    const offset = camera.position.clone().sub(controls.target);
    // Looking along the way up there would be no way up on the screen.
    if (Math.abs(offset.clone().normalize().dot(camera.up)) > 0.95) {
      const aside = new THREE.Vector3(...UPS[(upward + 1) % UPS.length]);
      offset.addScaledVector(aside, 0.6 * offset.length());
      camera.position.copy(controls.target).add(offset);
    }
    hold(controls.target);
  }

  function resize() {
    const { clientWidth: width, clientHeight: height } = canvas.parentElement;
    const ratio = Math.min(window.devicePixelRatio || 1, 2);
    renderer.setPixelRatio(ratio);
    renderer.setSize(width, height, false);
    camera.aspect = width / height;
    for (const cloud of [source, target]) {
      cloud.uniforms.reach.value = (1.6 * ratio * height) / (2 * Math.tan((35 / 2) * (Math.PI / 180)));
      cloud.uniforms.enlarge.value = enlarge * Math.max(1, ratio * 0.75);
    }
    redraw();
  }

  function paint() {
    renderer.setClearColor(new THREE.Color().setRGB(...plainColour(colourOf("--stage")).toArray()), 1);
    source.uniforms.colour.value = plainColour(colourOf("--source"));
    target.uniforms.colour.value = plainColour(colourOf("--target"));
    for (const cloud of [source, target]) cloud.uniforms.none.value = plainColour(colourOf("--faint"));
    redraw();
  }

  target.points.matrix.identity();
  new ResizeObserver(resize).observe(canvas.parentElement);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", paint);
  resize();
  reset();
  stand(now);
  paint();
  return {
    stands,
    moveTo,
    reset,
    nextUp,
    turn,
    redraw,
    draw,
    zoom(factor) {
      const offset = camera.position.clone().sub(controls.target).multiplyScalar(factor);
      camera.position.copy(controls.target).add(offset);
      controls.update();
      redraw();
    },
    // Part of the way from before to after.
    scrub(share) {
      cancelAnimationFrame(moving);
      stand(between(stands[0], stands[after], share));
    },
    colourBy(kind) {
      source.colourBy(kind);
      target.colourBy(kind);
      redraw();
    },
    show(what, visible) {
      const parts = { source: source.points, target: target.points, lines: lines?.lines, arrows };
      if (parts[what]) parts[what].visible = visible;
      redraw();
    },
    enlarge(factor) {
      enlarge = Math.min(Math.max(enlarge * factor, 0.4), 6);
      resize();
    },
  };
}
