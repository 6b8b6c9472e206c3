// Picture of the arm and the object at the positions that the server sends.
const STAGE = {axis: 84, ground: 138, height: 186, tall: 1.4};

// Draw the picture. `shown` outlives a change of the width: positions `at` (m), `radius` (m) and first position `home` (m)
// of the object, and its `slide` (m) after the try.
function drawStage(svg, about, width, shown) {
  svg.replaceChildren();
  set(svg, {viewBox: `0 0 ${width} ${STAGE.height}`});
  const chain = about.chain, behind = TOOL.length + chain.rest + FLANGE.length + BEHIND;
  const [near, far] = about.distance, right = far + 0.25, scale = width / (right + behind);
  const view = {...STAGE, left: -behind, width, scale, x: (position) => (position + behind) * scale};
  const y = STAGE.ground, band = node("g", {}, svg);
  node("rect", {class: "somewhere", x: view.x(near), y: 26, width: (far - near) * scale, height: y - 26}, band);
  node("path", {class: "somewhere-edge", d: [near, far].map((edge) => path([[view.x(edge), 26], [view.x(edge), y]])).join("")}, band);
  place(node("text", {class: "hint", y: 18}, band, "the object is somewhere here"), view.x(0.5 * (near + far)), width);
  ruler(svg, view, y);
  const radius = Math.max(shown.radius * scale, 4);
  const ghost = node("circle", {class: "igw-ghost", cy: STAGE.axis, r: radius}, svg);
  const move = drawBodies(svg, view, chain, radius);
  const moved = node("path", {class: "igw-moved"}, svg);
  const movedText = node("text", {class: "igw-strong igw-object-text", y: y + 44}, svg);
  const outside = node("g", {}, svg);  // sign at the edge that the object has left the picture
  node("path", {class: "igw-object", d: arrow(width - 34, STAGE.axis, 30, 10)}, outside);
  place(node("text", {class: "hint", y: STAGE.axis - 18}, outside, "out of the picture"), width, width);
  const update = (at) => {
    move(...at);
    shown.at = at;
    const object = at[2];
    if (shown.home === null || object === null) shown.home = object;
    const far = shown.slide || object - shown.home, slid = object !== null && far > (shown.slide ? 0 : 5e-4);
    show(band, object === null);
    for (const each of [ghost, moved, movedText]) show(each, slid);
    show(outside, slid && shown.home + far > right);
    if (!slid) return;
    set(ghost, {cx: view.x(shown.home) + radius});
    set(moved, {d: path([[view.x(shown.home), y + 3], [view.x(shown.home + far), y + 3]])});
    movedText.textContent = `${shown.slide ? "slid" : "object moved"} ${centimetres(far)}`;
    place(movedText, view.x(shown.home + 0.5 * far), width);
  };
  update(shown.at);
  return update;
}
