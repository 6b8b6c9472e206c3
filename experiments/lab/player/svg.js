// SVG elements and attributes, formatted numbers, and interpolated time histories.
const SVG = "http://www.w3.org/2000/svg";
const COLUMNS = {};

function build(made, attributes, parent, text) {
  set(made, attributes);
  if (text !== undefined) made.textContent = text;
  if (parent) parent.appendChild(made);
  return made;
}

const node = (name, ...content) => build(document.createElementNS(SVG, name), ...content);
const html = (name, ...content) => build(document.createElement(name), ...content);

function set(element, attributes) {
  for (const key of Object.keys(attributes)) {
    const value = attributes[key];
    element.setAttribute(key, typeof value === "number" ? String(Math.round(value * 100) / 100) : value);
  }
}

const show = (element, visible) => { element.style.display = visible ? "" : "none"; };
const clamp = (value, low, high) => Math.min(Math.max(value, low), high);

// Return a number as text with three significant digits, but at most three decimals.
function three(value) {
  const size = Math.abs(value);
  return value.toFixed(size >= 100 ? 0 : size >= 10 ? 1 : size >= 1 ? 2 : 3).replace("-", "\u2212");
}

// Return a force (N) as text with at most two decimals.
const newtons = (value) => value.toFixed(value >= 100 ? 0 : value >= 10 ? 1 : 2);

const GENTLE = 0.01;  // m; a shorter slide is gentle

// Return a length (m) as text. Rounding does not hide on which side of GENTLE it is.
function centimetres(value) {
  if (value < 5e-5) return "less than 0.1 mm";
  if (value < 1e-3) return `${(1000 * value).toFixed(1)} mm`;
  const text = (100 * value).toFixed(Math.abs(value - GENTLE) < 5e-4 ? 2 : 1);
  return `${text !== "1.00" ? text : value < GENTLE ? "0.99" : "1.01"} cm`;
}

// Centre a text of a picture of this width at x, but not so far out that the picture cuts it; `side` 1: begin it at x.
function place(text, x, width, side = 0) {
  const half = 0.5 * text.getComputedTextLength();
  set(text, {x: clamp(x + side * half, half + 2, width - half - 2), "text-anchor": "middle"});
}

// Return the largest number not above `most` that is 1, 2 or 5 times a power of ten.
function round(most) {
  const decade = Math.pow(10, Math.floor(Math.log10(most) + 1e-9));
  return [5, 2, 1].map((step) => step * decade).find((step) => step <= most * (1 + 1e-9));
}

// Return the state of a run at `time`, interpolated linearly; after the last row, only the object moves: until friction
// stops it at `rest_time`, or at constant velocity.
function stateAt(run, time) {
  const times = run.rows[COLUMNS.time];
  let low = 0, high = times.length - 1;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (times[middle] <= time) low = middle; else high = middle;
  }
  const part = clamp((time - times[low]) / (times[high] - times[low] || 1), 0, 1);
  const state = {time};
  for (const name of Object.keys(COLUMNS)) {
    if (name === "time") continue;
    const row = run.rows[COLUMNS[name]];
    state[name] = row[low] + part * (row[high] - row[low]);
  }
  const after = Math.max(time - times[times.length - 1], 0), left = run.rest_time - times[times.length - 1];
  const braked = left > 0 ? Math.min(after / left, 1) : 0;
  state.object_position += state.object_velocity * (braked ? left * braked * (1 - 0.5 * braked) : after);
  state.object_velocity *= 1 - braked;
  state.contact = run.contacts.findIndex((contact) => contact[0] <= time && time < contact[1]);
  state.contacts = run.contacts.filter((contact) => contact[0] <= time).length;
  state.gap = state.object_position - state.tool_position;
  state.force = state.contact >= 0 ? state.contact_force : 0;
  return state;
}
