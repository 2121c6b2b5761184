// A table that is wider than the page scrolls by mouse or finger; this lets the arrow keys do so, too.
const reach = () =>
  document.querySelectorAll(".md-typeset__scrollwrap").forEach((table) => {
    if (table.scrollWidth > table.clientWidth) {
      table.tabIndex = 0;
      table.setAttribute("role", "region");
      table.setAttribute("aria-label", "Table");
    }
  });
window.addEventListener("load", () => requestAnimationFrame(reach));
window.addEventListener("resize", reach);
