// Picture of flange, coupling, tool and object. Positions are to scale; sizes of the bodies are assumed.
const TOOL = {length: 0.034, height: 0.03}, FLANGE = {length: 0.016, height: 0.052}, CLEARANCE = 0.004;  // m
const MAGNIFIER = {width: 166, height: 74};
const BEHIND = 0.02, NEAR = 0.1, AHEAD = 106;  // space behind the robot (m), before the object in a compact film (m), for the speed (pixels)

function massText(scene) {
  return `object, ${three(scene.scenario.object_mass)} kg`;
}

function massFits(scene, scale) {
  return 1.7 * scene.radius * scale > 7.5 * massText(scene).length;
}

// Return scale, origin and size of the picture, which are equal in all panels.
function viewOf(scene, width) {
  const most = (name) => Math.max(...scene.runs.map((run) => run.chain[name] || 0));
  const behind = TOOL.length + most("rest") + FLANGE.length;
  const rearmost = scene.compact ? Math.max(scene.scenario.distance - NEAR, 0) : Math.min(scene.limits.rearmost, 0);
  const left = rearmost - behind - BEHIND;
  const right = scene.limits.farthest + 2 * scene.radius;
  const scale = (width - AHEAD) / (right - left);
  const above = Math.max(scene.radius, 0.5 * FLANGE.height, most("height") + 0.006) * scale + 8;
  const below = Math.max(scene.radius * scale + (massFits(scene, scale) ? 0 : 13), 0.5 * FLANGE.height * scale) + 6;
  const axis = (scene.compact ? 22 : MAGNIFIER.height + 14) + Math.max(above, 30);
  return {left, scale, width, axis, ground: axis + Math.max(below, 26), height: axis + Math.max(below, 26) + 36,
          x: (position) => (position - left) * scale};
}

function path(points) {
  return "M" + points.map((point) => point.map((value) => Math.round(value * 100) / 100).join(",")).join("L");
}

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

function ruler(svg, view, scene, radius) {
  const y = view.ground + 4;
  node("path", {class: "igw-rule", d: path([[0, y], [view.width, y]])}, svg);
  const step = round(90 / view.scale), last = view.left + view.width / view.scale;
  for (let k = Math.ceil(view.left / step); k * step < last; k++) {
    const x = view.x(k * step);
    node("path", {class: "igw-rule", d: path([[x, y], [x, y + 5]])}, svg);
    const text = `${Math.round(1000 * k * step) / 10}${k === 0 ? " cm" : ""}`.replace("-", "\u2212");
    if (x > 16 && x < view.width - 14) {
      node("text", {class: "igw-small", x, y: y + 17, "text-anchor": "middle"}, svg, text);
    }
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

// Draw a panel into `svg`; return a function that shows a state.
function drawChain(svg, scene, run, view) {
  svg.replaceChildren();
  set(svg, {viewBox: `0 0 ${view.width} ${view.height}`, width: view.width, height: view.height});
  const radius = Math.max(scene.radius * view.scale, 4), y = view.axis;
  const ghost = ruler(svg, view, scene, radius);
  const body = (size, name) => node("rect", {class: name, rx: 2, y: y - 0.5 * size.height * view.scale,
                                             width: size.length * view.scale, height: size.height * view.scale}, svg);
  const robot = node("rect", {class: "igw-arm", x: -4, y: y - 5, height: 10}, svg);
  const ball = node("circle", {class: "igw-object", cy: y, r: radius}, svg);
  const fits = massFits(scene, view.scale);
  const mass = node("text", {class: fits ? "igw-on-object" : "igw-small", "text-anchor": "middle",
                             y: fits ? y + 0.5 * radius + 5 : y + radius + 13}, svg, massText(scene));
  const couple = COUPLINGS[run.chain.coupling](node("g", {}, svg), view, run.chain);
  const flange = body(FLANGE, "igw-flange"), tool = body(TOOL, "igw-tool");
  const seenTool = body(TOOL, "igw-seen");
  const seenBall = node("circle", {class: "igw-seen", cy: y, r: radius}, svg);
  const flash = node("path", {class: "igw-flash"}, svg);
  const push = node("path", {class: "igw-push"}, svg);
  const speed = node("path", {class: "igw-speed"}, svg);
  const speedText = node("text", {class: "igw-strong igw-object-text", y: y - 9}, svg);
  const moved = node("path", {class: "igw-moved"}, svg);
  const movedText = node("text", {class: "igw-strong igw-object-text", y: view.ground + 33}, svg);
  const magnifier = scene.compact ? () => {} : drawMagnifier(svg, scene, view);
  return (state, seen) => {
    for (const each of [seenTool, seenBall]) show(each, seen);
    if (seen) {  // the delayed state that the operator sees
      set(seenTool, {x: view.x(seen.tool_position - TOOL.length)});
      set(seenBall, {cx: view.x(seen.object_position) + radius});
    }
    const front = state.flange_position - TOOL.length - run.chain.rest;
    const face = view.x(state.object_position), fraction = state.force / (scene.limits.force || 1);
    set(flange, {x: view.x(front - FLANGE.length)});
    set(robot, {width: Math.max(view.x(front - FLANGE.length) + 4, 0)});
    set(tool, {x: view.x(state.tool_position - TOOL.length)});
    couple(front, state.tool_position - TOOL.length);
    set(ball, {cx: face + radius});
    set(mass, {x: face + radius});
    const at = view.x(state.tool_position);
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
      set(speedText, {x: Math.min(edge + 4, view.width - 102)});
      speedText.textContent = `now ${three(state.object_velocity)} m/s`;
    }
    const far = state.object_position - scene.scenario.distance, home = view.x(scene.scenario.distance);
    show(ghost, far > 5e-4);
    show(moved, far > 5e-4);
    show(movedText, far > 5e-4);
    if (far > 5e-4) {
      set(moved, {d: path([[home, view.ground + 4], [face, view.ground + 4]])});
      set(movedText, {x: clamp(0.5 * (home + face), 90, view.width - 90), "text-anchor": "middle"});
      movedText.textContent = `${centimetres(far)} from its start (dashed)`;
    }
    magnifier(state, at);
  };
}
