// Mouse, touch and wheel: how they move the camera.

// A drag as high as the view turns once around.
const TURN = Math.PI;
const WHEEL = 0.0015;

// `changed` is called after each change, `reset` for a double-click.
function followGestures(canvas, camera, changed, reset) {
  // Where each finger or button is down: place, and whether it moves instead of turning.
  const down = new Map();

  // From the middle of the view, in half heights, y upwards.
  function placeOf({ clientX, clientY }) {
    const { left, top, width, height } = canvas.getBoundingClientRect();
    return [(2 * (clientX - left) - width) / height, (height - 2 * (clientY - top)) / height];
  }

  const middleOf = (places) => scaled(places.reduce((sum, place) => added(sum, place)), 1 / places.length);

  function moveTo(id, next) {
    const before = [...down.values()].map(({ place }) => place);
    const { place, moves } = down.get(id);
    down.set(id, { place: next, moves });
    const [x, y] = added(next, scaled(place, -1));
    if (down.size === 1) {
      if (moves) camera.pan(x, y);
      else camera.turn(-TURN * x, -TURN * y);
      return changed();
    }
    // Two fingers, or more: what is between them stays between them.
    const after = [...down.values()].map(({ place }) => place);
    const middle = middleOf(after);
    const spread = (places) => norm(added(places[0], scaled(places[1], -1))) || 1e-3;
    camera.pan(...added(middle, scaled(middleOf(before), -1)));
    camera.zoom(spread(before) / spread(after), middle);
    changed();
  }

  canvas.addEventListener("pointerdown", (event) => {
    const moves = event.button > 0 || event.ctrlKey || event.metaKey || event.shiftKey;
    down.set(event.pointerId, { place: placeOf(event), moves });
    canvas.setPointerCapture(event.pointerId);
    // No scrolling by the middle button; the keys go to the view.
    event.preventDefault();
    canvas.focus({ preventScroll: true });
  });
  canvas.addEventListener("pointermove", (event) => {
    if (down.has(event.pointerId)) moveTo(event.pointerId, placeOf(event));
  });
  for (const end of ["pointerup", "pointercancel", "lostpointercapture"]) {
    canvas.addEventListener(end, (event) => down.delete(event.pointerId));
  }
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    const lines = event.deltaMode === WheelEvent.DOM_DELTA_LINE ? 33 : 1;
    // A pinch on a touchpad comes as small steps of a wheel with Ctrl.
    const speed = WHEEL * lines * (event.ctrlKey ? 6 : 1);
    camera.zoom(Math.exp(speed * Math.min(Math.max(event.deltaY, -300), 300)), placeOf(event));
    changed();
  }, { passive: false });
  canvas.addEventListener("dblclick", reset);
}
