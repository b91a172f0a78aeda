"use strict";
// The cloud with all outlines; choosing a grasp (in the list, in the table, by a click) shows its whole hand, which a
// slider closes.
addEventListener("DOMContentLoaded", () => {
  const box = document.querySelector(".scene");
  const { cloud, outlines, shapes, hands, approaches, numbers, bar, eyes, up } = JSON.parse(box.querySelector("script").textContent);
  const plot = box.querySelector(".plot"), list = box.querySelector("select");
  const slider = box.querySelector("input");
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

  // Row-by-row 3 x 4 numbers of a pose, applied to a point.
  const moved = (T, [x, y, z]) => [0, 4, 8].map((r) => T[r] * x + T[r + 1] * y + T[r + 2] * z + T[r + 3]);

  // The hand of a grasp, closed to a share from 0 to 1: its shapes move as told in steps, and straight between them.
  function hand({ type, pose, colour }, share) {
    const { x, y, z, i, j, k, starts, moves } = shapes[type];
    const at = share * (moves.length - 1), before = Math.floor(at), after = Math.ceil(at), part = at - before;
    const corners = { x: [], y: [], z: [] };
    for (let shape = 0; shape + 1 < starts.length; shape++) {
      for (let v = starts[shape]; v < starts[shape + 1]; v++) {
        const [from, to] = [before, after].map((step) => moved(moves[step][shape], [x[v], y[v], z[v]]));
        const placed = moved(pose, from.map((value, axis) => value + part * (to[axis] - value)));
        ["x", "y", "z"].forEach((axis, a) => corners[axis].push(placed[a]));
      }
    }
    const look = { color: colour, opacity: 0.35, flatshading: true, hoverinfo: "skip" };
    return { type: "mesh3d", ...corners, i, j, k, ...look };
  }

  function traces() {
    const chosen = list.selectedIndex - 1; // -1: all of them
    // The chosen hand is solid: its own outline would stay open while it closes.
    const faded = (trace, i) => ({ ...trace, visible: i !== chosen, opacity: chosen < 0 ? 1 : 0.1 });
    const ranks = { ...numbers, visible: chosen < 0 };
    const extra = chosen < 0 ? [] : [hand(hands[chosen], Number(slider.value)), approaches[chosen]];
    return [cloud, ...outlines.map(faded), ranks, bar, ...extra];
  }
  function draw() {
    rows.forEach((row, i) => row.classList.toggle("shown", i === list.selectedIndex - 1));
    return Plotly.react(plot, traces(), { ...layout, scene: { ...layout.scene, uirevision: "kept" } },
      { displayModeBar: false, responsive: true, scrollZoom: false });
  }
  function choose(index) {
    list.selectedIndex = index;
    slider.value = 0;
    slider.parentElement.hidden = index < 1 || shapes[hands[index - 1].type].moves.length < 2;
    return draw();
  }

  list.addEventListener("change", () => choose(list.selectedIndex));
  slider.addEventListener("input", () => {
    const { x, y, z } = hand(hands[list.selectedIndex - 1], Number(slider.value));
    Plotly.restyle(plot, { x: [x], y: [y], z: [z] }, [plot.data.length - 2]);
  });
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
  choose(hands.length ? 1 : 0).then(() => plot.on("plotly_click", ({ points: [{ curveNumber: k }] }) => {
    if (k >= first && k < first + outlines.length) setTimeout(() => choose(k - first + 1));
  }));
});
