"use strict";
// Each 3-D view is made when it comes near the window: its item is drawn by plotly.js from the JSON beside it.
const EYES = { side: [-0.95, -1.45, 0.95], above: [-0.3, -0.6, 2.0], below: [-0.6, -1.0, -1.6] };

function layout(half, eye) {
  const side = () => ({ visible: false, ...(half ? { range: [-half, half] } : {}) });
  return {
    margin: { l: 0, r: 0, t: 0, b: 0 }, uirevision: "kept", showlegend: !half, paper_bgcolor: "#ffffff",
    legend: { itemsizing: "constant", font: { size: 12 } },
    scene: {
      xaxis: side(), yaxis: side(), zaxis: side(), aspectmode: half ? "cube" : "data",
      camera: { eye: { x: eye[0], y: eye[1], z: eye[2] } },
    },
  };
}

function start(view) {
  const content = JSON.parse(view.querySelector("script").textContent);
  const plot = view.querySelector(".plot");
  const list = view.querySelector("select");
  const settings = { displaylogo: false, responsive: true, scrollZoom: false, modeBarButtonsToRemove: ["toImage"] };
  const draw = () => Plotly.react(plot, content.items[list.selectedIndex].traces, layout(content.half, EYES.side), settings);
  const step = (by) => { list.selectedIndex = (list.selectedIndex + by + list.length) % list.length; draw(); };
  list.addEventListener("change", draw);
  for (const button of view.querySelectorAll("button")) {
    const { step: by, eye } = button.dataset;
    button.addEventListener("click", () => by ? step(Number(by)) : Plotly.relayout(plot, { "scene.camera.eye": { x: EYES[eye][0], y: EYES[eye][1], z: EYES[eye][2] } }));
  }
  draw();
}

const near = new IntersectionObserver((entries) => {
  for (const entry of entries.filter((e) => e.isIntersecting)) { near.unobserve(entry.target); start(entry.target); }
}, { rootMargin: "400px" });
for (const view of document.querySelectorAll(".view")) near.observe(view);
