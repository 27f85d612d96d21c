const page = Math.random().toString(36).slice(2);
/** @type {HTMLImageElement} */
const picture = el("picture");
const rows = new Map(); // name -> {input, output, show}
/** @type {Record<string, number>} */
const values = {}; // what is asked for, all that is not at rest
const DEGREES_PER_PIXEL = 0.35,
  LIMIT = 85;
let busy = false,
  stale = false,
  moving = 0;

function ask() {
  // One request at a time; whatever changes meanwhile is asked for next: only the newest is drawn.
  if (busy) {
    stale = true;
    return;
  }
  busy = true;
  stale = false;
  fetch(
    `picture.jpg?${new URLSearchParams(Object.entries(withBlink(values)).map(([name, value]) => [name, String(value)]))}`,
    { headers: { "X-Page": page } },
  )
    .then(async (answer) => {
      if (!answer.ok) throw new Error(await answer.text());
      if (answer.status === 200) await show(await answer.blob());
      trouble("");
    })
    .catch((error) =>
      trouble(error instanceof TypeError ? "risorius view has ended" : error.message),
    )
    .finally(() => {
      busy = false;
      if (stale) ask();
    });
}
async function show(blob) {
  const before = picture.src;
  picture.src = URL.createObjectURL(blob);
  await picture.decode();
  if (before) URL.revokeObjectURL(before);
  picture.dataset.shown = String(Number(picture.dataset.shown || 0) + 1);
}
function trouble(text) {
  el("trouble").textContent = text;
}

function set(name, value) {
  if (Math.abs(value) < 0.0005 && name !== "zoom") delete values[name];
  else values[name] = +value.toFixed(4);
  const row = rows.get(name);
  if (row) {
    row.input.value = value;
    row.show();
  }
  const signed = (v) => `${(v > 0 ? "+" : v < 0 ? "\u2212" : "") + Math.abs(v).toFixed(0)}°`;
  el("pose").textContent = `pitch ${signed(values.pitch || 0)}  yaw ${signed(values.yaw || 0)}`;
  ask();
}
function glide(goal) {
  // Sliders run to their places, so that one sees which muscles make the expression.
  cancelAnimationFrame(moving);
  const names = Object.keys(goal),
    start = names.map((n) => values[n] || (n === "zoom" ? 1 : 0));
  const began = performance.now(),
    lasts = 260;
  const step = (now) => {
    const t = Math.min((now - began) / lasts, 1),
      s = t * t * (3 - 2 * t);
    for (const [i, n] of names.entries()) set(n, start[i] + s * (goal[n] - start[i]));
    if (t < 1) moving = requestAnimationFrame(step);
  };
  moving = requestAnimationFrame(step);
}
function press(chosen) {
  for (const button of document.querySelectorAll("#emotions button"))
    button.setAttribute("aria-pressed", String(button === chosen));
}

function addRow(parent, control) {
  const row = document.createElement("div");
  row.className = "row";
  row.innerHTML =
    '<label></label><span class="au"></span><output></output><input type="range"><span class="works"><span></span><span></span></span>';
  const [label, au, output, input, works] = /** @type {any} */ (row.children);
  label.textContent = control.name.replaceAll("_", " ");
  label.htmlFor = control.name;
  au.textContent = control.tag;
  // Below each end of the slider stands what pulls there.
  works.children[0].textContent = control.down;
  works.children[1].textContent = control.up;
  addSlider(input, output, control);
  parent.append(row);
}
function addSlider(input, output, control) {
  input.id = control.name;
  Object.assign(input, {
    min: control.low,
    max: control.high,
    step: 0.01,
    value: 0,
    title: "double-click: rest",
  });
  const show = () => {
    const value = +input.value,
      place = (v) => `${(100 * (v - control.low)) / (control.high - control.low)}%`;
    input.style.setProperty("--from", place(Math.min(value, 0)));
    input.style.setProperty("--to", place(Math.max(value, 0)));
    output.textContent = control.text(value);
    output.classList.toggle("moved", value !== 0);
  };
  input.oninput = () => {
    cancelAnimationFrame(moving);
    press(null);
    set(control.name, +input.value);
  };
  input.ondblclick = () => glide({ [control.name]: 0 });
  rows.set(control.name, { input, output, show });
  show();
}
function addHeading(parent, text, note) {
  const heading = document.createElement("h2");
  heading.textContent = text;
  if (note) heading.append(Object.assign(document.createElement("small"), { textContent: note }));
  parent.append(heading);
}
const plain = (v) => (v > 0 ? "+" : v < 0 ? "\u2212" : "") + Math.abs(v).toFixed(2);

function build(model) {
  el("who").textContent = model.caller || "generic head";
  picture.width = model.width;
  picture.height = model.height;
  picture.style.setProperty("--shape", String(model.width / model.height));
  const sliders = el("sliders"),
    muscles = el("muscles");
  for (const region of ["Brows", "Eyes", "Nose", "Mouth"]) {
    addHeading(muscles, region);
    for (const muscle of model.muscles.filter((each) => each.region === region))
      addMuscle(muscles, muscle, addSlider);
    addHeading(sliders, region);
    for (const eau of model.eaus.filter((e) => e.region === region))
      addRow(sliders, {
        ...eau,
        tag: eau.au,
        text: plain,
        down: eau.works_down === eau.works_up ? "" : eau.works_down,
        up: eau.works_up,
      });
  }
  addHeading(
    sliders,
    "Anthropometry",
    model.caller
      ? "changes to the caller's own, \u00b12 standard deviations"
      : "\u00b12 standard deviations of adults",
  );
  for (const aau of model.aaus)
    addRow(sliders, {
      ...aau,
      low: -1,
      high: 1,
      tag: aau.measures,
      down: "",
      up: "",
      text: (v) => `${plain(v * aau.mm).slice(0, -1)} mm`,
    });
  const rest = () => Object.fromEntries([...rows.keys()].map((n) => [n, 0]));
  const names = [...model.eaus.map((e) => e.name), ...model.muscles.flatMap((m) => m.sides)];
  const still = () => Object.fromEntries(names.map((name) => [name, 0]));
  for (const emotion of model.emotions) {
    const button = Object.assign(document.createElement("button"), {
      type: "button",
      textContent: emotion.name,
    });
    button.onclick = () => {
      const off = button.getAttribute("aria-pressed") === "true";
      press(off ? null : button);
      glide(off ? still() : { ...still(), ...emotion.eau });
    };
    el("emotions").append(button);
  }
  press(null);
  for (const name of ["sliders", "muscles"]) el(`choose-${name}`).onclick = () => choosePanel(name);
  choosePanel("sliders");
  const blink = el("blink");
  blink.onclick = () => {
    const on = blink.getAttribute("aria-pressed") !== "true";
    blink.setAttribute("aria-pressed", String(on));
    setBlinking(on, ask);
  };
  const ahead = { pitch: 0, yaw: 0, ...(model.caller ? {} : { zoom: 1 }) };
  el("reset").onclick = () => {
    press(null);
    glide({ ...rest(), ...ahead });
  };
  picture.ondblclick = () => glide(ahead);
  // A caller is seen by their own camera.
  el("zoomable").hidden = Boolean(model.caller);
  turning(!model.caller);
  set("yaw", 0);
}
function turning(zooms) {
  const limited = (v, low, high) => Math.min(Math.max(v, low), high);
  const turn = (yaw, pitch) => {
    set("yaw", limited((values.yaw || 0) + yaw, -LIMIT, LIMIT));
    set("pitch", limited((values.pitch || 0) + pitch, -LIMIT, LIMIT));
  };
  picture.onpointerdown = (event) => {
    cancelAnimationFrame(moving);
    picture.setPointerCapture(event.pointerId);
  };
  picture.onpointermove = (event) => {
    if (picture.hasPointerCapture(event.pointerId))
      turn(DEGREES_PER_PIXEL * event.movementX, -DEGREES_PER_PIXEL * event.movementY);
  };
  picture.onkeydown = (event) => {
    const way = { ArrowLeft: [-5, 0], ArrowRight: [5, 0], ArrowUp: [0, 5], ArrowDown: [0, -5] }[
      event.key
    ];
    if (way) {
      turn(...way);
      event.preventDefault();
    }
  };
  picture.onwheel = (event) => {
    event.preventDefault();
    if (zooms) set("zoom", limited((values.zoom || 1) * Math.exp(-event.deltaY / 800), 0.5, 4));
  };
}
fetch("model.json")
  .then((answer) => answer.json())
  .then(build)
  .catch((error) => trouble(error.message));
