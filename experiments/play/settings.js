// Settings are buttons, so that arrow keys always move the stick. Three levels set some of them.
const HOLDS = {rigid: "fixed to the arm", spring: "a spring and a damper", bistable: "a bistable mechanism"};
const SLOW = {1: "real time", 2: "half", 4: "a quarter", 8: "an eighth"};
const ROUNDS = [
  {name: "near", task: "The object is near. Push until the tool touches it, then let go.", fraction: 0.15, sets: {delay: 0, jitter: 0, seen: true}},
  {name: "far", task: "The object is far, and you are far away, too.", fraction: 0.85, sets: {delay: 0.2, jitter: 0, seen: true}},
  {name: "blind and late", task: "You do not see the object until the tool touches it.", sets: {delay: 0.2, jitter: 0, seen: false}},
  {name: "free play", task: "Choose the settings below.", sets: {}},
];

// Return the values with which the server begins a try.
function options(hello, chosen, number) {
  const {fraction} = ROUNDS[number], [near, far] = hello.setups[chosen.setup].distance;
  return fraction === undefined ? {...chosen} : {...chosen, distance: near + fraction * (far - near)};
}

function drawRounds(chosen, number, pick) {
  const box = part("rounds");
  box.replaceChildren();
  ROUNDS.forEach((each, k) => {
    const button = html("button", {type: "button", "aria-pressed": String(k === number)}, box);
    if (k < ROUNDS.length - 1) html("b", {}, button, String(k + 1));
    button.append(each.name);
    button.addEventListener("click", () => pick(k));
  });
  const late = chosen.delay ? ` Delay: ${Math.round(1000 * chosen.delay)} ms, half for your commands, half for the picture.` : " No delay.";
  write("task", ROUNDS[number].task + late);
}

// Draw a row of buttons for each setting; `pick(changes, free)`: `free` says whether levels set this setting, too.
function drawSettings(hello, chosen, pick) {
  const milliseconds = (value) => `${Math.round(1000 * value)} ms`;
  const within = (values, [low, high], own) => [...new Set([...values, own])].filter((value) => value >= low && value <= high)
    .sort((one, other) => one - other);
  const groups = [
    ["assist", "Who assists you", Object.keys(hello.assists), (name) => hello.assists[name]],
    ["setup", "What holds the tool", Object.keys(hello.setups), (name) => HOLDS[hello.setups[name].chain.coupling]],
    ["delay", "Delay, there and back", within([0, 0.1, 0.2, 0.4, 1], hello.delay, chosen.delay), milliseconds],
    ["jitter", "Jitter of the delay", within([0, 0.005, 0.02, 0.05], hello.jitter, chosen.jitter), milliseconds],
    ["stiffness", "Stiffness of the spring", within([20, 50, 200, 1000], hello.stiffness, chosen.stiffness), (value) => `${value} N/m`],
    ["slow", "Speed of the clock", [1, 2, 4, 8], (value) => SLOW[value]],
    ["seen", "The object before the touch", [true, false], (value) => value ? "seen" : "unseen"],
  ].filter(([name]) => chosen[name] !== undefined);
  part("knobs").replaceChildren();
  for (const [name, title, values, text] of groups) {
    const box = html("div", {role: "group", "aria-label": title, class: "knob-row"}, part("knobs"));
    html("span", {}, box, title);
    for (const value of values) {
      const button = html("button", {type: "button", "data-set": name, "aria-pressed": String(value === chosen[name])}, box, text(value));
      button.addEventListener("click", () => pick({[name]: value}, ["delay", "jitter", "seen"].includes(name)));
    }
  }
  const words = [hello.assists[chosen.assist], HOLDS[hello.setups[chosen.setup].chain.coupling], milliseconds(chosen.delay)];
  write("chosen", `assisted by ${words[0]}, tool: ${words[1]}, ${words[2]}`);
}
