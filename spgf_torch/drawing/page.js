"use strict";
// Each 3-D view is drawn by plotly.js from the JSON that stands in it.
const EYES = { side: [0.75, -1.15, 0.8], above: [0.2, -0.4, 1.55], below: [0.5, -0.8, -1.25] };

const TURN = Math.PI / 12; // by a key
const WEBGL = Boolean(document.createElement("canvas").getContext("webgl"));

function point([x, y, z], factor = 1) { return { x: x * factor, y: y * factor, z: z * factor }; }

// Points moved by a pose: 3 x 4 numbers, row by row.
function placed(points, T) {
  const out = [[], [], []];
  for (const [x, y, z] of points) {
    for (let row = 0; row < 3; row++) out[row].push(T[4 * row] * x + T[4 * row + 1] * y + T[4 * row + 2] * z + T[4 * row + 3]);
  }
  return { x: out[0], y: out[1], z: out[2] };
}

// A trace may name a shape, which several share, and where it stands.
function whole({ shape, pose, ...look }, shapes) {
  if (shape === undefined) return look;
  const { points, ...faces } = shapes[shape];
  return { ...look, ...placed(points, pose), ...faces };
}

function layout({ half, centre }, far) {
  const side = (axis) => ({ visible: false, ...(half ? { range: [centre[axis] - half, centre[axis] + half] } : {}) });
  return {
    margin: { l: 0, r: 0, t: 0, b: 0 }, uirevision: "kept", showlegend: !half, paper_bgcolor: "rgba(0,0,0,0)",
    legend: { itemsizing: "constant", font: { size: 12 } },
    scene: {
      xaxis: side(0), yaxis: side(1), zaxis: side(2), aspectmode: half ? "cube" : "data",
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
  const draw = () => {
    const { traces, told } = content.items[list.selectedIndex];
    view.querySelector(".told").textContent = told;
    if (!WEBGL && view.querySelector(".still")) return undefined; // the picture stays in the plot's place
    view.classList.add("drawn");
    return Plotly.react(plot, traces.map((trace) => whole(trace, content.shapes)), layout(content, far), settings);
  };
  const step = (by) => { list.selectedIndex = (list.selectedIndex + by + list.length) % list.length; draw(); };
  const now = () => { const { x, y, z } = plot.layout.scene.camera.eye; return [x, y, z]; };
  const nearer = (factor) => look(point(now(), factor));
  const turn = (by) => {
    const [x, y, z] = now(), [c, s] = [Math.cos(by), Math.sin(by)];
    return look(point([c * x - s * y, s * x + c * y, z]));
  };
  list.addEventListener("change", draw);
  for (const button of view.querySelectorAll("button")) {
    const { step: by, eye, zoom } = button.dataset;
    button.addEventListener("click", () => {
      if (by) return step(Number(by));
      return eye ? look(point(EYES[eye], far)) : nearer(Number(zoom));
    });
  }
  const keys = {
    n: () => step(1), p: () => step(-1), "+": () => nearer(0.8), "-": () => nearer(1.25),
    ArrowLeft: () => turn(-TURN), ArrowRight: () => turn(TURN),
  };
  view.addEventListener("keydown", (event) => {
    const { key, target, ctrlKey, altKey, metaKey } = event;
    if (!keys[key] || target === list || ctrlKey || altKey || metaKey) return; // the list has keys of its own
    event.preventDefault();
    keys[key]();
  });
  draw();
}

// One after another once the page stands: between two of them the browser may do something else.
const waiting = [...document.querySelectorAll(".view")];
function next() {
  const view = waiting.shift();
  if (view) { start(view); setTimeout(next); }
}
setTimeout(next);
