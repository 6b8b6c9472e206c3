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
  send(text) { this.sent.push(JSON.parse(text)); }
  close() {}
};
