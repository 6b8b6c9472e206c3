// Tabs, links into folded parts, and charts, which are drawn when they become visible.
(() => {
  const tabs = [...document.querySelectorAll("[role=tab]")];
  const panelOf = (tab) => document.getElementById(tab.getAttribute("aria-controls"));

  // Vega is large, so it is loaded for the first chart, after the page is painted.
  const drawing = () => {
    if (window.vegaEmbed) return;
    const program = document.createElement("script");
    program.textContent = document.getElementById("_vega").textContent;
    document.head.append(program);
  };
  const draw = (element) => {
    element.dataset.drawn = "1";
    drawing();
    const spec = JSON.parse(document.getElementById(element.dataset.spec).textContent);
    if (element.clientWidth < 420) spec.config.legend.columns = 1;
    return vegaEmbed(element, spec, {renderer: "svg", actions: false});
  };
  const seen = (element) => !element.closest("details:not([open]), [hidden]");
  window.drawAll = async () => {
    document.documentElement.classList.remove("fresh");  // charts are as wide as their container
    await Promise.all([...document.querySelectorAll(".chart:not([data-drawn])")].filter(seen).map(draw));
  };
  const soon = window.requestIdleCallback || ((work) => setTimeout(work, 50));
  const later = () => soon(() => window.drawAll());

  const choose = (tab) => {
    for (const other of tabs) {
      const on = other === tab;
      other.setAttribute("aria-selected", String(on));
      other.tabIndex = on ? 0 : -1;
      panelOf(other).hidden = !on;
    }
    for (const link of document.querySelectorAll("[data-part]")) link.hash = link.dataset.part + panelOf(tab).id;
    later();
  };
  for (const tab of tabs) {
    tab.addEventListener("click", () => {
      choose(tab);
      history.replaceState(null, "", `#${panelOf(tab).id}`);
    });
    tab.addEventListener("keydown", (event) => {
      const count = tabs.length, at = tabs.indexOf(tab);
      const to = {ArrowRight: (at + 1) % count, ArrowLeft: (at + count - 1) % count, Home: 0, End: count - 1}[event.key];
      if (to === undefined) return;
      event.preventDefault();
      tabs[to].focus();
      tabs[to].click();
    });
  }

  // A link opens the tab and the folds around its target.
  const follow = () => {
    const target = document.getElementById(decodeURIComponent(location.hash.slice(1)));
    if (!target) return;
    const panel = target.closest("[role=tabpanel]");
    if (panel && panel.hidden) choose(tabs.find((tab) => panelOf(tab) === panel));
    for (let fold = target.closest("details"); fold; fold = fold.parentElement.closest("details")) fold.open = true;
    if (target !== panel) target.scrollIntoView();
  };
  addEventListener("hashchange", follow);
  document.addEventListener("toggle", later, true);

  // Print folded parts of the selected set-up as well.
  let opened = [];
  addEventListener("beforeprint", () => {
    opened = [...document.querySelectorAll(".fold:not([open]), .fails:not([open]), figcaption details:not([open])")]
      .filter((fold) => !fold.closest("[hidden]"));
    for (const fold of opened) fold.open = true;
    window.drawAll();
  });
  addEventListener("afterprint", () => { for (const fold of opened) fold.open = false; });
  requestAnimationFrame(() => setTimeout(() => {
    document.documentElement.classList.remove("fresh");
    follow();
    later();
  }));
})();
