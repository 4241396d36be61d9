// The view: the clouds, the connections and the arrows, and where the source is.

const SMOOTH_MS = 700;
// While something moves, a machine that needs longer than this for a picture draws fewer points.
const SLOW_MS = 40;
const LARGEST_STEP = 16;

// `null` where there is no WebGL. `shownAgain` is called with false when the graphics context is
// lost, and with true when it is back.
function makeView(canvas, data, shownAgain) {
  const gl = canvas.getContext("webgl2", { antialias: true, alpha: false, powerPreference: "high-performance" });
  if (!gl) return null;
  const clouds = { source: unpackCloud(data.source, data.radius), target: unpackCloud(data.target, data.radius) };
  const camera = makeCamera(data.look);
  const stands = data.stands.map(({ matrix, center, radius }) => ({ ...decomposed(matrix), center, radius }));
  const after = data.stands.findIndex((stand) => stand.name === "after");
  const visible = { source: true, target: true, lines: false, arrows: true };
  let parts = null;
  let now = stands[after];
  let [colourBy, enlarge] = ["cloud", 1];
  let colours = {};
  // Pictures that are asked for, and the movement that is under way.
  let [wanted, moving] = [false, 0];
  // Every how many-th point is drawn while something moves; and what draws the rest afterwards.
  let [step, rest] = [1, 0];

  // All that is on the graphics card: made again when its context was lost.
  function upload() {
    parts = {
      source: makeCloud(gl, clouds.source),
      target: makeCloud(gl, clouds.target),
      lines: data.weights && makeLines(gl, data.weights),
      arrows: makeArrows(gl, data.arrows, data.radius),
    };
    gl.enable(gl.DEPTH_TEST);
  }

  function draw(step) {
    const [width, height] = [canvas.width, canvas.height];
    gl.viewport(0, 0, width, height);
    gl.clearColor(...colours.stage, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    const density = Math.max(1, 0.75 * pixelRatio());
    const scene = { ...camera.matrices(), perUnit: height / (2 * SLOPE), width, height, density, none: colours.faint };
    const look = { colourBy, enlarge, step };
    const model = composed(now);
    const still = composed({ turn: [0, 0, 0, 1], scale: 1, shift: [0, 0, 0] });
    gl.enable(gl.SAMPLE_ALPHA_TO_COVERAGE);
    if (visible.target) parts.target.draw(scene, { ...look, model: still, scale: 1, colour: colours.target });
    if (visible.source) parts.source.draw(scene, { ...look, model, scale: now.scale, colour: colours.source });
    gl.disable(gl.SAMPLE_ALPHA_TO_COVERAGE);
    if (visible.lines) parts.lines?.draw(scene, model);
    if (visible.arrows) parts.arrows.draw(scene);
  }

  // How long the picture took is known only when the graphics card is done.
  function measure(start) {
    const fence = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    gl.flush();
    const poll = () => {
      if (gl.isContextLost()) return;
      if (gl.getSyncParameter(fence, gl.SYNC_STATUS) !== gl.SIGNALED) return setTimeout(poll, 4);
      gl.deleteSync(fence);
      const took = performance.now() - start;
      if (took > SLOW_MS) step = Math.min(step * 2 ** Math.ceil(Math.log2(took / SLOW_MS)), LARGEST_STEP);
      if (took < SLOW_MS / 4) step = Math.max(step / 2, 1);
    };
    poll();
  }

  // Nothing is drawn while nothing changes.
  function redraw() {
    if (wanted) return;
    wanted = true;
    requestAnimationFrame(() => {
      wanted = false;
      if (!parts) return;
      draw(step);
      measure(performance.now());
      clearTimeout(rest);
      if (step > 1) rest = setTimeout(() => parts && draw(1), 100);
    });
  }

  function stand(next) {
    now = next;
    camera.frameOn(next);
    redraw();
  }

  function between(from, onto, share) {
    return {
      turn: slerp(from.turn, onto.turn, share),
      scale: from.scale + share * (onto.scale - from.scale),
      shift: mixed(from.shift, onto.shift, share),
      center: mixed(from.center, onto.center, share),
      radius: from.radius + share * (onto.radius - from.radius),
    };
  }

  function moveTo(index) {
    cancelAnimationFrame(moving);
    const [from, onto] = [now, stands[index]];
    if (matchMedia("(prefers-reduced-motion: reduce)").matches) return stand(onto);
    const start = performance.now();
    const go = (time) => {
      const share = Math.min(Math.max((time - start) / SMOOTH_MS, 0), 1);
      stand(share < 1 ? between(from, onto, share * share * (3 - 2 * share)) : onto);
      if (share < 1) moving = requestAnimationFrame(go);
    };
    moving = requestAnimationFrame(go);
  }

  // As near as nothing is out of view, wherever the source is put.
  function reset() {
    camera.reset();
    const needed = stands.map((stand) => {
      const model = composed(stand);
      camera.frameOn(stand);
      return camera.distanceFor([...clouds.source.some.map((place) => applied(model, place)), ...clouds.target.some]);
    });
    camera.reset(Math.max(...needed));
    camera.frameOn(now);
    redraw();
  }

  const pixelRatio = () => Math.min(window.devicePixelRatio || 1, 2);

  function resize() {
    const { clientWidth, clientHeight } = canvas.parentElement;
    const size = [clientWidth, clientHeight].map((length) => Math.max(1, Math.round(length * pixelRatio())));
    if (size[0] !== canvas.width) canvas.width = size[0];
    if (size[1] !== canvas.height) canvas.height = size[1];
    camera.resize(canvas.width / canvas.height);
    // At once, as a canvas is empty after it changed its size.
    if (parts) draw(step);
    redraw();
  }

  function paint() {
    colours = Object.fromEntries(["stage", "source", "target", "faint"].map((name) => [name, styleColour(`--${name}`)]));
    redraw();
  }

  canvas.addEventListener("webglcontextlost", (event) => {
    // Without this it would never come back.
    event.preventDefault();
    parts = null;
    shownAgain(false);
  });
  canvas.addEventListener("webglcontextrestored", () => {
    upload();
    shownAgain(true);
    resize();
  });
  const changed = (change) => (...values) => {
    change(...values);
    redraw();
  };

  paint();
  upload();
  resize();
  reset();
  new ResizeObserver(resize).observe(canvas.parentElement);
  // Another screen may have other pixels.
  window.addEventListener("resize", resize);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", paint);
  followGestures(canvas, camera, redraw, reset);
  return {
    moveTo,
    // Part of the way from before to after.
    scrub(share) {
      cancelAnimationFrame(moving);
      stand(between(stands[0], stands[after], share));
    },
    turn: changed(camera.turn),
    zoom: changed(camera.zoom),
    reset,
    nextUp: changed(camera.nextUp),
    colourBy: changed((kind) => { colourBy = kind; }),
    show: changed((what, shown) => { visible[what] = shown; }),
    enlarge: changed((factor) => { enlarge = Math.min(Math.max(enlarge * factor, 0.4), 6); }),
  };
}
