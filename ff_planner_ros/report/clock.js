// One time for all plots of a plan: of its slider, of the scene, and a line in every other plot.
const WHOLE_PLAN = 8000; // how long a plan is played, whatever it takes [ms]

// Where a plot's panels are on the screen, plotly keeps to itself; without it there is no line.
const moveCursor = (place, time) => {
  const full = place._fullLayout;
  if (!full || !place.meta) return;
  for (let k = 0; k < place.meta.panels; k++) {
    const x = full[nameOf("xaxis", k)], y = full[nameOf("yaxis", k)];
    const line = place.cursors[k], at = x.l2p ? x.l2p(time) : NaN;
    line.hidden = !(at >= 0 && at <= x._length);
    line.style.left = `${x._offset + at}px`;
    line.style.top = `${y._offset}px`;
    line.style.height = `${y._length}px`;
  }
};

const clockOf = (clock) => {
  const plan = clock.closest("details"), slider = clock.querySelector("input");
  const button = clock.querySelector("button"), words = clock.querySelector("output");
  const end = Number(slider.max);
  let time = 0, frames = [], scene = null, shown = -1, busy = false, playing = 0;

  // The scene takes its time: it shows the newest frame, once it has shown the one before.
  const showFrame = async () => {
    const step = end / Math.max(frames.length - 1, 1), frame = Math.round(time / step);
    if (busy || !scene || frame === shown || !frames[frame]) return;
    busy = true;
    shown = frame;
    const now = { mode: "immediate", transition: { duration: 0 }, frame: { duration: 0 } };
    await Plotly.animate(scene, [frames[frame]], now).catch(() => {});
    busy = false;
    showFrame();
  };
  const moveTo = (to) => {
    time = Math.min(Math.max(to, 0), end);
    slider.value = time;
    words.textContent = `${time.toFixed(2)} s`;
    for (const place of plan.querySelectorAll(".plot[data-drawn]")) moveCursor(place, time);
    showFrame();
  };
  const stop = () => {
    cancelAnimationFrame(playing);
    playing = 0;
    button.textContent = "▶";
  };
  const play = () => {
    const from = time < end ? time : 0, begun = performance.now();
    const step = () => {
      moveTo(from + ((performance.now() - begun) / WHOLE_PLAN) * end);
      if (time < end) playing = requestAnimationFrame(step);
      else stop();
    };
    button.textContent = "❚❚";
    playing = requestAnimationFrame(step);
  };

  button.addEventListener("click", () => (playing ? stop() : play()));
  slider.addEventListener("input", () => { stop(); moveTo(Number(slider.value)); });
  plan.addEventListener("click", ({ target }) => {
    if (target.dataset.time) { stop(); moveTo(Number(target.dataset.time)); }
  });
  plan.addEventListener("drawn", ({ target: place, detail: figure }) => {
    if (!place.meta) {
      [scene, frames] = [place, figure.frames.map(({ name }) => name)];
    } else {
      place.cursors = [...Array(place.meta.panels)].map(() => {
        const line = place.appendChild(document.createElement("div"));
        line.className = "cursor";
        return line;
      });
      place.on("plotly_afterplot", () => moveCursor(place, time));
      place.on("plotly_hover", ({ points }) => { if (!playing) moveTo(points[0].x); });
    }
    moveTo(time);
  });
};
document.querySelectorAll(".clock").forEach(clockOf);
drawAll(document);
