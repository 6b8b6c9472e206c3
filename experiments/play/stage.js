// Picture of the arm and the object at the positions that the server sends.
const STAGE = {height: 186, axis: 84, ground: 138};

function drawStage(svg, about, width) {
  svg.replaceChildren();
  set(svg, {viewBox: `0 0 ${width} ${STAGE.height}`});
  const chain = about.chain, behind = TOOL.length + chain.rest + FLANGE.length + BEHIND;
  const [near, far] = about.distance, right = far + 0.25, scale = width / (right + behind);
  const view = {axis: STAGE.axis, scale, x: (position) => (position + behind) * scale};
  const y = STAGE.ground, band = node("g", {}, svg);
  node("rect", {class: "somewhere", x: view.x(near), y: 26, width: (far - near) * scale, height: y - 26}, band);
  for (const edge of [near, far]) {
    node("path", {class: "somewhere-edge", d: path([[view.x(edge), 26], [view.x(edge), y]])}, band);
  }
  node("text", {class: "hint", x: view.x(0.5 * (near + far)), y: 18, "text-anchor": "middle"}, band,
       "the object is somewhere here");
  node("path", {class: "igw-rule", d: path([[0, y], [width, y]])}, svg);
  const step = Math.max(round(90 / scale), 0.05);
  for (let k = 0; k * step < right; k++) {
    const x = view.x(k * step);
    node("path", {class: "igw-rule", d: path([[x, y], [x, y + 6]])}, svg);
    if (x < width - 16) {
      node("text", {class: "igw-small", x, y: y + 20, "text-anchor": "middle"}, svg,
           `${Math.round(100 * k * step)}${k ? "" : " cm"}`);
    }
  }
  const body = (size, name) => node("rect", {class: name, rx: 3, y: STAGE.axis - 0.5 * size.height * scale * 1.4,
    width: size.length * scale, height: size.height * scale * 1.4}, svg);
  const robot = node("rect", {class: "igw-arm", x: -4, y: STAGE.axis - 8, height: 16}, svg);
  const ghost = node("circle", {class: "igw-ghost", cy: STAGE.axis}, svg);
  const ball = node("circle", {class: "igw-object", cy: STAGE.axis}, svg);
  const couple = COUPLINGS[chain.coupling](node("g", {}, svg), view, chain);
  const flange = body(FLANGE, "igw-flange"), tool = body(TOOL, "igw-tool");
  const moved = node("path", {class: "igw-moved"}, svg);
  const movedText = node("text", {class: "igw-strong igw-object-text", y: y + 44, "text-anchor": "middle"}, svg);
  let home = null, radius = 10;
  const measure = (atObject, text) => {
    for (const each of [moved, movedText]) show(each, text);
    if (!text) return;
    set(moved, {d: path([[view.x(home), y + 3], [view.x(atObject), y + 3]])});
    set(movedText, {x: clamp(view.x(0.5 * (home + atObject)), 70, width - 70)});
    movedText.textContent = text;
  };
  const update = ([atFlange, atTool, atObject]) => {
    const front = atFlange - TOOL.length - chain.rest;
    set(flange, {x: view.x(front - FLANGE.length)});
    set(robot, {width: Math.max(view.x(front - FLANGE.length) + 4, 0)});
    set(tool, {x: view.x(atTool - TOOL.length)});
    couple(front, atTool - TOOL.length);
    const seen = atObject !== null;
    show(ball, seen);
    show(ghost, seen && home !== null && atObject - home > 5e-4);
    show(band, !seen);
    if (!seen) return;
    if (home === null) home = atObject;
    set(ball, {cx: view.x(atObject) + radius, r: radius});
    set(ghost, {cx: view.x(home) + radius, r: radius});
    measure(atObject, atObject - home > 5e-4 ? `object moved ${centimetres(atObject - home)}` : "");
  };
  // Show the slide of the result, which may be longer than that of the last frame.
  const result = (slide) => {
    if (home !== null && slide > 0) measure(home + slide, `slid ${centimetres(slide)}`);
  };
  const begin = (metres) => {
    home = null;
    radius = Math.max(metres * scale, 4);
  };
  begin(0.03);
  update([0, 0, null]);
  return {update, begin, result};
}
