// The muscles one by one: a slider for each side, the subject's right on the left as in the picture.
function addMuscle(parent, muscle, addSlider) {
  const row = document.createElement("div");
  row.className = "muscle";
  row.append(Object.assign(document.createElement("span"), { textContent: muscle.name }));
  for (const name of [...muscle.sides].reverse()) {
    const side = document.createElement("div");
    const paired = muscle.sides.length > 1;
    side.className = paired ? "side" : "side whole";
    const label = document.createElement("label");
    label.textContent = paired ? name.slice(name.lastIndexOf("_") + 1) : "midline";
    label.htmlFor = name;
    const output = document.createElement("output");
    const input = document.createElement("input");
    input.type = "range";
    side.append(label, output, input);
    addSlider(input, output, { name, low: 0, high: 1, text: (v) => v.toFixed(2) });
    row.append(side);
  }
  parent.append(row);
}

// Two lists of sliders, of which one is shown.
function choosePanel(chosen) {
  for (const name of ["sliders", "muscles"]) {
    el(name).hidden = name !== chosen;
    el(`choose-${name}`).setAttribute("aria-pressed", String(name === chosen));
  }
}
