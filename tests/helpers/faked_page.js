// Stands in for the page's socket, so that a test plays the server; `fake` has what tests ask of the page.
window.fake = {
  sockets: [],
  hear: (messages) => messages.forEach((each) =>
    fake.sockets.at(-1).dispatchEvent(new MessageEvent("message", {data: JSON.stringify(each)}))),
  said: () => fake.sockets.at(-1).sent.splice(0),
  number: ([selector, name]) => Number(document.querySelector(selector).getAttribute(name)),
  all: ([selector, ...names]) => [...document.querySelectorAll(selector)]
    .map((each) => [each.textContent, ...names.map((name) => Number(each.getAttribute(name)))]),
  pick: ([name, text]) => [...document.querySelectorAll(`[data-set=${name}]`)].find((each) => each.textContent === text).click(),
  pad: (axis) => { navigator.getGamepads = () => [null, {axes: [axis, 0], buttons: []}]; },
  seek: (share) => {
    const slider = document.querySelector("#film .igw-slider");
    slider.value = share * slider.max;
    slider.dispatchEvent(new Event("input"));
  },
  // Texts of visible pictures in `selector` that their picture or the window cuts.
  cut: (selector) => [...document.querySelectorAll(`${selector} svg text`)].filter((text) => {
    const [box, frame] = [text, text.ownerSVGElement].map((each) => each.getBoundingClientRect());
    return box.width && frame.width && (box.left < frame.left - 0.5 || box.right > Math.min(frame.right, innerWidth) + 0.5
      || box.top < frame.top - 0.5 || box.bottom > frame.bottom + 0.5);
  }).map((text) => text.textContent),
  // Return now, and keep the time of each picture from now on in `fake.drawn`, ms.
  watch: () => {
    const note = () => { fake.drawn = performance.now(); requestAnimationFrame(note); };
    requestAnimationFrame(note);
    return performance.now();
  },
};
window.WebSocket = class extends EventTarget {
  static OPEN = 1;
  readyState = 1;
  sent = [];
  constructor() { super(); fake.sockets.push(this); }
  send(text) { this.sent.push({...JSON.parse(text), at: performance.now()}); }
  close() {}
};
