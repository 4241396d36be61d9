// Switches and keys.

(function () {
  const data = JSON.parse(document.getElementById("data").textContent);
  const find = (id) => document.getElementById(id);
  const radios = (name) => [...document.querySelectorAll(`input[name="${name}"]`)];

  if (data.weights) {
    const { matrix } = data.weights;
    const heats = [makeHeat(find("heat"), matrix)];
    if (matrix.first_order) heats.push(makeHeat(find("heat-first"), matrix, matrix.first_order));
    const order = (kind) => heats.forEach((orderedBy) => orderedBy(kind));
    order("place");
    radios("order").forEach((radio) => radio.addEventListener("change", () => order(radio.value)));
  }

  // The view, or the still picture and its note.
  function live(on) {
    document.documentElement.classList.toggle("live", on);
    find("note").hidden = on;
    for (const id of ["bar", "hint", "legend"]) find(id).hidden = !on;
  }

  function begin() {
    live(true);
    try {
      return makeView(find("canvas"), data, (on) => {
        live(on);
        find("note").textContent = "A still picture: the graphics card dropped the view. If it does not come back, load the page again.";
      });
    } catch (error) {
      console.warn(error);
      return null;
    }
  }

  const view = begin();
  if (!view) {
    live(false);
    return;
  }

  function legend() {
    const kind = radios("colour").find((radio) => radio.checked).value;
    const spot = (colour, text) => `<span class="dot" style="background: ${colour}"></span>${text}`;
    const dot = (name) => spot(`var(--${name})`, name);
    const ramp = `<span class="ramp" style="background: linear-gradient(to right, ${RAMP.join(", ")})"></span>`;
    const short = (x) => Number(x.toPrecision(3)).toString();
    find("legend").innerHTML = {
      cloud: dot("source") + dot("target"),
      residual: `on the other 0${ramp}${short(data.residual[0])} or more away: grey`,
      weight: `little${ramp}much weight; grey: not compared`,
    }[kind];
    if (find("lines")?.checked) {
      find("legend").innerHTML += `<br>${spot(TOGETHER, "brought together by the pose")}${spot(APART, "not")}`;
    }
  }

  radios("stand").forEach((radio, k) => radio.addEventListener("change", () => {
    view.moveTo(k);
    if (k < 2) find("way").value = k;
  }));
  find("way").addEventListener("input", (event) => {
    const share = Number(event.target.value);
    view.scrub(share);
    radios("stand").forEach((radio, k) => { radio.checked = k === Math.round(share); });
  });
  radios("colour").forEach((radio) => radio.addEventListener("change", () => {
    view.colourBy(radio.value);
    legend();
  }));
  for (const what of ["source", "target", "lines", "arrows"]) {
    const box = find(what);
    if (!box) continue;
    box.addEventListener("change", () => {
      view.show(what, box.checked);
      legend();
    });
    view.show(what, box.checked);
  }
  legend();
  find("smaller").addEventListener("click", () => view.enlarge(1 / 1.3));
  find("larger").addEventListener("click", () => view.enlarge(1.3));
  find("up").addEventListener("click", view.nextUp);
  find("reset").addEventListener("click", view.reset);

  const click = (element) => element?.click();
  const next = (name) => {
    const all = radios(name);
    click(all[(all.findIndex((radio) => radio.checked) + 1) % all.length]);
  };
  const keys = {
    b: () => click(radios("stand")[0]),
    a: () => click(radios("stand")[1]),
    o: () => click(radios("stand")[2]),
    c: () => next("colour"),
    s: () => click(find("source")),
    t: () => click(find("target")),
    l: () => click(find("lines")),
    u: view.nextUp,
    r: view.reset,
  };
  const onCanvas = {
    ArrowLeft: () => view.turn(-0.12, 0),
    ArrowRight: () => view.turn(0.12, 0),
    ArrowUp: () => view.turn(0, 0.12),
    ArrowDown: () => view.turn(0, -0.12),
    "+": () => view.zoom(0.85),
    "=": () => view.zoom(0.85),
    "-": () => view.zoom(1.18),
  };
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const action = keys[event.key] ?? (event.target === find("canvas") ? onCanvas[event.key] : null);
    if (!action) return;
    action();
    event.preventDefault();
  });
  requestAnimationFrame(() => requestAnimationFrame(() => {
    document.documentElement.dataset.ready = "yes";
  }));
})();
