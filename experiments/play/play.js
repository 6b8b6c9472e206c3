// The page: connection to the server, player's input, and the try in progress.
const part = (id) => document.getElementById(id);
const PAUSE = 500;  // ms after a try, in which arrow keys do not begin the next try
const MOST_ATTEMPTS = 200;  // largest number of attempts on the chart
const BEAT = 60, LEAST = 6;  // ms, longest and shortest time between two messages
const AHEAD_OF_EYES = 12;  // ms, assumed time between drawing a picture and its appearance on the screen
const page = {
  hello: null, socket: null, stage: null, shown: {}, frame: null, came: 0, running: false, asked: false, player: false,
  attempts: [], sent: NaN, sentAt: 0, overAt: -Infinity, round: 0, won: false, played: null, playedRound: 0, film: 0,
};
const set_up = {};  // chosen settings, by name

function send(message) {
  if (page.socket && page.socket.readyState === WebSocket.OPEN) page.socket.send(JSON.stringify(message));
}

const write = (id, text) => { if (part(id).textContent !== text) part(id).textContent = text; };
const say = (text) => write("said", text);
const mode = (name, on) => document.body.classList.toggle(name, on);

function banner(text, label, action) {
  const box = part("banner");
  box.hidden = !text;
  box.textContent = text || "";
  if (label) html("button", {type: "button"}, box, label).addEventListener("click", action);
}

// Send a changed deflection at once, but not more often than the server allows; repeat an unchanged one every BEAT.
function steer(now) {
  if (!page.player || !(page.running || page.asked)) return;
  const value = stick.value, gap = now - page.sentAt;
  if (value !== page.sent && gap >= LEAST || gap >= BEAT) {
    send({v: value});
    Object.assign(page, {sent: value, sentAt: now});
  }
}

function begin() {
  if (!page.player || page.running || page.asked) return;
  if (page.won) pickRound(page.round + 1);
  ask(options(page.hello, set_up, page.round), page.round);
}

function ask(wanted, round) {
  if (!page.player || page.running || page.asked) return;
  Object.assign(page, {asked: true, played: wanted, playedRound: round, sent: NaN});
  send({begin: wanted});
}

const end = () => { if (page.running) send({done: 1}); };

// Return the assistance for a repetition of the last try: the brake, or none if the last try had an assistance.
function otherHelp() {
  return page.attempts.length && page.attempts[page.attempts.length - 1].assist === "none" ? "brake" : "none";
}

function again() {
  if (page.attempts.length) ask({...page.played || options(page.hello, set_up, page.round), assist: otherHelp()}, page.playedRound);
}

const stick = stickOf(part("stick"), {
  playing: () => page.running || page.asked,
  moved: () => steer(performance.now()),
  pushed: () => {
    if (performance.now() - page.overAt > PAUSE) begin();
    return page.running || page.asked;
  },
  begin, again, ended: end,
  level: (level) => {
    part("level").textContent = `${Math.round(100 * level)} %`;
    if (!page.running) write("state", `arrows push to ${Math.round(100 * level)} %`);
  },
});

const toStick = () => part("stick").focus({preventScroll: true});
const about = () => page.hello.setups[set_up.setup];

function layout() {
  const svg = part("picture");
  if (page.hello) page.stage = drawStage(svg, about(), Math.max(svg.clientWidth, 280), page.shown);
}

// Draw the picture as it is before a try; the object's radius in m.
function drawStart(radius = 0.03) {
  const {distance} = options(page.hello, set_up, page.round), seen = set_up.seen && distance !== undefined;
  Object.assign(page, {frame: null, shown: {home: null, slide: 0, radius, at: [0, 0, seen ? distance : null]}});
  layout();
}

function pickRound(number) {
  Object.assign(page, {round: number, won: false});
  choose(ROUNDS[number].sets);
}

// Change settings, and show them.
function choose(changes) {
  Object.assign(set_up, changes);
  if (changes.setup) set_up.stiffness = about().usual.stiffness;  // undefined: not on a spring
  drawStart();
  drawControls();
  toStick();
}

function drawControls() {
  drawSettings(page.hello, set_up, (picked, free) => {
    if (free) pickRound(ROUNDS.length - 1);
    choose(picked);
  });
  drawRounds(set_up, page.round, pickRound);
  const label = (id, text, key) => {
    part(id).replaceChildren(`${text} `);
    html("kbd", {}, part(id), key);
  };
  label("go", page.won ? `Next: ${ROUNDS[page.round + 1].name}` : page.attempts.length ? "Again" : "Begin", "Enter");
  label("help", `Again, ${otherHelp() === "brake" ? "with the brake" : "without help"}`, "B");
  part("help").hidden = page.attempts.length === 0;
}

function draw(now) {
  requestAnimationFrame(draw);
  stick.poll();
  steer(now);
  const {frame, stage} = page;
  if (!frame || !stage || frame.still) return;
  const fraction = clamp((performance.now() + AHEAD_OF_EYES - page.came) / (1000 * frame.dt || 1), 0, 1);
  stage(frame.from.map((from, k) => from === null || frame.to[k] === null ? frame.to[k] : from + fraction * (frame.to[k] - from)));
  const speed = frame.dt ? (frame.to[0] - frame.from[0]) / frame.dt * set_up.slow : 0;
  write("speed", `${Math.round(100 * speed)} cm/s`.replace("-", "\u2212"));
  write("clock", `${Math.max(about().horizon - frame.t, 0).toFixed(1)} s left`);
  frame.still = fraction >= 1;
}

// Show the film of a try, or without a name that of a model of a hand.
async function film(name) {
  const number = ++page.film, box = part("film");
  try {
    const answer = await fetch(`film/${encodeURIComponent(name)}`);
    if (!answer.ok) throw new Error(await answer.text());
    const {html: text, slides, words} = await answer.json();
    if (page.running || number !== page.film) return;
    show(part("late"), !name);
    box.innerHTML = text;
    box.prepend(html("h2", {}, null, name ? "Your own hand again" : "Why this is hard by hand"), html("p", {}, null, words));
    for (const watched of box.querySelectorAll("slow-motion")) watched.start();
    const line = name && part("answer").querySelector(".again");
    const texts = Object.entries(slides).map(([who, slide]) => `${who}: ${slide === null ? "missed" : centimetres(slide)}.`);
    if (line) line.textContent = texts.join(" ");
  } catch (problem) {
    box.textContent = problem.message;
  }
}

function result(entry) {
  const box = part("answer"), counted = page.attempts.filter((each) => !each.missed && !each.marks.length);
  const best = Math.min(...counted.map((each) => each.slide));
  box.hidden = false;
  box.replaceChildren();
  const headline = entry.missed ? "You did not touch it." : `It slid ${centimetres(entry.slide)}, done after ${entry.done_time.toFixed(1)} s.`;
  html("p", {class: "big"}, box, headline);
  const touched = entry.slide < GENTLE ? "Gentle!" : "Under 1 cm is gentle: be slow near the object, or take the brake.";
  const score = [entry.missed ? "Push farther, until the tool touches the object." : touched];
  if (page.won) score.push(`You have won this level. Next: ${ROUNDS[page.round + 1].task}`);
  if (Number.isFinite(best)) score.push(`Best so far: ${centimetres(best)}.`);
  html("p", {}, box, score.join(" "));
  for (const mark of entry.marks) html("p", {class: "bad"}, box, `Does not count. ${mark[0].toUpperCase()}${mark.slice(1)}.`);
  html("p", {class: "again soft"}, box, entry.missed ? "" : "Your own hand is played again\u2026");
  say(`${headline} ${score.join(" ")} Press Enter for the next try, B to try again with other help.`);
}

function tabulate() {
  part("rows").replaceChildren();
  part("earlier").hidden = part("figure").hidden = page.attempts.length === 0;
  page.attempts.slice(-50).reverse().forEach((each, k) => {
    const row = html("tr", {}, part("rows")), number = String(page.attempts.length - k), delay = String(Math.round(1000 * each.delay));
    const results = each.missed ? ["missed", "", ""] : [three(each.object_velocity), centimetres(each.slide), each.done_time.toFixed(2)];
    const assist = [page.hello.assists[each.assist], ...each.marks].join("; ");
    for (const text of [number, assist, delay, ...results]) html("td", {}, row, text);
    html("button", {type: "button", "aria-label": `Watch try ${number}`}, html("td", {}, row), "watch").addEventListener("click", () => film(each.name));
  });
  drawChart(part("chart"), page.attempts, page.hello.assists);
}

function ready() {
  part("go").disabled = part("help").disabled = !page.player || page.running;
  part("end").disabled = !page.running;
}

const HEARD = {
  hello(message) {
    const round = message.attempts.length ? ROUNDS.length - 1 : 0;
    Object.assign(page, {hello: message, attempts: message.attempts, round});
    Object.assign(set_up, message.setups[message.setup].usual, {assist: message.assist, slow: 1, seen: false});
    choose({setup: message.setup, ...ROUNDS[page.round].sets});
    tabulate();
    film("");
    page.player = true;
    write("state", matchMedia("(max-width: 44rem), (hover: none)").matches ? "drag the stick" : "hold \u2192, or drag the stick");
    ready();
  },
  taken: () => page.socket.close(4000, "another tab took the stick"),
  began(message) {
    Object.assign(page, {running: true, asked: false});
    mode("playing", true);
    mode("touching", false);
    if (page.hello.setups[message.setup] && set_up.setup !== message.setup) choose({setup: message.setup});
    drawStart(message.radius);
    part("answer").hidden = true;
    write("state", `${page.played && page.played.assist === "brake" ? "brake on: " : ""}push until you touch`);
    part("film").replaceChildren();
    ready();
  },
  frame(message) {
    page.frame = message;
    page.came = performance.now();
    if (message.touched && page.running && !document.body.classList.contains("touching")) {
      mode("touching", true);
      write("state", "touched: let go!");
      say("Touched.");
      stick.buzz();
    }
  },
  ended({entry}) {
    over();
    page.attempts = [...page.attempts, entry].slice(-MOST_ATTEMPTS);
    if (page.frame) page.frame.still = false;
    page.shown.slide = entry.missed ? 0 : entry.slide;
    const gentle = page.playedRound === page.round && !entry.missed && entry.slide < GENTLE;
    page.won = (page.won || gentle) && page.round < ROUNDS.length - 1;
    drawControls();
    result(entry);
    tabulate();
    write("state", entry.missed ? "missed" : `slid ${centimetres(entry.slide)}`);
    if (entry.missed) part("film").replaceChildren();
    else film(entry.name);
  },
  failed(message) {
    over();
    banner(message.text);
    say(message.text);
    write("state", "press Enter to try again");
  },
};

function over() {
  Object.assign(page, {running: false, asked: false, overAt: performance.now()});
  for (const name of ["playing", "touching"]) mode(name, false);
  ready();
}

const link = (text) => ["state", "go"].forEach((id) => write(id, text));
function connect() {
  banner("");
  link("connecting\u2026");
  const socket = page.socket = new WebSocket(`ws://${location.host}${location.pathname}ws`);
  socket.addEventListener("message", (event) => {
    const message = JSON.parse(event.data);
    HEARD[message.kind](message);
  });
  socket.addEventListener("close", (event) => {
    page.player = false;
    over();
    link("no connection");
    const retry = event.code !== 1012 && event.code !== 1006;
    banner(retry ? `The connection was closed: ${event.reason || "no reason given"}.`
      : "The server has stopped; the tries that ended are kept. Start it again, then open the address that it prints.",
      retry ? "Connect again" : "", connect);
  });
}

part("go").addEventListener("click", begin);
part("help").addEventListener("click", again);
part("end").addEventListener("click", end);
document.addEventListener("click", (event) => {  // a click by mouse or finger moves the focus to the stick, a key does not
  if (event.detail && event.target.closest("button, summary, input, select")) toStick();
});
new ResizeObserver(layout).observe(part("picture"));
addEventListener("pagehide", () => page.socket && page.socket.close());
connect();
toStick();
requestAnimationFrame(draw);
