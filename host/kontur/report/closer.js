"use strict";
// A closer look at the runs of a report: their rows are in the page, packed by kontur.report.closer.
const SIGNALS = [["contour error", "µm", "error"], ["error along the path", "µm", "along"],
                 ["force x", "N", "force_x"], ["force y", "N", "force_y"]];
const INK = "#1b1f24", SOFT = "#5b636d", LINE = "#dfe3e8", PATH = "#b9bec6";
const $ = id => document.getElementById(id);
const look = window.kontur = { runs: [], from: 0, to: 1, at: null, signal: "error", ready: false };

async function unpacked(text, rows, columns) {
  const bytes = Uint8Array.from(atob(text), c => c.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  const differences = new Int32Array(await new Response(stream).arrayBuffer());
  const found = {};
  columns.forEach(([name, unit], i) => {
    const values = new Float64Array(rows);
    let sum = 0;
    for (let row = 0; row < rows; row++) {
      sum = (sum + differences[i * rows + row]) | 0;
      values[row] = sum === -2147483648 ? NaN : sum * unit;
    }
    found[name] = values;
  });
  return found;
}

async function start() {
  const data = JSON.parse($("closer-data").textContent);
  for (const run of data.runs) {
    const columns = await unpacked(run.rows, run.count, data.columns);
    look.runs.push({ label: run.label, colour: run.colour, shown: true, ...columns });
  }
  $("closer").hidden = false;
  for (const [text, , name] of SIGNALS) { $("closer-signal").append(new Option(text, name)); }
  $("closer-signal").onchange = () => { look.signal = $("closer-signal").value; draw(); };
  for (const run of look.runs) {
    const label = document.createElement("label"), box = document.createElement("input"), key = document.createElement("b");
    box.type = "checkbox"; box.checked = true;
    box.onchange = () => { run.shown = box.checked; draw(); };
    key.textContent = run.label; key.style.color = run.colour;
    label.append(box, key);
    $("closer-runs").append(label);
  }
  $("closer-whole").onclick = whole;
  for (const id of ["closer-time", "closer-path"]) { listen($(id), id === "closer-time"); }
  addEventListener("resize", draw);
  whole();
  look.ready = true;
}

function shown() { return look.runs.filter(run => run.shown); }

function whole() {
  look.from = Math.min(...look.runs.map(run => run.time[0]));
  look.to = Math.max(...look.runs.map(run => run.time[run.time.length - 1]));
  draw();
}

// The row of a run that is nearest to a time.
function row(run, time) {
  let low = 0, high = run.time.length - 1;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (run.time[middle] < time) { low = middle + 1; } else { high = middle; }
  }
  return low > 0 && time - run.time[low - 1] < run.time[low] - time ? low - 1 : low;
}

function listen(canvas, isTime) {
  let pressed = null;
  const time = event => {
    const box = canvas.getBoundingClientRect(), { left, right } = canvas.frame;
    const share = (event.clientX - box.left - left) / (box.width - left - right);
    return look.from + Math.min(1, Math.max(0, share)) * (look.to - look.from);
  };
  canvas.onpointermove = event => {
    look.at = isTime ? time(event) : nearest(canvas, event) ?? look.at;
    look.selected = pressed === null ? null : [pressed, look.at];
    draw();
  };
  canvas.onpointerdown = event => {
    if (isTime) { pressed = look.at = time(event); canvas.setPointerCapture(event.pointerId); }
    else { look.at = nearest(canvas, event) ?? look.at; draw(); }
  };
  canvas.onpointerup = event => {
    if (pressed === null) { return; }
    const other = time(event), [from, to] = [Math.min(pressed, other), Math.max(pressed, other)];
    if (to - from > 0.02 * (look.to - look.from)) { look.from = from; look.to = to; }
    pressed = look.selected = null;
    draw();
  };
  canvas.onpointercancel = () => { pressed = look.selected = null; draw(); };
  canvas.ondblclick = whole;
  canvas.onkeydown = event => {
    const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key], zoom = { "+": 0.5, "-": 2 }[event.key];
    if (step) { look.at = (look.at ?? look.from) + step * (look.to - look.from) / 400; }
    else if (zoom) {
      const middle = look.at ?? (look.from + look.to) / 2, width = (look.to - look.from) * zoom;
      if (width > 1e-3) { look.from = middle - width / 2; look.to = middle + width / 2; }
    } else if (event.key === "Escape") { whole(); } else { return; }
    event.preventDefault();
    draw();
  };
}

// The time at which a run is nearest to the pointer in the picture of the path.
function nearest(canvas, event) {
  const box = canvas.getBoundingClientRect(), x = event.clientX - box.left, y = event.clientY - box.top;
  let best = 30 * 30, found = null;
  for (const run of shown()) {
    for (let i = row(run, look.from), end = row(run, look.to); i <= end; i++) {
      const away = (canvas.frame.x(run.x[i]) - x) ** 2 + (canvas.frame.y(run.y[i]) - y) ** 2;
      if (away < best) { best = away; found = run.time[i]; }
    }
  }
  return found;
}

function cleared(canvas) {
  const scale = window.devicePixelRatio || 1, w = canvas.clientWidth, h = canvas.clientHeight;
  canvas.width = Math.round(w * scale); canvas.height = Math.round(h * scale);
  const pen = canvas.getContext("2d");
  pen.setTransform(scale, 0, 0, scale, 0, 0);
  pen.font = "12px Helvetica, Arial, sans-serif";
  return [pen, w, h];
}

function nice(value) {
  const power = 10 ** Math.floor(Math.log10(value));
  return power * (value / power >= 5 ? 5 : value / power >= 2 ? 2 : 1);
}

function draw() {
  drawTime();
  drawPath();
  const rows = shown().map(run => [run, look.at === null ? -1 : row(run, look.at)]);
  $("closer-at").textContent = look.at === null ? "Point at a place in either picture." : `t = ${look.at.toFixed(3)} s`;
  $("closer-values").replaceChildren(...rows.filter(([, i]) => i >= 0).map(([run, i]) => {
    const line = document.createElement("tr");
    const cells = [run.label, ...[[run.error, 3], [run.along, 3], [run.force_x, 1], [run.force_y, 1], [run.x, 4], [run.y, 4]]
      .map(([values, digits]) => Number.isNaN(values[i]) ? "–" : values[i].toFixed(digits))];
    cells.forEach((text, column) => {
      const cell = document.createElement(column ? "td" : "th");
      cell.textContent = text;
      if (!column) { cell.scope = "row"; cell.style.color = run.colour; }
      line.append(cell);
    });
    return line;
  }));
}

function drawTime() {
  const canvas = $("closer-time"), [pen, w, h] = cleared(canvas), left = 52, right = 8, top = 10, bottom = 18;
  canvas.frame = { left, right };
  let low = 0, high = 0;
  for (const run of shown()) {
    const values = run[look.signal];
    for (let i = row(run, look.from), end = row(run, look.to); i <= end; i++) {
      if (values[i] < low) { low = values[i]; } else if (values[i] > high) { high = values[i]; }
    }
  }
  if (high === low) { high = low + 1; }
  const px = t => left + (t - look.from) / (look.to - look.from) * (w - left - right);
  const py = v => top + (high - v) / (high - low) * (h - top - bottom);
  pen.strokeStyle = LINE; pen.fillStyle = SOFT; pen.textAlign = "right";
  const step = nice((high - low) / 3);
  for (let v = Math.ceil(low / step) * step; v <= high; v += step) {
    pen.beginPath(); pen.moveTo(left, py(v)); pen.lineTo(w - right, py(v)); pen.stroke();
    pen.fillText(Number(v.toPrecision(3)).toString(), left - 5, py(v) + 4);
  }
  const seconds = nice((look.to - look.from) / 3);
  for (let t = Math.ceil(look.from / seconds) * seconds; t <= look.to; t += seconds) {
    pen.fillText(`${Number(t.toPrecision(6))} s`, px(t) + 10, h - 4);
  }
  $("closer-unit").textContent = SIGNALS.find(([, , name]) => name === look.signal)[1];
  pen.save();
  pen.beginPath(); pen.rect(left, 0, w - left - right, h - bottom); pen.clip();
  if (look.selected) {
    const [a, b] = look.selected.map(px);
    pen.fillStyle = "#0072b222"; pen.fillRect(Math.min(a, b), top, Math.abs(b - a), h - top - bottom);
  }
  for (const run of shown().reverse()) {
    const values = run[look.signal];
    pen.strokeStyle = run.colour; pen.lineWidth = 1;
    pen.beginPath();
    let open = false;
    for (let i = Math.max(0, row(run, look.from) - 1), end = Math.min(row(run, look.to) + 1, values.length - 1); i <= end; i++) {
      if (Number.isNaN(values[i])) { continue; }
      pen[open ? "lineTo" : "moveTo"](px(run.time[i]), py(values[i]));
      open = true;
    }
    pen.stroke();
  }
  if (look.at !== null) {
    pen.strokeStyle = INK; pen.lineWidth = 1;
    pen.beginPath(); pen.moveTo(px(look.at), top); pen.lineTo(px(look.at), h - bottom); pen.stroke();
  }
  pen.restore();
}

function drawPath() {
  const canvas = $("closer-path"), [pen, w, h] = cleared(canvas), pad = 22;
  const box = [Infinity, Infinity, -Infinity, -Infinity];
  let greatest = 0;
  for (const run of shown()) {
    for (let i = row(run, look.from), end = row(run, look.to); i <= end; i++) {
      box[0] = Math.min(box[0], run.x[i]); box[1] = Math.min(box[1], run.y[i]);
      box[2] = Math.max(box[2], run.x[i]); box[3] = Math.max(box[3], run.y[i]);
      if (Math.abs(run.error[i]) > greatest) { greatest = Math.abs(run.error[i]); }
    }
  }
  if (box[0] > box[2]) { $("closer-scale").textContent = ""; return; }
  const size = Math.max(box[2] - box[0], box[3] - box[1], 1e-3), times = greatest > 0 ? nice(0.1 * size * 1e3 / greatest) : 1;
  const extra = 0.12 * size;
  const k = Math.min((w - 2 * pad) / (box[2] - box[0] + 2 * extra), (h - 2 * pad) / (box[3] - box[1] + 2 * extra));
  const x = v => w / 2 + (v - (box[0] + box[2]) / 2) * k, y = v => h / 2 - (v - (box[1] + box[3]) / 2) * k;
  canvas.frame = { x, y };
  for (const [magnified, width] of [[false, 1.5], [true, 1]]) {
    for (const run of shown().reverse()) {
      pen.strokeStyle = magnified ? run.colour : PATH; pen.lineWidth = width;
      pen.beginPath();
      let nx = 0, ny = 0;
      for (let i = Math.max(1, row(run, look.from)), end = row(run, look.to); i <= end; i++) {
        const dx = run.x[i] - run.x[i - 1], dy = run.y[i] - run.y[i - 1], step = Math.hypot(dx, dy);
        if (step > 1e-5) { nx = -dy / step; ny = dx / step; }
        const off = magnified && !Number.isNaN(run.error[i]) ? run.error[i] * 1e-3 * times : 0;
        pen.lineTo(x(run.x[i] + nx * off), y(run.y[i] + ny * off));
      }
      pen.stroke();
    }
  }
  if (look.at !== null) {
    for (const run of shown()) {
      const i = row(run, look.at);
      pen.strokeStyle = run.colour; pen.lineWidth = 2;
      pen.beginPath(); pen.arc(x(run.x[i]), y(run.y[i]), 7, 0, 7); pen.stroke();
    }
  }
  const bar = nice(size / 4);
  pen.strokeStyle = INK; pen.fillStyle = SOFT; pen.lineWidth = 1.5;
  pen.beginPath(); pen.moveTo(10, h - 8); pen.lineTo(10 + bar * k, h - 8); pen.stroke();
  pen.fillText(`${Number(bar.toPrecision(1))} mm`, 10, h - 13);
  $("closer-scale").textContent = `error × ${times.toLocaleString("en")}`;
}
start();
