// Enlarged picture of the faces of tool and object, on which small penetrations are visible.
let magnifiers = 0;

function drawMagnifier(svg, scene, view) {
  const touchX = view.x(scene.scenario.distance), width = Math.min(MAGNIFIER.width, view.width - 8), height = MAGNIFIER.height;
  const left = clamp(touchX - 0.5 * width, 2, view.width - width - 2), top = 2, middle = top + 0.5 * height;
  const scale = clamp(0.34 * width / Math.max(scene.limits.depth, 1e-5), 2 * view.scale, 2e5);  // pixels per m
  const face = left + 0.5 * width, radius = scene.radius * scale;
  const name = `igw-clip-${++magnifiers}-${Math.random().toString(36).slice(2)}`;
  const clip = node("clipPath", {id: name}, node("defs", {}, svg));
  node("rect", {x: left, y: top, width, height, rx: 6}, clip);
  const lines = node("path", {class: "igw-sight"}, svg);
  node("rect", {class: "igw-magnifier", x: left, y: top, width, height, rx: 6}, svg);
  const inside = node("g", {"clip-path": `url(#${name})`}, svg);
  const rim = [];
  for (let k = -16; k <= 16; k++) {
    const y = clamp(0.5 * height * k / 16, -radius, radius);
    rim.push([face + radius - Math.sqrt(Math.max(radius * radius - y * y, 0)), middle + y]);
  }
  const end = 2 * radius < width ? face + radius : left + width + 2;
  node("path", {class: "igw-object", d: `${path(rim)}L${end},${rim[32][1]}L${end},${rim[0][1]}Z`}, inside);
  const tool = node("rect", {class: "igw-tool", x: left - 4, y: middle - 0.25 * height, height: 0.5 * height}, inside);
  const outline = node("path", {class: "igw-outline", d: path(rim)}, inside);
  const push = node("path", {class: "igw-push"}, inside);
  const force = node("text", {class: "igw-on-object igw-strong", "text-anchor": "end", x: left + width - 6,
                              y: top + 15}, inside);
  const depth = node("text", {class: "igw-small igw-halo", x: left + 7, y: top + 15}, inside);
  const length = round(0.2 * width / scale);
  const label = length >= 1e-3 ? `${1000 * length} mm` : `${Math.round(1e6 * length)} \u00b5m`;
  const base = top + height - 7;
  node("path", {class: "igw-scale", d: path([[left + 7, base], [left + 7 + length * scale, base]])}, inside);
  node("text", {class: "igw-small igw-halo", x: left + 12 + length * scale, y: base + 4}, inside, label);
  node("rect", {class: "igw-frame-line", x: left, y: top, width, height, rx: 6}, svg);
  return (state, at) => {
    const tip = face - state.gap * scale, pressed = -state.gap > 0;
    set(tool, {width: Math.max(Math.min(tip, left + width + 8) - left + 4, 0)});
    const foot = view.axis - 0.5 * TOOL.height * view.scale - 2, x = view.x(state.object_position);
    set(lines, {d: path([[left + 8, top + height], [x, foot], [left + width - 8, top + height]])});
    const fraction = state.force / (scene.limits.force || 1);
    show(outline, pressed);
    show(push, fraction > 0.002);
    show(force, fraction > 0.002);
    if (fraction > 0.002) {
      set(push, {d: arrow(tip, middle, Math.min(14 + 56 * fraction, left + width - tip - 6), 12)});
      force.textContent = `${newtons(state.force)} N`;
    }
    const size = Math.abs(1000 * state.gap), digits = size >= 10 ? 0 : size >= 1 ? 1 : 2;
    depth.textContent = `${pressed ? "pressed" : "gap"} ${size.toFixed(digits)} mm`;
  };
}
