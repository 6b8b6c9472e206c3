// Velocities and contact force over the time of the film, in which slow motion takes more space.
const STRIP = {left: 34, right: 8, top: 16, velocity: 72, between: 10, force: 40, bottom: 20};

// Return a scene's clock, which converts times of the scene (s) to times of the film (s), and back.
function clockOf(scene) {
  const stretches = scene.clock.map(([start, slower], k) => ({
    start, slower, end: k + 1 < scene.clock.length ? scene.clock[k + 1][0] : scene.end,
  }));
  let length = 0;
  for (const stretch of stretches) {
    stretch.film = length;
    length += (stretch.end - stretch.start) * stretch.slower;
  }
  const last = stretches[stretches.length - 1];
  return {
    stretches, length,
    film: (time) => {
      const current = stretches.find((stretch) => time < stretch.end) || last;
      return current.film + (clamp(time, current.start, current.end) - current.start) * current.slower;
    },
    time: (film) => {
      let current = stretches[0];
      for (const next of stretches) if (next.film <= film) current = next;
      return Math.min(current.start + (film - current.film) / current.slower, scene.end);
    },
    slower: (time) => (stretches.find((stretch) => time < stretch.end) || last).slower,
  };
}

function timeTicks(svg, clock, x, y) {
  let taken = -Infinity;
  for (const stretch of clock.stretches) {
    const pixels = (x(stretch.end) - x(stretch.start)) / (stretch.end - stretch.start);
    const step = round(90 / pixels);  // distance of two ticks: 36 to 90 pixels
    const digits = Math.max(0, Math.ceil(-Math.log10(1000 * step) - 1e-9));
    for (let k = Math.ceil(stretch.start / step - 1e-9); k * step <= stretch.end; k++) {
      const text = (1000 * k * step).toFixed(digits), at = x(k * step), half = 3.4 * text.length;
      if (at - half < taken + 8) continue;
      node("path", {class: "igw-rule", d: path([[at, y], [at, y + 4]])}, svg);
      node("text", {class: "igw-small", x: at, y: y + 16, "text-anchor": "middle"}, svg, text);
      taken = at + half;
    }
  }
}

// Draw velocities and force of a run into `svg`; return the area for the pointer, and functions for cursor and pointer.
function drawStrips(svg, scene, run, clock, width) {
  svg.replaceChildren();
  const bottom = STRIP.top + STRIP.velocity + STRIP.between + STRIP.force, height = bottom + STRIP.bottom;
  set(svg, {viewBox: `0 0 ${width} ${height}`, width, height});
  const span = width - STRIP.left - STRIP.right;
  const x = (time) => STRIP.left + span * clock.film(time) / clock.length;
  const high = 1.08 * scene.limits.speed, low = Math.min(1.08 * scene.limits.lowest, -0.02 * high);
  const v = (value) => STRIP.top + STRIP.velocity * (high - value) / (high - low);
  const f = (value) => bottom - (STRIP.force - 4) * value / (scene.limits.force || 1);
  const slowest = Math.min(...clock.stretches.map((stretch) => stretch.slower));
  for (const stretch of clock.stretches) {
    const from = x(stretch.start), wide = x(stretch.end) - from;
    if (stretch.slower > slowest) {
      const shade = 0.05 + 0.05 * Math.log10(stretch.slower / 4);
      node("rect", {class: "igw-slow", x: from, y: STRIP.top, width: wide, height: bottom - STRIP.top,
                    opacity: shade}, svg);
    }
    const text = `1/${stretch.slower}`;
    if (wide > 6.6 * text.length) {
      node("text", {class: "igw-small", x: from + 0.5 * wide, y: 11, "text-anchor": "middle"}, svg, text);
    }
  }
  const grid = (y, text, zero) => {
    node("path", {class: zero ? "igw-rule" : "igw-grid", d: path([[STRIP.left, y], [width - STRIP.right, y]])}, svg);
    const beside = y > STRIP.top + STRIP.velocity - 6 && y < bottom - STRIP.force;  // next to the label N
    if (!beside || text.length <= 2) node("text", {class: "igw-small", x: STRIP.left - 5, y: y + 4, "text-anchor": "end"}, svg, text);
  };
  const step = round(0.55 * high);
  for (let k = Math.ceil(low / step); k * step < high; k++) {
    grid(v(k * step), String(Math.round(1000 * k * step) / 1000).replace("-", "\u2212"), k === 0);
  }
  grid(f(0), "0", true);
  const forceStep = scene.limits.force > 0 ? round(0.95 * scene.limits.force) : 0;
  if (forceStep) grid(f(forceStep), String(Number(forceStep.toPrecision(1))), false);
  timeTicks(svg, clock, x, bottom);
  for (const [start] of run.contacts) {
    node("path", {class: "igw-touch", d: path([[x(start), STRIP.top], [x(start), bottom]])}, svg);
  }
  if (run.alarm !== null && run.alarm < scene.end) {
    const at = x(run.alarm), right = at < width - 70;
    node("path", {class: "igw-alarm", d: path([[at, STRIP.top], [at, bottom]])}, svg);
    node("text", {class: "igw-small igw-halo", x: at + (right ? 4 : -4), y: bottom - STRIP.force + 4,
                  "text-anchor": right ? "start" : "end"}, svg, "alarm");
  }
  node("text", {class: "igw-small", x: 2, y: 11}, svg, "m/s");
  node("text", {class: "igw-small", x: 2, y: bottom - STRIP.force - 2}, svg, "N");
  node("text", {class: "igw-small", x: 2, y: bottom + 16}, svg, "ms");
  const times = run.rows[COLUMNS.time];
  const edges = clock.stretches.map((stretch) => stretch.start).filter((start) => start > times[0]);
  const instants = [...new Set([...times, ...edges])].sort((one, other) => one - other);
  const line = (name, y) => path(instants.map((time) => [x(time), y(stateAt(run, time)[name])]));
  node("path", {class: "igw-force", d: `${line("contact_force", f)}L${x(scene.end)},${f(0)}L${x(0)},${f(0)}Z`}, svg);
  const dots = ["flange", "tool", "object"].map((body) => {
    node("path", {class: `igw-curve igw-curve-${body}`, d: line(`${body}_velocity`, v)}, svg);
    return [body, node("circle", {class: `igw-dot igw-dot-${body}`, r: 3.5}, svg)];
  });
  const cursor = node("path", {class: "igw-cursor"}, svg);
  const hit = node("rect", {class: "igw-hit", x: STRIP.left, y: STRIP.top, width: span,
                            height: bottom - STRIP.top}, svg);
  const move = (state) => {
    const at = x(state.time);
    set(cursor, {d: path([[at, STRIP.top], [at, bottom]])});
    for (const [body, dot] of dots) set(dot, {cx: at, cy: v(state[`${body}_velocity`])});
  };
  return {move, hit, film: (pixels) => clamp((pixels - STRIP.left) / span, 0, 1) * clock.length};
}
