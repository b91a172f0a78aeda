"use strict";
// The cloud with all outlines; choosing a grasp (in the list, in the table, by a click) shows its whole hand.
addEventListener("DOMContentLoaded", () => {
  const box = document.querySelector(".scene");
  const { cloud, outlines, hands, approaches, numbers, bar, eyes, up } = JSON.parse(box.querySelector("script").textContent);
  const plot = box.querySelector(".plot"), list = box.querySelector("select");
  const rows = [...document.querySelectorAll("#ranked tbody tr")];
  const xyz = ([x, y, z], factor = 1) => ({ x: x * factor, y: y * factor, z: z * factor });
  const hidden = { visible: false };
  const layout = {
    margin: { l: 0, r: 0, t: 0, b: 0 }, showlegend: false, paper_bgcolor: "#ffffff",
    scene: {
      xaxis: hidden, yaxis: hidden, zaxis: hidden, aspectmode: "data",
      camera: { eye: xyz(eyes.front), up: xyz(up) },
    },
  };
  const first = 1; // trace of the best grasp's outline; the cloud is trace 0

  function traces() {
    const chosen = list.selectedIndex - 1; // -1: all of them
    const faded = (trace, i) => ({ ...trace, opacity: chosen < 0 || i === chosen ? 1 : 0.18 });
    const extra = chosen < 0 ? [] : [hands[chosen], approaches[chosen]];
    return [cloud, ...outlines.map(faded), numbers, bar, ...extra];
  }
  function draw() {
    rows.forEach((row, i) => row.classList.toggle("shown", i === list.selectedIndex - 1));
    return Plotly.react(plot, traces(), { ...layout, scene: { ...layout.scene, uirevision: "kept" } },
      { displayModeBar: false, responsive: true, scrollZoom: false });
  }
  const choose = (index) => { list.selectedIndex = index; draw(); };

  list.addEventListener("change", draw);
  rows.forEach((row, i) => row.addEventListener("click", () => choose(i + 1)));
  for (const button of box.querySelectorAll("button")) {
    const { step, eye, zoom } = button.dataset;
    button.addEventListener("click", () => {
      if (step) return choose((list.selectedIndex + Number(step) + list.length) % list.length);
      if (eye) return Plotly.relayout(plot, { "scene.camera.eye": xyz(eyes[eye]), "scene.camera.up": xyz(up) });
      const { x, y, z } = plot.layout.scene.camera.eye;
      return Plotly.relayout(plot, { "scene.camera.eye": xyz([x, y, z], Number(zoom)) });
    });
  }
  draw().then(() => plot.on("plotly_click", ({ points: [{ curveNumber: k }] }) => {
    if (k >= first && k < first + outlines.length) setTimeout(() => choose(k - first + 1));
  }));
});
