// Picture of flange, coupling, tool and object. Positions are to scale; sizes of the bodies are assumed.
const TOOL = {length: 0.034, height: 0.03}, FLANGE = {length: 0.016, height: 0.052}, CLEARANCE = 0.004;  // m
const MAGNIFIER = {width: 166, height: 74};
const BEHIND = 0.02, AHEAD = 106;  // space behind the robot (m), for the speed (pixels)
const NEAR = 0.1, CUT = 0.3;  // m, ways before and after the touch that a compact film shows to scale

// Return scale, origin and size of the picture, which are equal in all panels.
function viewOf(scene, width) {
  const most = (name) => Math.max(...scene.runs.map((run) => run.chain[name] || 0));
  const behind = TOOL.length + most("rest") + FLANGE.length;
  const rearmost = scene.compact ? Math.max(scene.scenario.distance - NEAR, 0) : Math.min(scene.limits.rearmost, 0);
  const left = rearmost - behind - BEHIND;
  const slide = Math.max(...scene.runs.map((run) => run.slide || 0)), cut = scene.compact ? scene.scenario.distance + CUT : Infinity;
  const right = Math.min(scene.compact ? scene.scenario.distance + slide : scene.limits.farthest, cut) + 2 * scene.radius;
  const scale = (width - AHEAD) / (right - left);
  const above = Math.max(scene.radius, 0.5 * FLANGE.height, most("height") + 0.006) * scale + 8;
  const below = Math.max(scene.radius * scale + 13, 0.5 * FLANGE.height * scale) + 6;
  const axis = (scene.compact ? 22 : MAGNIFIER.height + 14) + Math.max(above, 30);
  return {left, cut, scale, width, axis, ground: axis + Math.max(below, 26), height: axis + Math.max(below, 26) + 36,
          x: (position) => (position - left) * scale};
}

const path = (points) => "M" + points.map((point) => point.map((value) => Math.round(value * 100) / 100).join(",")).join("L");

function coil(x0, y0, x1, y1, half, turns) {
  const dx = x1 - x0, dy = y1 - y0, length = Math.hypot(dx, dy) || 1;
  const points = [[x0, y0]];
  for (let k = 0; k < 2 * turns; k++) {
    const part = 0.08 + 0.84 * (k + 0.5) / (2 * turns), side = k % 2 ? half : -half;
    points.push([x0 + part * dx - side * dy / length, y0 + part * dy + side * dx / length]);
  }
  return path(points.concat([[x1, y1]]));
}

// Each function draws a coupling, and returns a function that moves its ends to the front of the flange and the back of the tool (m).
const COUPLINGS = {
  rigid(group, view) {
    const bar = node("rect", {class: "igw-steel", y: view.axis - 3, height: 6}, group);
    return (front, back) => set(bar, {x: view.x(front), width: Math.max(view.x(back) - view.x(front), 0)});
  },
  spring(group, view, chain) {
    const quarter = 0.26 * TOOL.height * view.scale, reach = 0.5 * quarter;
    const y = view.axis + quarter, rest = chain.rest * view.scale;
    const spring = node("path", {class: "igw-spring"}, group);
    const cylinder = node("path", {class: "igw-damper"}, group);
    const rod = node("path", {class: "igw-damper"}, group);
    return (front, back) => {
      const x0 = view.x(front), x1 = Math.max(view.x(back), x0 + 2);
      const mouth = Math.min(x0 + 0.5 * rest, x1), piston = clamp(x1 - 0.6 * rest, x0 + 1, mouth);
      set(spring, {d: coil(x0, view.axis - quarter, x1, view.axis - quarter, Math.max(1.1 * quarter, 3), 8)});
      set(cylinder, {d: path([[mouth, y - reach], [x0, y - reach], [x0, y + reach], [mouth, y + reach]])});
      set(rod, {d: path([[x1, y], [piston, y]]) + path([[piston, y - reach], [piston, y + reach]])});
    };
  },
  bistable(group, view, chain) {
    const thick = Math.max(CLEARANCE * view.scale, 2.5), top = view.axis - chain.height * view.scale;
    const frame = node("path", {class: "igw-frame"}, group);
    const alignment = node("path", {class: "igw-ghost"}, group);
    const rod = node("rect", {class: "igw-tool", y: view.axis - 0.4 * thick, height: 0.8 * thick}, group);
    const slider = node("rect", {class: "igw-tool", y: view.axis - thick, width: 2 * thick, height: 2 * thick}, group);
    const spring = node("path", {class: "igw-spring"}, group);
    const pivot = node("circle", {class: "igw-steel", cy: top, r: 3}, group);
    const length = chain.front_stop - chain.rear_stop + 2 * CLEARANCE;
    return (front, back) => {
      const neutral = front + CLEARANCE - chain.rear_stop, x = view.x(back - length), sill = view.axis + 1.8 * thick;
      const stop = view.x(neutral + chain.front_stop + CLEARANCE), arm = view.x(front) - 2;
      set(frame, {d: path([[arm, view.axis], [arm, top], [view.x(neutral), top]])
                  + path([[arm, sill], [stop, sill], [stop, view.axis + 0.8 * thick]])
                  + path([[stop, view.axis - 0.8 * thick], [stop, view.axis - 2 * thick]])});
      set(alignment, {d: path([[view.x(neutral), top], [view.x(neutral), sill]])});
      set(rod, {x, width: Math.max(view.x(back) - x, 0)});
      set(slider, {x: x - thick});
      set(spring, {d: coil(view.x(neutral), top, x, view.axis, Math.max(0.9 * thick, 3), 6)});
      set(pivot, {cx: view.x(neutral)});
    };
  },
};

// Draw the ground at the height y with a scale.
function ruler(svg, view, y) {
  const step = round(90 / view.scale), last = view.left + view.width / view.scale;
  node("path", {class: "igw-rule", d: path([[0, y], [view.width, y]])}, svg);
  for (let k = Math.ceil(view.left / step); k * step < last; k++) {
    const x = view.x(k * step), text = `${Math.round(1000 * k * step) / 10}${k === 0 ? " cm" : ""}`.replace("-", "\u2212");
    node("path", {class: "igw-rule", d: path([[x, y], [x, y + 5]])}, svg);
    if (x > 16 && x < view.width - 14) node("text", {class: "igw-small", x, y: y + 17, "text-anchor": "middle"}, svg, text);
  }
}

// Draw the ground with a bar of a round length, and the object at its first position.
function home(svg, view, scene, radius) {
  const y = view.ground + 4, length = round(90 / view.scale), end = 8 + length * view.scale;
  if (view.cut === Infinity) {
    ruler(svg, view, y);
  } else {  // a film with a part left out has no positions
    node("path", {class: "igw-scale", d: path([[8, y + 13], [end, y + 13]])}, svg);
    node("text", {class: "igw-small", x: end + 6, y: y + 17}, svg, `${Math.round(1000 * length) / 10} cm`);
    node("path", {class: "igw-rule", d: path([[0, y], [view.width, y]])}, svg);
  }
  const touchX = view.x(scene.scenario.distance);
  const ghost = node("circle", {class: "igw-ghost", cx: touchX + radius, cy: view.axis, r: radius}, svg);
  node("path", {class: "igw-ghost", d: path([[touchX, view.ground - 2], [touchX, y]])}, svg);
  return ghost;
}

// Return the outline of an arrow to the right.
function arrow(x, y, length, head) {
  const neck = x + Math.max(length - head, 0), half = 0.22 * head, wing = 0.7 * head;
  return `${path([[x, y - half], [neck, y - half], [neck, y - wing], [x + length, y], [neck, y + wing],
                  [neck, y + half], [x, y + half]])}Z`;
}

function rectangle(svg, view, size, name) {
  const height = size.height * view.scale * (view.tall || 1);
  return node("rect", {class: name, rx: 2, y: view.axis - 0.5 * height, width: size.length * view.scale, height}, svg);
}

// Draw robot, coupling, flange, tool and object (radius in pixels); return a function that moves them to positions (m).
function drawBodies(svg, view, chain, radius) {
  const robot = node("rect", {class: "igw-arm", x: -4, y: view.axis - 5, height: 10}, svg);
  const ball = node("circle", {class: "igw-object", cy: view.axis, r: radius}, svg);
  const couple = COUPLINGS[chain.coupling](node("g", {}, svg), view, chain);
  const flange = rectangle(svg, view, FLANGE, "igw-flange"), tool = rectangle(svg, view, TOOL, "igw-tool");
  return (atFlange, atTool, atObject) => {
    const front = atFlange - TOOL.length - chain.rest, back = view.x(front - FLANGE.length);
    set(flange, {x: back});
    set(robot, {width: Math.max(back + 4, 0)});
    set(tool, {x: view.x(atTool - TOOL.length)});
    couple(front, atTool - TOOL.length);
    show(ball, atObject !== null);
    set(ball, {cx: view.x(atObject) + radius});
  };
}

// Draw a panel into `svg`; return a function that shows a state.
function drawChain(svg, scene, run, view) {
  svg.replaceChildren();
  set(svg, {viewBox: `0 0 ${view.width} ${view.height}`, width: view.width, height: view.height});
  const radius = Math.max(scene.radius * view.scale, 4), y = view.axis;
  const ghost = home(svg, view, scene, radius);
  const move = drawBodies(svg, view, run.chain, radius);
  const mass = node("text", {class: "igw-small", y: y + radius + 13}, svg, `object, ${three(scene.scenario.object_mass)} kg`);
  const seenTool = rectangle(svg, view, TOOL, "igw-seen");
  const seenBall = node("circle", {class: "igw-seen", cy: y, r: radius}, svg);
  const flash = node("path", {class: "igw-flash"}, svg);
  const push = node("path", {class: "igw-push"}, svg);
  const speed = node("path", {class: "igw-speed"}, svg);
  const speedText = node("text", {class: "igw-strong igw-object-text", y: y - 9}, svg);
  const moved = node("path", {class: "igw-moved"}, svg);
  const movedText = node("text", {class: "igw-strong igw-object-text", y: view.ground + 33}, svg);
  const middle = view.x(scene.scenario.distance + 0.5 * CUT), slash = (x) => path([[x - 4, view.ground + 14], [x + 4, y - 30]]);
  const cut = node("g", {}, svg);  // sign of a part that is left out, so that a long slide fits
  node("path", {class: "igw-cut-gap", d: slash(middle)}, cut);
  node("path", {class: "igw-scale", d: slash(middle - 4) + slash(middle + 4)}, cut);
  const magnifier = scene.compact ? () => {} : drawMagnifier(svg, scene, view);
  return (state, seen) => {
    for (const each of [seenTool, seenBall]) show(each, seen);
    if (seen) {  // the delayed state that the operator sees
      set(seenTool, {x: view.x(seen.tool_position - TOOL.length)});
      set(seenBall, {cx: view.x(seen.object_position) + radius});
    }
    const shift = Math.max(state.object_position - view.cut, 0), object = state.object_position - shift;
    const face = view.x(object), at = view.x(state.tool_position - shift), fraction = state.force / (scene.limits.force || 1);
    move(state.flange_position - shift, state.tool_position - shift, object);
    place(mass, face + radius, view.width);
    show(cut, shift);
    show(flash, fraction > 0.002);
    show(push, fraction > 0.002);
    if (fraction > 0.002) {
      const rays = [-80, -62, -44, 44, 62, 80].map((degrees) => {
        const turn = degrees * Math.PI / 180, inner = 6, outer = 10 + 16 * Math.sqrt(fraction);
        const across = Math.sin(turn), along = 0.9 * Math.cos(turn) * (Math.abs(degrees) > 60 ? 0 : -1);
        return path([[at + inner * along, y + inner * across], [at + outer * along, y + outer * across]]);
      });
      set(flash, {d: rays.join("")});
      set(push, {d: arrow(at, y, 14 + 44 * fraction, 9)});
    }
    const away = state.object_velocity > 0.0005;
    show(speed, away);
    show(speedText, away);
    if (away) {
      const edge = face + 2 * radius, length = 8 + 40 * state.object_velocity / scene.limits.speed;
      set(speed, {d: arrow(edge + 3, y, length, 10)});
      speedText.textContent = `now ${three(state.object_velocity)} m/s`;
      place(speedText, edge + 4, view.width, 1);
    }
    const far = state.object_position - scene.scenario.distance, start = view.x(scene.scenario.distance);
    const rests = !run.missed && state.time >= run.rest_time;
    show(ghost, far > 5e-4);
    for (const each of [moved, movedText]) show(each, far > 5e-4 || rests);
    set(moved, {d: path([[start, view.ground + 4], [face, view.ground + 4]])});
    movedText.textContent = rests ? `slid ${centimetres(run.slide)}` : `${centimetres(far)} from its start (dashed)`;
    place(movedText, 0.5 * (start + face), view.width);
    magnifier(state, at);
  };
}
