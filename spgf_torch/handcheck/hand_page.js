"use strict";
// Each preshape is drawn by plotly.js from the JSON that stands in it; a slider moves the links from open to closed.
function tracesOf(content, step) {
  const poses = content.poses[step];
  const parts = content.parts.map((part) => ({
    type: "mesh3d", ...placed(part.points, poses[part.link]), i: part.i, j: part.j, k: part.k,
    color: part.colour, opacity: content.opacity, flatshading: true, hoverinfo: "text", text: part.link,
    lighting: { ambient: 0.75, diffuse: 0.6, specular: 0.05 },
  }));
  const line = (points, colour, text, width) => ({
    type: "scatter3d", mode: "lines", x: points.map((p) => p[0]), y: points.map((p) => p[1]), z: points.map((p) => p[2]),
    line: { color: colour, width }, hoverinfo: "text", text,
  });
  const joints = content.joints[step].map(({ points, text }) => line(points, "#222222", text, 4));
  const tcp = content.tcp.map(({ points, colour, text }) => line(points, colour, text, 7));
  const pads = {
    type: "scatter3d", mode: "markers", marker: { size: 4, color: "#000000" }, hoverinfo: "text",
    text: content.pads[step].map((pad) => pad.text),
  };
  for (const [index, name] of ["x", "y", "z"].entries()) pads[name] = content.pads[step].map((pad) => pad.at[index]);
  return [...parts, ...joints, ...tcp, pads];
}

function startHand(view) {
  const content = JSON.parse(view.querySelector("script").textContent);
  const plot = view.querySelector(".plot");
  const slider = view.querySelector("input[type=range]");
  const glass = view.querySelector("input[type=checkbox]");
  const side = { visible: false, range: null };
  const layout = {
    margin: { l: 0, r: 0, t: 0, b: 0 }, uirevision: "kept", showlegend: false, paper_bgcolor: "#ffffff",
    scene: {
      xaxis: { ...side, range: content.ranges[0] }, yaxis: { ...side, range: content.ranges[1] },
      zaxis: { ...side, range: content.ranges[2] }, aspectmode: "cube", camera: { eye: content.eye, up: content.up },
    },
  };
  const draw = () => {
    content.opacity = glass.checked ? 0.35 : 1;
    Plotly.react(plot, tracesOf(content, Number(slider.value)), layout, { displayModeBar: false, responsive: true });
  };
  slider.addEventListener("input", draw);
  glass.addEventListener("change", draw);
  draw();
}

// plotly.js stands behind this script.
addEventListener("DOMContentLoaded", () => { for (const view of document.querySelectorAll(".hand")) startHand(view); });
