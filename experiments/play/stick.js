// The player's command from keys, pointer or gamepad: a number from -1 (back) to 1 (forward).
const ZERO = 1 / 3, DEAD = 0.12, LEVELS = [0.1, 0.2, 0.4, 0.6, 0.8, 1];

function stickOf(element, on) {
  const knob = element.querySelector(".knob"), push = element.querySelector(".push");
  const sources = {keys: 0, pointer: 0, pad: 0}, down = {forward: false, back: false};
  let level = 3, value = 0, pressed = [], released = true;

  function merge() {
    const next = sources.pointer || sources.keys || sources.pad;
    if (next === value) return;
    value = next;
    const at = ZERO + (value > 0 ? value * (1 - ZERO) : value * ZERO), room = element.clientWidth - knob.offsetWidth;
    const left = clamp(at * element.clientWidth, 0.5 * knob.offsetWidth, room + 0.5 * knob.offsetWidth);
    knob.style.left = `${left}px`;
    push.style.left = `${Math.min(100 * ZERO, 100 * left / element.clientWidth)}%`;
    push.style.width = `${Math.abs(100 * left / element.clientWidth - 100 * ZERO) * (value !== 0)}%`;
    element.setAttribute("aria-valuenow", String(Math.round(100 * value)));
    const way = value > 0 ? "forward" : "back";
    element.setAttribute("aria-valuetext", value ? `${way}, ${Math.round(100 * Math.abs(value))} %` : "let go");
    on.moved(value);
  }

  function byKeys() {
    sources.keys = LEVELS[level] * (down.forward - down.back);
    merge();
  }

  function letGo() {
    down.forward = down.back = false;
    sources.keys = sources.pointer = 0;
    merge();
  }

  const ways = {ArrowRight: "forward", ArrowLeft: "back", d: "forward", a: "back"};
  const actions = {Enter: on.begin, b: on.again, " ": on.ended, Escape: on.ended};
  addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const way = ways[event.key], rung = {ArrowUp: 1, ArrowDown: -1}[event.key];
    const {target} = event, pressable = target.closest("button, summary, a") && ["Enter", " "].includes(event.key);
    if (!on.playing() && (pressable || target.closest("input, select"))) return;  // these keys operate the page
    if (!way && !rung && !actions[event.key]) return;
    event.preventDefault();
    if (event.repeat) return;
    if (way) {
      down[way] = true;
      on.pushed();
      byKeys();
    } else if (rung) {
      level = clamp(level + rung, 0, LEVELS.length - 1);
      on.level(LEVELS[level]);
      byKeys();
    } else {
      if (event.key === " " || event.key === "Escape") letGo();
      actions[event.key]();
    }
  });
  addEventListener("keyup", ({key}) => {
    if (ways[key]) down[ways[key]] = false;
    byKeys();
  });
  addEventListener("blur", letGo);
  document.addEventListener("visibilitychange", letGo);

  const point = (event) => {
    const box = element.getBoundingClientRect(), offset = (event.clientX - box.left) / box.width - ZERO;
    const wanted = clamp(offset > 0 ? offset / (0.97 - ZERO) : offset / (ZERO - 0.03), -1, 1);
    sources.pointer = Math.abs(wanted) < 0.04 ? 0 : Math.round(1000 * wanted) / 1000;
    merge();
  };
  element.addEventListener("pointerdown", (event) => {
    if (event.button) return;
    element.setPointerCapture(event.pointerId);
    element.focus({preventScroll: true});
    on.begin();
    point(event);
    event.preventDefault();
  });
  element.addEventListener("pointermove", (event) => { if (element.hasPointerCapture(event.pointerId)) point(event); });
  element.addEventListener("lostpointercapture", () => {
    sources.pointer = 0;
    merge();
  });

  const connected = () => navigator.getGamepads ? [...navigator.getGamepads()].filter(Boolean) : [];

  function buzz() {
    for (const {vibrationActuator: motor} of connected().slice(0, 1)) {
      if (motor && motor.playEffect) motor.playEffect("dual-rumble", {duration: 150, strongMagnitude: 1}).catch(() => {});
    }
  }

  function poll() {
    const pads = connected();
    for (const pad of pads.slice(0, 1)) {
      const x = pad.axes[0] || 0, size = Math.max(Math.abs(x) - DEAD, 0) / (1 - DEAD);
      const next = [0, 1].map((k) => Boolean(pad.buttons[k] && pad.buttons[k].pressed));
      if (next[0] && !pressed[0]) on.begin();
      if (size === 0) released = true;
      else if (released) released = !on.pushed();  // repeated until a try begins, because the page may not be ready
      if (next[1] && !pressed[1]) on.ended();
      pressed = next;
      sources.pad = Math.sign(x) * Math.round(1000 * Math.min(size, 1)) / 1000;
      merge();
    }
  }
  return {poll, letGo, buzz, get value() { return value; }};
}
