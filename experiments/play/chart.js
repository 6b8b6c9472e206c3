// Chart of the player's attempts: slide of the object over the time until all is done; the colour is the assistance.
const CHART = {width: 380, height: 270, left: 40, right: 14, top: 22, bottom: 38};
const HELP = {none: "person", brake: "warning", limit: "profile", policy: "policy", rule: "rule"};

function drawChart(svg, attempts, assists) {
  svg.replaceChildren();
  set(svg, {viewBox: `0 0 ${CHART.width} ${CHART.height}`});
  const done = attempts.filter((each) => !each.missed && !each.marks.length), last = attempts[attempts.length - 1];
  const latest = Math.max(4, ...done.map((each) => 1.08 * each.done_time));
  const most = Math.max(3, ...done.map((each) => 112 * each.slide));
  const x = (time) => CHART.left + (CHART.width - CHART.left - CHART.right) * time / latest;
  const y = (slide) => CHART.height - CHART.bottom - (CHART.height - CHART.top - CHART.bottom) * 100 * slide / most;
  const floor = y(0), step = round(most / 3), pace = latest > 6 ? 2 : 1;
  node("rect", {class: "gentle", x: CHART.left, y: y(GENTLE), width: CHART.width - CHART.left - CHART.right, height: floor - y(GENTLE)}, svg);
  node("text", {class: "soft-text", x: CHART.left + 4, y: y(GENTLE) - 4}, svg, "gentle: under 1 cm");
  for (let k = 0; k * step < most; k++) {
    const at = y(k * step / 100);
    node("path", {class: k ? "grid" : "axis", d: path([[CHART.left, at], [CHART.width - CHART.right, at]])}, svg);
    node("text", {class: "soft-text", x: CHART.left - 6, y: at + 4, "text-anchor": "end"}, svg, String(Math.round(100 * k * step) / 100));
  }
  for (let time = 0; time < latest; time += pace) {
    node("text", {class: "soft-text", x: x(time), y: floor + 16, "text-anchor": "middle"}, svg, String(time));
  }
  node("text", {class: "soft-text", x: 2, y: 12}, svg, "object slides (cm)");
  node("text", {class: "soft-text", x: CHART.width - CHART.right, y: CHART.height - 4, "text-anchor": "end"}, svg, "all is done after (s)");
  Object.keys(HELP).filter((name) => done.some((each) => each.assist === name)).forEach((name, k) => node("text", {
    class: `label of-${HELP[name]}`, x: CHART.width - CHART.right, y: 12 + 15 * k, "text-anchor": "end"}, svg, `\u25cf ${assists[name]}`));
  const best = done.reduce((one, other) => !one || other.slide < one.slide ? other : one, null);
  for (const each of done) {
    const at = [x(each.done_time), y(each.slide)], newest = each === last;
    node("circle", {class: `dot of-${HELP[each.assist]}`, cx: at[0], cy: at[1], r: newest ? 7 : 4}, svg);
    if (newest) node("circle", {class: "ring", cx: at[0], cy: at[1], r: 10}, svg);
    if (newest || each === best && done.length > 1) {
      const text = [each === best && done.length > 1 ? "best" : "", newest ? "last" : ""].filter(Boolean).join(", ");
      node("text", {class: "label", x: clamp(at[0], 60, CHART.width - 40), y: at[1] - 13, "text-anchor": "middle"}, svg, text);
    }
  }
  if (last && last.missed) node("text", {class: "label", x: CHART.left + 8, y: CHART.top + 14}, svg, "the last try missed");
  const words = last && !last.missed ? `${centimetres(last.slide)} after ${last.done_time.toFixed(1)} s` : "missed";
  svg.setAttribute("aria-label", `How far the object slides over the time until all is done. Your last try: ${words}.`);
}
