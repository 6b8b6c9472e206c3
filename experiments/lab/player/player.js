// Clock and controls of a film. A film is built when it first becomes visible, or by `start`.
function watch(root, gone) {
  const films = JSON.parse(root.querySelector(".igw-films").textContent);
  films.columns.forEach((name, k) => { COLUMNS[name] = k; });
  const part = (name) => root.querySelector(`.igw-${name}`);
  const select = part("select"), button = part("play"), slider = part("slider"), speed = part("speed");
  const STEPS = 500;  // number of positions of the slider
  const still = window.matchMedia("(prefers-reduced-motion: reduce)");
  let scene, clock, panels = [], film = 0, playing = false, before = 0, said = 0, waiting = 0, width = 0;

  function phase(state, run) {
    const until = run.alarm === null ? -1 : run.alarm - state.time;
    const underWay = until > 0 && state.contacts > 0 && until < 0.1;
    const alarm = underWay ? `; alarm in ${(1000 * until).toFixed(1)} ms`
      : run.alarm !== null && state.time >= run.alarm ? "; alarm given" : "";
    const of = run.contacts.length > 1 && state.contacts ? ` ${state.contacts} of ${run.contacts.length}` : "";
    if (state.contact >= 0) return `in contact${of}, ${newtons(state.force)} N${alarm}`;
    if (!state.contacts) return `approaching, tool ${three(state.tool_velocity)} m/s`;
    return `apart${of ? ` after contact${of}` : ""}, object ${three(state.object_velocity)} m/s${alarm}`;
  }

  // Return the time as text (ms), with a second decimal where the film is at least 100 times slower than real time.
  function clockText(time) {
    return `${(1000 * time).toFixed(clock.slower(time) >= 100 ? 2 : 1)} ms`;
  }

  function rate() {
    const slower = clock.slower(clock.time(film)) / Number(speed.value);
    const times = Math.round(100 * Math.max(slower, 1 / slower)) / 100;
    return times === 1 ? "real speed" : `${times} times ${slower > 1 ? "slower" : "faster"} than real`;
  }

  function say(soon) {
    const now = performance.now();
    if (!soon && now - said < 3000) return;
    said = now;
    const time = clock.time(film), words = panels.map(({run}) => `${run.name}: ${phase(stateAt(run, time), run)}`);
    part("live").textContent = `${clockText(time)}. ${words.join(". ")}.`;
    panels.forEach((panel, k) => panel.chain.setAttribute("aria-label", `At ${clockText(time)}, ${words[k]}`));
  }

  function draw() {
    if (!panels[0].update) return;  // the film's tab was not opened yet
    const time = clock.time(film);
    for (const panel of panels) {
      const state = stateAt(panel.run, time);
      panel.update(state, panel.run.late && !scene.compact ? stateAt(panel.run, Math.max(time - panel.run.late, 0)) : null);
      panel.strip.move(state);
      panel.state.textContent = phase(state, panel.run);
      panel.state.classList.toggle("igw-touching", state.contact >= 0);
    }
    const text = clockText(time);
    part("time").textContent = text;
    part("rate").textContent = rate();
    slider.value = STEPS * film / clock.length;
    slider.setAttribute("aria-valuetext", `${text}, ${rate()}`);
  }

  function seek(to) {
    film = clamp(to, 0, clock.length);
    draw();
  }

  function run(on) {
    playing = on;
    button.textContent = on ? "Pause" : "Play";
    button.setAttribute("aria-label", on ? "Pause the film" : "Play the film");
    if (on) {
      if (film >= clock.length - 1e-6) film = 0;
      before = performance.now();
      requestAnimationFrame(tick);
    } else {
      say(true);
    }
  }

  function tick(now) {
    if (!playing || !root.isConnected) return;
    seek(film + Math.max(now - before, 0) / 1000 * Number(speed.value));
    before = now;
    say(false);
    if (film >= clock.length) run(false); else requestAnimationFrame(tick);
  }

  function stop() {
    if (playing) run(false);
    clearTimeout(waiting);
    waiting = setTimeout(() => say(true), 400);
  }

  // Return the film time of the still picture: the largest force on the first contestant that touches.
  function poster() {
    const touching = scene.runs.find((run) => run.contacts.length);
    if (!touching) return clock.length;
    const forces = touching.rows[COLUMNS.contact_force];
    return clock.film(touching.rows[COLUMNS.time][forces.indexOf(Math.max(...forces))]);
  }

  function verdict() {
    const [baseline, policy] = scene.runs;
    if (!policy || scene.runs.length > 2 || policy.slide !== undefined || baseline.missed || policy.missed) return "";
    const percent = Math.round(100 * Math.abs(1 - policy.object_velocity / baseline.object_velocity));
    const late = 1000 * (policy.approach_time - baseline.approach_time);
    const when = Math.abs(late) < 0.5 ? "at the same time"
      : `${Math.abs(late).toFixed(0)} ms ${late > 0 ? "later" : "sooner"}`;
    const than = policy.object_velocity < baseline.object_velocity ? "slower (gentler)" : "faster (less gentle)";
    return `This one object leaves ${percent} % ${than} with the ${policy.name}; touch ${when}.`;
  }

  function marks() {
    const track = part("marks");
    track.replaceChildren();
    scene.runs.forEach((each, k) => {
      const row = html("div", {class: `igw-mark-row igw-who-${k}`}, track);
      for (const [start, end] of each.contacts.map((contact) => contact.map(clock.film))) {
        const mark = html("span", {}, row);
        mark.style.left = `${100 * start / clock.length}%`;
        mark.style.width = `${100 * (end - start) / clock.length}%`;
      }
    });
  }

  function layout() {
    const wide = panels[0].head.clientWidth;
    if (!wide) return;
    width = wide;
    const view = viewOf(scene, width);
    for (const panel of panels) {
      panel.update = drawChain(panel.chain, scene, panel.run, view);
      panel.strip = drawStrips(panel.strips, scene, panel.run, clock, width);
      const point = (event) => {
        seek(panel.strip.film(event.clientX - panel.strips.getBoundingClientRect().left));
        stop();
      };
      panel.strip.hit.addEventListener("pointerdown", point);
      panel.strip.hit.addEventListener("pointermove", (event) => { if (event.buttons) point(event); });
    }
    draw();
  }

  function open(number) {
    scene = films.scenes[number];
    clock = clockOf(scene);
    const of = scene.scenario, where = part("panels");
    part("about").textContent = `Scenario ${scene.number}: object of ${three(of.object_mass)} kg, `
      + `${of.distance.toFixed(3)} m ahead; `
      + `contact stiffness ${of.contact_stiffness.toPrecision(2).replace("e+", "e")} N/m^1.5, `
      + `restitution ${of.restitution.toFixed(2)}.`;
    part("verdict").textContent = verdict();
    root.classList.toggle("igw-compact", Boolean(scene.compact));
    where.replaceChildren();
    panels = scene.runs.map((each, k) => {
      const box = html("article", {class: `igw-panel igw-who-${k}`}, where);
      const head = html("header", {}, box);
      html("h3", {}, head, each.name);
      const slides = each.slide === undefined ? `object's final speed ${three(each.object_velocity)} m/s`
        : `object slides ${centimetres(each.slide)}, done after ${each.done_time.toFixed(1)} s`;
      html("strong", {}, head, each.missed ? "object missed" : slides);
      html("p", {class: "igw-facts"}, head, each.contacts.length ? `touch after ${Math.round(1000 * each.approach_time)} ms`
        + ` \u00b7 peak force ${newtons(each.peak_force)} N`
        + ` \u00b7 ${each.contact_count} contact${each.contact_count === 1 ? "" : "s"}` : "");
      if (each.sentence) html("p", {class: "igw-sentence"}, head, each.sentence);
      const chain = node("svg", {class: "igw-chain", role: "img"}, box);
      const state = html("p", {class: "igw-state", "aria-hidden": "true"}, box);
      html("p", {class: "igw-strip-name", "aria-hidden": "true"}, box, each.name);
      const strips = node("svg", {class: "igw-strips", role: "img",
                                  "aria-label": `${each.name}: velocities and contact force against time`}, box);
      return {run: each, head, chain, state, strips};
    });
    film = poster();
    marks();
    layout();
    say(true);
  }

  films.scenes.forEach((each, k) => html("option", {value: String(k)}, select, each.label.replace("V_p", "V\u209a")));
  select.addEventListener("change", () => {
    if (playing) run(false);
    open(Number(select.value));
  });
  button.addEventListener("click", () => run(!playing));
  slider.addEventListener("input", () => {
    seek(Number(slider.value) / STEPS * clock.length);
    stop();
  });
  speed.addEventListener("change", draw);
  window.addEventListener("beforeprint", () => {
    if (playing) run(false);
    seek(poster());
  }, {signal: gone});
  open(0);
  new ResizeObserver(() => { if (panels[0].head.clientWidth !== width) layout(); }).observe(part("panels"));
  if (!still.matches && window.IntersectionObserver) {
    const seen = new IntersectionObserver((entries) => {
      if (entries.some((entry) => entry.isIntersecting)) {
        seen.disconnect();
        film = 0;
        run(true);
      }
    }, {threshold: 0.6});
    seen.observe(part("panels"));
  }
}

customElements.define("slow-motion", class extends HTMLElement {
  connectedCallback() {
    this.seen = new IntersectionObserver((entries) => {
      if (entries.some((entry) => entry.isIntersecting)) this.start();
    });
    this.seen.observe(this);
  }

  // Build the film even if it is not visible.
  start() {
    this.seen.disconnect();
    this.gone = new AbortController();
    watch(this, this.gone.signal);
  }

  disconnectedCallback() {
    this.seen.disconnect();
    if (this.gone) this.gone.abort();
  }
});
