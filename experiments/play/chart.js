// How far objects slide over the time until all is done: rule, policy, and the player's own tries.
const CHART = {width: 360, height: 290, left: 40, right: 12, top: 20, bottom: 38};
const WHO = {"paper's rule": "rule", "learned policy": "policy", "scripted, alone": "alone"};

function drawChart(svg, tries, means) {
  svg.replaceChildren();
  set(svg, {viewBox: `0 0 ${CHART.width} ${CHART.height}`});
  const done = tries.filter((each) => !each.missed && !each.marks.length), last = done[done.length - 1];
  const twins = last ? Object.entries(last.beside) : [];
  const points = [...means, ...done, ...twins.map(([, each]) => each)];
  const latest = Math.max(4, ...points.map((each) => 1.08 * each.done_time));
  const most = Math.max(2, ...points.map((each) => 112 * each.slide));
  const x = (time) => CHART.left + (CHART.width - CHART.left - CHART.right) * time / latest;
  const y = (slide) => CHART.height - CHART.bottom - (CHART.height - CHART.top - CHART.bottom) * 100 * slide / most;
  const floor = y(0), step = round(most / 3), pace = latest > 6 ? 2 : 1;
  for (let k = 0; k * step < most; k++) {
    const at = y(k * step / 100);
    node("path", {class: k ? "grid" : "axis", d: path([[CHART.left, at], [CHART.width - CHART.right, at]])}, svg);
    node("text", {class: "soft-text", x: CHART.left - 6, y: at + 4, "text-anchor": "end"}, svg,
         String(Math.round(100 * k * step) / 100));
  }
  for (let time = 0; time < latest; time += pace) {
    node("text", {class: "soft-text", x: x(time), y: floor + 16, "text-anchor": "middle"}, svg, String(time));
  }
  node("text", {class: "soft-text", x: 2, y: 12}, svg, "object slides (cm)");
  node("text", {class: "soft-text", x: CHART.width - CHART.right, y: CHART.height - 4, "text-anchor": "end"}, svg,
       "all is done after (s)");
  for (const mean of means) {
    const at = [x(mean.done_time), y(mean.slide)], group = node("g", {class: `of-${WHO[mean.who]}`}, svg);
    node("circle", {class: "mean", cx: at[0], cy: at[1], r: 6}, group);
    const dy = {rule: -12, policy: 4, alone: -12}[WHO[mean.who]], beside = WHO[mean.who] === "policy";
    node("text", {class: "label", x: at[0] + (beside ? -11 : 0), y: at[1] + dy, "text-anchor": beside ? "end" : "middle"},
         group, WHO[mean.who] === "alone" ? "alone" : WHO[mean.who]);
  }
  done.forEach((each, k) => {
    const newest = k === done.length - 1, group = node("g", {class: "of-you"}, svg);
    const at = [x(each.done_time), y(each.slide)];
    if (newest) {
      for (const [who, twin] of twins) {
        const there = [x(twin.done_time), y(twin.slide)];
        node("path", {class: "tie", d: path([at, there])}, svg);
        node("circle", {class: `dot of-${WHO[who]}`, cx: there[0], cy: there[1], r: 4}, svg);
      }
      node("text", {class: "label", x: clamp(at[0], 50, CHART.width - 30), y: at[1] - 11, "text-anchor": "middle"}, svg, "you");
    }
    node("circle", {class: newest ? "last" : "dot", cx: at[0], cy: at[1], r: newest ? 6 : 4,
                    opacity: newest ? 1 : 0.35 + 0.5 * k / done.length}, group);
  });
  const words = last ? `Your last try: ${(100 * last.slide).toFixed(1)} cm after ${last.done_time.toFixed(1)} s. ` : "";
  const others = means.map((each) => `${each.who}: ${(100 * each.slide).toFixed(1)} cm after ${each.done_time.toFixed(1)} s`);
  svg.setAttribute("aria-label", `How far the object slides over the time until all is done. ${words}Means: ${others.join("; ")}.`);
}
