// A plot is drawn when it is first seen: two hundred plans at once are more than a browser bears.
const draw = (part) => part.querySelectorAll(".plot").forEach((place) => {
  if (place.dataset.drawn || place.closest("details:not([open])")) return;
  place.dataset.drawn = "yes";
  const figure = JSON.parse(document.getElementById(place.dataset.figure).textContent);
  Plotly.newPlot(place, { ...figure, config: { displaylogo: false, responsive: true } });
});
const openTarget = () => {
  const target = document.getElementById(decodeURIComponent(location.hash.slice(1)));
  if (target instanceof HTMLDetailsElement) { target.open = true; target.scrollIntoView(); }
};
for (const part of document.querySelectorAll("details")) {
  part.addEventListener("toggle", () => draw(part));
}
window.addEventListener("hashchange", openTarget);
openTarget();
draw(document);
