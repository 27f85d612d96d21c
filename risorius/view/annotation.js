const canvas = el("overlay"),
  rows = new Map();
const REACH = 14,
  POSE = ["pitch_deg", "yaw_deg", "roll_deg", "tx", "ty", "scale"];
/** @type {any} */
let model = null;
/** @type {any} */
let face = null; // what holds for all annotations; the answer that is shown
/** @type {any} */
let edit = null;
/** @type {any[]} */
let past = [];
let saved = ""; // what a hand has set; before; as it is in the files
/** @type {any} */
let held = null;
/** @type {any} */
let last = null; // index of the landmark that is dragged, that was last
let busy = false,
  stale = false,
  moved = 0;
const shows = { mesh: true, points: true, distances: true };

const trouble = (text) => {
  el("trouble").textContent = text;
};
const copy = (value) => JSON.parse(JSON.stringify(value));
async function asked(path, body) {
  const answer = await fetch(
    path,
    body === undefined ? {} : { method: "POST", body: JSON.stringify(body) },
  );
  if (!answer.ok) throw new Error((await answer.text()).trim());
  return answer.json();
}
const why = (error) =>
  trouble(error instanceof TypeError ? "risorius view has ended" : error.message);
const query = () => `?${new URLSearchParams({ name: el("names").value })}`;

function fit() {
  // One request at a time; whatever is set meanwhile is asked for next: only the newest is fitted.
  if (busy) {
    stale = true;
    return;
  }
  busy = true;
  stale = false;
  const name = el("names").value;
  asked(`fit${query()}`, edit)
    .then((answer) => {
      if (name === el("names").value) {
        show(answer);
        trouble("");
      }
    }, why)
    .finally(() => {
      busy = false;
      if (stale) fit();
    });
}
function set(change) {
  past.push(copy(edit));
  change(edit);
  marks();
  fit();
}
async function openNamed(name) {
  el("names").value = name;
  edit = null;
  face = null;
  held = last = null;
  past = [];
  const answer = await asked(`annotation.json${query()}`);
  if (name !== el("names").value) return;
  edit = answer.correction;
  saved = JSON.stringify(edit);
  el("picture").src = `picture.jpg${query()}`;
  ranges(answer);
  show(answer);
  trouble("");
}
async function save() {
  el("save").disabled = true;
  const sent = JSON.stringify(edit);
  try {
    const answer = await asked(`save${query()}`, edit);
    model.annotations[answer.name] = answer.error;
    saved = sent;
    show(answer);
    trouble("");
  } catch (error) {
    why(error);
    marks();
  }
}

function show(answer) {
  face = answer;
  for (const control of model.controls) place(control.name, face.shape[control.name]);
  for (const name of POSE) place(name, face.pose[name]);
  el("texture").src = face.texture;
  el("residual").src = face.residual || "data:,";
  el("compared").textContent = face.residual
    ? `${model.compared}: ${(100 * face.unexplained).toFixed(0)} % of its variance`
    : "no other face to compare with";
  moved += 1;
  marks();
  draw();
}
function marks() {
  const count = Object.keys(edit.landmarks).length,
    values = Object.keys(edit.shape).length + (edit.pose ? 1 : 0);
  const changed = JSON.stringify(edit) !== saved;
  el("save").disabled = !changed;
  el("undo").disabled = !past.length;
  el("release").disabled = !(count + values);
  for (const [name, row] of rows)
    row.row.classList.toggle(
      "held",
      name in edit.shape || Boolean(edit.pose && POSE.includes(name)),
    );
  rows.get("weight").input.value = edit.weight;
  rows.get("weight").show();
  if (!face) return;
  el("state").innerHTML = "<b></b><span></span>";
  el("state").children[0].textContent = `error ${(100 * face.error).toFixed(2)} %`;
  el("state").children[1].textContent =
    ` of the eyes' distance · ${count} landmark${count === 1 ? "" : "s"} and ${values} value${values === 1 ? "" : "s"} by hand · ${changed ? "not saved" : "as in the files"}`;
}
function place(name, value) {
  const row = rows.get(name);
  row.input.value = value;
  row.show();
}

// Pixels of the picture to those of the page and back.
const scale = () => canvas.clientWidth / face.side;
const toPage = (x, y) => [
  (x - face.corner[0] + 0.5) * face.ratio * scale(),
  (y - face.corner[1] + 0.5) * face.ratio * scale(),
];
const toPicture = (x, y) => [
  x / scale() / face.ratio + face.corner[0] - 0.5,
  y / scale() / face.ratio + face.corner[1] - 0.5,
];
function handles() {
  // A landmark where it is known or was put, else where the model has it.
  const found = new Map(face.model.map(([i, x, y]) => [i, [x, y]]));
  for (const [i, x, y] of face.landmarks) found.set(i, [x, y]);
  for (const [i, at] of Object.entries(edit.landmarks)) found.set(+i, at);
  return found;
}
function nearest(x, y) {
  /** @type {number | null} */
  let best = null;
  let least = REACH;
  for (const [index, at] of handles()) {
    const [px, py] = toPage(...at),
      far = Math.hypot(px - x, py - y);
    if (far < least) {
      least = far;
      best = index;
    }
  }
  return best;
}
function draw() {
  if (!face) return;
  const dense = devicePixelRatio || 1,
    side = Math.round(canvas.clientWidth * dense);
  if (canvas.width !== side) canvas.width = canvas.height = side;
  const c = canvas.getContext("2d");
  c.setTransform(dense, 0, 0, dense, 0, 0);
  c.clearRect(0, 0, side, side);
  if (shows.mesh) mesh(c);
  const at = new Map(face.model.map(([i, x, y]) => [i, toPage(x, y)]));
  if (shows.distances) {
    c.strokeStyle = "#ffd45e";
    c.lineWidth = 1.2;
    c.beginPath();
    for (const [i, x, y] of face.landmarks)
      if (at.has(i)) {
        c.moveTo(...toPage(x, y));
        c.lineTo(...at.get(i));
      }
    c.stroke();
  }
  if (shows.points)
    for (const [i, [x, y]] of handles()) {
      const hand = i in edit.landmarks,
        known = hand || face.landmarks.some(([k]) => k === i);
      const [px, py] = toPage(x, y);
      c.beginPath();
      c.arc(px, py, hand ? 5 : known ? 1.9 : 1.3, 0, 7);
      c.fillStyle = hand ? "#e2936b" : known ? "#ff5c5c" : "#5fd067";
      c.fill();
      if (hand) {
        c.strokeStyle = i === last ? "#fff" : "#221a15";
        c.lineWidth = 1.5;
        c.stroke();
      }
    }
}
function mesh(c) {
  const at = [];
  for (let i = 0; i < face.vertices.length; i += 2)
    at.push(toPage(face.vertices[i], face.vertices[i + 1]));
  c.strokeStyle = "rgba(95, 208, 103, .38)";
  c.lineWidth = 0.7;
  c.beginPath();
  for (let i = 0; i < model.triangles.length; i += 3) {
    const [p, q, r] = [
      at[model.triangles[i]],
      at[model.triangles[i + 1]],
      at[model.triangles[i + 2]],
    ];
    // Only what faces the camera; y grows downwards.
    if ((q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]) >= 0) continue;
    c.moveTo(...p);
    c.lineTo(...q);
    c.lineTo(...r);
    c.closePath();
  }
  c.stroke();
}

canvas.onpointerdown = (event) => {
  if (!face) return;
  const index = nearest(event.offsetX, event.offsetY);
  if (index === null) return;
  held = last = index;
  past.push(copy(edit));
  canvas.setPointerCapture(event.pointerId);
};
canvas.onpointermove = (event) => {
  if (!face) return;
  if (held === null) {
    canvas.classList.toggle("near", nearest(event.offsetX, event.offsetY) !== null);
    return;
  }
  edit.landmarks[held] = toPicture(event.offsetX, event.offsetY);
  marks();
  draw();
  fit();
};
canvas.onpointerup = canvas.onpointercancel = () => {
  if (held !== null && JSON.stringify(past.at(-1)) === JSON.stringify(edit)) past.pop();
  held = null;
  if (face) {
    marks();
    draw();
  }
};
canvas.ondblclick = (event) => {
  const index = face === null ? null : nearest(event.offsetX, event.offsetY);
  if (index !== null && index in edit.landmarks)
    set((e) => {
      delete e.landmarks[index];
    });
};
canvas.onkeydown = (event) => {
  const way = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[
    event.key
  ];
  if (!way || last === null) return;
  event.preventDefault();
  const [x, y] = handles().get(last),
    step = 0.5 / face.ratio;
  set((e) => {
    e.landmarks[last] = [x + step * way[0], y + step * way[1]];
  });
  draw();
};
window.onkeydown = (event) => {
  if ((event.ctrlKey || event.metaKey) && event.key === "z") undo();
};
function undo() {
  if (past.length) {
    edit = past.pop();
    marks();
    draw();
    fit();
  }
}
window.onresize = draw;

function addRow(control, changed, letGo) {
  const row = document.createElement("div");
  row.className = "row";
  row.innerHTML = '<label></label><span class="au"></span><output></output><input type="range">';
  const [label, au, output, input] = /** @type {any} */ (row.children);
  label.textContent = control.label || control.name.replaceAll("_", " ");
  label.htmlFor = input.id = control.name;
  au.textContent = control.au || "";
  Object.assign(input, {
    min: control.low,
    max: control.high,
    step: control.step || 0.01,
    title: "double-click: let it go",
  });
  const show = () => {
    output.textContent = control.text(+input.value);
  };
  let before = null;
  input.oninput = () => {
    // One step back undoes a whole move of the slider.
    if (before === null) {
      before = copy(edit);
      past.push(before);
    }
    changed(edit, +input.value);
    show();
    marks();
    fit();
  };
  input.onchange = () => {
    before = null;
  };
  input.ondblclick = () => {
    if (letGo) set(letGo);
  };
  rows.set(control.name, { row, input, show });
  el("sliders").append(row);
}
function heading(text) {
  el("sliders").append(Object.assign(document.createElement("h2"), { textContent: text }));
}
const signed = (v, digits) => (v > 0 ? "+" : v < 0 ? "\u2212" : "") + Math.abs(v).toFixed(digits);

function build(described) {
  model = described;
  heading("By hand");
  addRow(
    {
      name: "weight",
      label: "weight of landmarks by hand",
      low: model.weights[0],
      high: model.weights[1],
      step: 1,
      text: (v) => `${v} x`,
    },
    (e, v) => {
      e.weight = v;
    },
  );
  heading("Pose");
  const labels = {
    pitch_deg: "pitch",
    yaw_deg: "yaw",
    roll_deg: "roll",
    tx: "x",
    ty: "y",
    scale: "scale",
  };
  const texts = {
    tx: (v) => `${v.toFixed(1)} px`,
    ty: (v) => `${v.toFixed(1)} px`,
    scale: (v) => `${Math.exp(v).toFixed(3)} px/mm`,
  };
  for (const name of POSE)
    addRow(
      {
        name,
        label: labels[name],
        low: -90,
        high: 90,
        step: name.endsWith("deg") ? 0.1 : 0.001,
        text: texts[name] || ((v) => `${signed(v, 1)}°`),
      },
      (e, v) => {
        e.pose = { ...(e.pose || face.pose), [name]: v };
      },
      (e) => {
        e.pose = null;
      },
    );
  for (const region of ["Brows", "Eyes", "Nose", "Mouth", "Anthropometry"]) {
    heading(region);
    for (const control of model.controls.filter((c) => c.region === region))
      addRow(
        { ...control, text: (v) => signed(v, 2) },
        (e, v) => {
          e.shape[control.name] = v;
        },
        (e) => {
          delete e.shape[control.name];
        },
      );
  }
  for (const name of Object.keys(model.annotations))
    el("names").append(
      Object.assign(document.createElement("option"), { value: name, textContent: name }),
    );
  const names = Object.keys(model.annotations);
  const leave = () => JSON.stringify(edit) === saved || confirm("Leave without saving?");
  const go = (by) => {
    const next = names[names.indexOf(face ? face.name : names[0]) + by];
    if (next && leave()) openNamed(next).catch(why);
  };
  el("before").onclick = () => go(-1);
  el("after").onclick = () => go(1);
  el("names").onchange = () => {
    const chosen = el("names").value;
    if (leave()) openNamed(chosen).catch(why);
    else el("names").value = face.name;
  };
  el("save").onclick = save;
  el("undo").onclick = undo;
  el("release").onclick = () =>
    set((e) => {
      e.landmarks = {};
      e.shape = {};
      e.pose = null;
    });
  for (const name of Object.keys(shows))
    el(name).onclick = () => {
      shows[name] = !shows[name];
      el(name).setAttribute("aria-pressed", shows[name]);
      draw();
    };
  window.onbeforeunload = (event) => {
    if (JSON.stringify(edit) !== saved) event.preventDefault();
  };
  return openNamed(names[0]);
}
function ranges(answer) {
  // Sliders of the place reach a fifth of the face to each side.
  const reach = (0.2 * answer.side) / answer.ratio;
  for (const [name, by] of Object.entries({ tx: reach, ty: reach, scale: 0.3 }))
    Object.assign(rows.get(name).input, {
      min: answer.pose[name] - by,
      max: answer.pose[name] + by,
    });
}
asked("annotations.json").then(build).catch(why);
