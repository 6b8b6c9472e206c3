// Theme, tabs, links into folded parts, and printing.
(() => {
  const button = document.getElementById("theme"), order = ["system", "light", "dark"], page = document.documentElement;
  button.addEventListener("click", () => {
    const next = order[(order.indexOf(page.dataset.theme || "system") + 1) % 3];
    if (next === "system") delete page.dataset.theme; else page.dataset.theme = next;
    button.textContent = `theme: ${next}`;
  });

  const tabs = [...document.querySelectorAll("[role=tab]")];
  const panelOf = (tab) => document.getElementById(tab.getAttribute("aria-controls"));
  const choose = (tab) => {
    for (const other of tabs) {
      const on = other === tab;
      other.setAttribute("aria-selected", String(on));
      other.tabIndex = on ? 0 : -1;
      panelOf(other).hidden = !on;
    }
    for (const link of document.querySelectorAll("[data-part]")) link.hash = link.dataset.part + panelOf(tab).id;
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

  for (const select of document.querySelectorAll("select.beside")) {
    const films = [...select.closest(".films").querySelectorAll(":scope > div")];
    select.addEventListener("change", () => films.forEach((film, k) => { film.hidden = k !== select.selectedIndex; }));
  }

  // A link opens the tab and the folded parts that contain its target.
  const follow = () => {
    const target = document.getElementById(decodeURIComponent(location.hash.slice(1)));
    if (!target) return;
    const panel = target.closest("[role=tabpanel]");
    if (panel && panel.hidden) choose(tabs.find((tab) => panelOf(tab) === panel));
    for (let fold = target.closest("details"); fold; fold = fold.parentElement.closest("details")) fold.open = true;
    if (target !== panel) target.scrollIntoView();
  };
  addEventListener("hashchange", follow);

  // Folded parts that are not in a hidden tab are printed, too.
  let opened = [];
  addEventListener("beforeprint", () => {
    opened = [...document.querySelectorAll(".fold:not([open]), .fails:not([open])")]
      .filter((fold) => !fold.closest("[hidden]"));
    for (const fold of opened) fold.open = true;
  });
  addEventListener("afterprint", () => { for (const fold of opened) fold.open = false; });
  requestAnimationFrame(() => setTimeout(() => {
    page.classList.remove("fresh");
    follow();
  }));
})();
