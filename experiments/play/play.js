// The page: one connection, one stick, one try at a time.
const part = (id) => document.getElementById(id);
const HOLDS = {rigid: "fixed to the arm", spring: "a spring and a damper", bistable: "a bistable mechanism"};
const MOST_TRIES = 200;  // on the chart
const BEAT = 60, LEAST = 6;  // ms, between two messages at the most and at the least
const AHEAD_OF_EYES = 12;  // ms, until what is drawn now is seen
const page = {
  hello: null, socket: null, stage: null, frame: null, came: 0, running: false, asked: false, player: false,
  tries: [], means: [], sent: NaN, sentAt: 0,
};

function send(message) {
  if (page.socket && page.socket.readyState === WebSocket.OPEN) page.socket.send(JSON.stringify(message));
}

function say(text) {
  part("said").textContent = text;
}

function state(text) {
  part("state").textContent = text;
}

function write(id, text) {
  if (part(id).textContent !== text) part(id).textContent = text;
}

function mode(name, on) {
  document.body.classList.toggle(name, on);
}

function banner(text, label, action) {
  const box = part("banner");
  box.hidden = !text;
  box.textContent = text || "";
  if (label) html("button", {type: "button"}, box, label).addEventListener("click", action);
}

// The stick's deflection goes out at once, but not more often than the server listens; unchanged it goes as a beat.
function steer(now) {
  if (!page.player || !(page.running || page.asked)) return;
  const value = stick.value, gap = now - page.sentAt;
  if (value !== page.sent && gap >= LEAST || gap >= BEAT) {
    send({v: value});
    page.sent = value;
    page.sentAt = now;
  }
}

function options() {
  const of = (id) => Number(part(id).value);
  const chosen = {setup: part("setup").value, assist: part("assist").value, delay: of("delay"), jitter: of("jitter"),
                  slow: of("slow"), seen: !part("unseen").checked};
  return part("stiffness-label").hidden ? chosen : {...chosen, stiffness: stiffness()};
}

function begin() {
  if (!page.player || page.running || page.asked) return;
  page.asked = true;
  send({begin: options()});
  page.sent = NaN;
}

function end() {
  if (page.running) send({done: 1});
}

const stick = stickOf(part("stick"), {
  moved: () => steer(performance.now()),
  pressed: begin,
  ended: end,
  level: (level) => {
    part("level").textContent = `${Math.round(100 * level)} %`;
    if (!page.running) state(`arrows push to ${Math.round(100 * level)} %`);
  },
});

function about() {
  return page.hello.setups[part("setup").value];
}

function stiffness() {
  const [low, high] = page.hello.stiffness;
  return Math.round(low * (high / low) ** Number(part("stiffness").value));
}

function layout() {
  if (!page.hello) return;
  const svg = part("picture"), width = Math.max(svg.clientWidth, 280);
  page.stage = drawStage(svg, about(), width);
  if (page.frame) page.stage.update(page.frame.from);
}

function words() {
  part("delay-value").textContent = `${Math.round(1000 * part("delay").value)} ms`;
  part("jitter-value").textContent = `${Math.round(1000 * part("jitter").value)} ms`;
  part("stiffness-value").textContent = `${stiffness()} N/m`;
}

function usual() {
  const {usual: at} = about(), [low, high] = page.hello.stiffness;
  part("stiffness-label").hidden = at.stiffness === undefined;
  part("delay").value = at.delay;
  part("jitter").value = at.jitter;
  if (at.stiffness) part("stiffness").value = Math.log(at.stiffness / low) / Math.log(high / low);
  words();
}

function draw(now) {
  requestAnimationFrame(draw);
  stick.poll();
  steer(now);
  const {frame, stage} = page;
  if (!frame || !stage || frame.still) return;
  const share = clamp((performance.now() + AHEAD_OF_EYES - page.came) / (1000 * frame.dt || 1), 0, 1);
  stage.update(frame.from.map((from, k) => from === null || frame.to[k] === null ? frame.to[k] : from + share * (frame.to[k] - from)));
  const speed = frame.dt ? (frame.to[0] - frame.from[0]) / frame.dt * Number(part("slow").value) : 0;
  write("speed", `${Math.round(100 * speed)} cm/s`.replace("-", "\u2212"));
  write("clock", `${Math.max(about().horizon - frame.t, 0).toFixed(1)} s left`);
  frame.still = share >= 1;
}

async function fetched(where) {
  const answer = await fetch(where);
  if (!answer.ok) throw new Error(await answer.text());
  return answer;
}

async function film(name) {
  const box = part("film");
  try {
    const text = await (await fetched(name ? `film/${encodeURIComponent(name)}` : "film")).text();
    if (page.running) return;
    box.innerHTML = text;
    const heading = html("h2", {}, null, name ? "In slow motion, beside rule and policy" : "Ten seconds to look: rule, policy and a person in one scene");
    box.prepend(heading);
    if (name) for (const watched of box.querySelectorAll("slow-motion")) watched.start();
  } catch (problem) {
    box.textContent = problem.message;
  }
}

function centimetres(value) {
  if (value < 5e-5) return "less than 0.1 mm";
  return value < 1e-3 ? `${(1000 * value).toFixed(1)} mm` : `${(100 * value).toFixed(1)} cm`;
}

function result(entry) {
  const box = part("answer");
  box.hidden = false;
  box.replaceChildren();
  const headline = entry.missed ? "Nothing was touched." : `It slid ${centimetres(entry.slide)}.`;
  html("p", {class: "big"}, box, headline);
  const others = Object.entries(entry.beside).filter(([, each]) => !each.missed)
    .map(([who, each]) => `${who} ${centimetres(each.slide)} in ${each.done_time.toFixed(1)} s`);
  if (others.length) html("p", {}, box, `In the same scene: ${others.join(", ")}.`);
  for (const mark of entry.marks) html("p", {class: "bad"}, box, `Does not count, ${mark}.`);
  const list = html("dl", {}, box);
  const rows = entry.missed ? [["done after", `${entry.done_time.toFixed(2)} s`]]
    : [["V\u209a", `${three(entry.object_velocity)} m/s`], ["slid", centimetres(entry.slide)],
       ["done after", `${entry.done_time.toFixed(2)} s`], ["peak force", `${newtons(entry.peak_force)} N`]];
  for (const [name, value] of rows) {
    const row = html("div", {}, list);
    html("dt", {}, row, name);
    html("dd", {}, row, value);
  }
  say(`${headline} ${others.join(", ")}. Press the right arrow for the next try.`);
}

function tabulate() {
  part("rows").replaceChildren();
  part("earlier").hidden = page.tries.length === 0;
  page.tries.slice(-50).reverse().forEach((each, k) => {
    const row = html("tr", {}, part("rows")), number = page.tries.length - k;
    html("td", {class: "left"}, row, String(number));
    html("td", {class: "left"}, row, page.hello.assists[each.assist] + (each.marks.length ? `; ${each.marks.join("; ")}` : ""));
    html("td", {}, row, String(Math.round(1000 * each.delay)));
    for (const text of each.missed ? ["missed", "", ""] : [three(each.object_velocity), (100 * each.slide).toFixed(1), each.done_time.toFixed(2)]) {
      html("td", {}, row, text);
    }
    const cell = html("td", {class: "left"}, row);
    html("button", {type: "button", "aria-label": `Watch try ${number}`}, cell, "watch").addEventListener("click", () => film(each.name));
  });
  drawChart(part("chart"), page.tries, page.means);
}

function ready() {
  part("go").disabled = !page.player || page.running;
  part("end").disabled = !page.running;
}

const HEARD = {
  hello(message) {
    page.hello = message;
    page.tries = message.tries;
    for (const [id, entries] of [["setup", Object.entries(message.setups).map(([name, each]) => [name, HOLDS[each.chain.coupling]])],
                                 ["assist", Object.entries(message.assists)]]) {
      part(id).replaceChildren();
      for (const [value, text] of entries) html("option", {value}, part(id), text);
      part(id).value = message[id];
    }
    part("delay").max = message.delay[1];
    part("jitter").max = message.jitter[1];
    usual();
    layout();
    tabulate();
    film("");
    fetched("reference").then((answer) => answer.json()).then((means) => {
      page.means = means;
      tabulate();
    }, (problem) => banner(problem.message));
  },
  role(message) {
    page.player = message.player;
    mode("watching", !message.player);
    if (!message.player) {
      banner("Another tab has the stick. You are watching.", "Take the stick", () => send({take: 1}));
    } else {
      banner(message.others ? `You have the stick; ${message.others} more ${message.others > 1 ? "tabs are" : "tab is"} watching.` : "");
    }
    ready();
  },
  began(message) {
    page.running = true;
    page.asked = false;
    page.frame = null;
    mode("looking", false);
    mode("playing", true);
    mode("touching", false);
    if (page.hello.setups[message.setup] && part("setup").value !== message.setup) part("setup").value = message.setup;
    layout();
    page.stage.begin(message.radius);
    state("go on until you touch");
    part("film").replaceChildren();
    ready();
  },
  frame(message) {
    page.frame = message;
    page.came = performance.now();
    if (message.touched && page.running && !document.body.classList.contains("touching")) {
      mode("touching", true);
      state("touched: let go!");
      say("Touched.");
    }
  },
  ended(message) {
    over();
    page.tries = [...page.tries, message.entry].slice(-MOST_TRIES);
    result(message.entry);
    tabulate();
    state("press \u2192 for the next try");
    film(message.entry.name);
  },
  failed(message) {
    over();
    banner(message.text);
    say(message.text);
    state("press \u2192 to try again");
  },
};

function over() {
  page.running = page.asked = false;
  mode("playing", false);
  mode("touching", false);
  ready();
}

function connect() {
  banner("");
  const socket = new WebSocket(`ws://${location.host}${location.pathname}ws`);
  page.socket = socket;
  socket.addEventListener("message", (event) => {
    const message = JSON.parse(event.data);
    HEARD[message.kind](message);
  });
  socket.addEventListener("close", (event) => {
    page.player = false;
    over();
    part("go").disabled = true;
    const again = event.code !== 1012 && event.code !== 1006;
    banner(again ? `The server closed the connection: ${event.reason || "no reason given"}.`
      : "The server has stopped; the tries that ended are kept. Start it again and open the address that it prints.",
      again ? "Connect again" : "", connect);
  });
}

part("go").addEventListener("click", () => {
  begin();
  part("stick").focus({preventScroll: true});
});
part("end").addEventListener("click", end);
for (const id of ["delay", "jitter", "stiffness"]) part(id).addEventListener("input", words);
part("setup").addEventListener("change", () => {
  usual();
  page.frame = null;
  layout();
});
part("theme").addEventListener("click", () => {
  const order = ["system", "light", "dark"], root = document.documentElement;
  const next = order[(order.indexOf(root.dataset.theme || "system") + 1) % 3];
  if (next === "system") delete root.dataset.theme; else root.dataset.theme = next;
  part("theme").textContent = `theme: ${next}`;
});
new ResizeObserver(layout).observe(part("picture"));
addEventListener("pagehide", () => page.socket && page.socket.close());
connect();
requestAnimationFrame(draw);
