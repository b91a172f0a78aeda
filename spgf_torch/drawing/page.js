"use strict";
// Each 3-D view is drawn by plotly.js from the JSON that stands in it.
const EYES = { side: [0.75, -1.15, 0.8], above: [0.2, -0.4, 1.55], below: [0.5, -0.8, -1.25] };

function point([x, y, z], factor = 1) { return { x: x * factor, y: y * factor, z: z * factor }; }

function layout(half, far) {
  const side = () => ({ visible: false, ...(half ? { range: [-half, half] } : {}) });
  return {
    margin: { l: 0, r: 0, t: 0, b: 0 }, uirevision: "kept", showlegend: !half, paper_bgcolor: "#ffffff",
    legend: { itemsizing: "constant", font: { size: 12 } },
    scene: {
      xaxis: side(), yaxis: side(), zaxis: side(), aspectmode: half ? "cube" : "data",
      camera: { eye: point(EYES.side, far) },
    },
  };
}

function start(view) {
  const content = JSON.parse(view.querySelector("script").textContent);
  const plot = view.querySelector(".plot");
  const list = view.querySelector("select");
  const far = content.half ? 1 : 1.55; // a whole object needs more room than a cube of known size
  const settings = { displayModeBar: false, responsive: true, scrollZoom: false };
  const look = (eye) => Plotly.relayout(plot, { "scene.camera.eye": eye });
  const draw = () => Plotly.react(plot, content.items[list.selectedIndex].traces, layout(content.half, far), settings);
  const step = (by) => { list.selectedIndex = (list.selectedIndex + by + list.length) % list.length; draw(); };
  list.addEventListener("change", draw);
  for (const button of view.querySelectorAll("button")) {
    const { step: by, eye, zoom } = button.dataset;
    button.addEventListener("click", () => {
      if (by) return step(Number(by));
      if (eye) return look(point(EYES[eye], far));
      const now = plot.layout.scene.camera.eye;
      return look(point([now.x, now.y, now.z], Number(zoom)));
    });
  }
  draw();
}

// One after another once the page stands: between two of them the browser may do something else.
const waiting = [...document.querySelectorAll(".view")];
function next() {
  const view = waiting.shift();
  if (view) { start(view); setTimeout(next); }
}
setTimeout(next);
