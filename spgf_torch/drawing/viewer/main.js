// The page: what is chosen, and what mouse, keys and controls do with it.
const ARRIVED = 0.4; // of the slider's way the hand comes, then it closes
const PLAYED = 2200; // ms that the slider's whole way takes when it is played

const find = (selector) => document.querySelector(selector);
const content = JSON.parse(find("#content").textContent);
const canvas = find("canvas"), slider = find("#motion"), told = find("#moved"), play = find("#play"), tip = find(".tip");
const rows = [...document.querySelectorAll("#grasps tbody tr")];
const stage = webgl() ? makeStage(content, canvas, find(".gizmo")) : null;
let chosen = -1, kept = null, playing = 0; // the grasp, the prototype that was clicked, the number of a running play

function webgl() { // asked without three.js, which would write an error on the console
  try { return Boolean(document.createElement("canvas").getContext("webgl2")); } catch { return false; }
}

const table = makeTable(content.grasps, find("#filters"), rows, find("#count"), (shown) => {
  stage?.set({ shown: new Set(shown) });
  document.body.dataset.shown = shown.length;
  if (!shown.includes(chosen)) choose(shown[0] ?? -1);
});

// The slider: from where the hand waits to the grasp, then closing until a finger touches, and on to the end.
function move() {
  const at = Number(slider.value) / 1000, grasp = content.grasps[chosen], hand = grasp && content.hands[grasp.type];
  if (!grasp) return;
  const back = Math.max(0, 1 - at / ARRIVED) * grasp.back, share = Math.max(0, (at - ARRIVED) / (1 - ARRIVED)), touch = stage?.touch(chosen) ?? 1;
  const met = touch < 1 && share > 0, touched = met && Math.abs(share - touch) < 0.004 ? ", a finger touches" : met && share > touch ? ", past the first touch" : "";
  const words = back > 0 ? `${Math.round(1000 * back)} mm before the grasp` : share === 0 ? "at the grasp, open" : `closed by ${Math.round(100 * share)} %${touched}`;
  told.textContent = words;
  slider.setAttribute("aria-valuetext", words);
  slider.style.setProperty("--touch", touch < 1 ? `${100 * (ARRIVED + touch * (1 - ARRIVED))}%` : "-10%");
  stage?.set({ back, share: hand.steps > 1 ? share : 0 });
}

function choose(i, { scroll = true } = {}) {
  chosen = i;
  kept = null;
  document.body.dataset.chosen = i + 1;
  if (scroll) table.mark(i);
  if (slider.value < 1000 * ARRIVED || playing) stop();
  slider.disabled = play.disabled = i < 0;
  slider.value = 1000 * ARRIVED;
  stage?.set({ chosen: i, back: 0, share: 0, only: null, marked: -1 });
  if (stage && i >= 0 && !stage.inSight()) stage.fit();
  tell(i);
  move();
}

// The panel about the chosen grasp.
function tell(i) {
  const grasp = content.grasps[i], panel = find("#why");
  if (!grasp) return panel.replaceChildren(element("p", { class: "soft" }, content.grasps.length ? "No grasp passes the filters." : "There is no grasp to explain."));
  const target = content.targets > 1 ? `, target ${grasp.target}` : "";
  const title = element("h2", {}, `Grasp ${i + 1}: ${grasp.type}${target}, ${percent(grasp.probability)}`);
  const said = stage?.votes && grasp.votes.count ? sayings(stage.votes, grasp.votes) : [];
  panel.replaceChildren(title, ...judgedPart(grasp), ...votedPart(grasp, said, content.prototypes, onPrototype));
}

function onPrototype(k, clicked) {
  if (clicked) kept = kept === k ? null : k;
  for (const button of document.querySelectorAll(".prototype")) button.setAttribute("aria-pressed", String(kept === Number(button.dataset.prototype)));
  document.body.dataset.only = kept ?? k ?? "";
  stage?.set({ only: clicked ? kept : (k ?? kept) });
}

function step(by) {
  const shown = table.shown(), at = shown.indexOf(chosen);
  if (shown.length) choose(shown[(at + by + shown.length) % shown.length]);
}

function stop() {
  playing = 0;
  play.textContent = "Play";
}

// From where it waits until a finger touches; from anywhere else on, if it is not there yet.
function run() {
  if (playing || chosen < 0) return stop();
  const end = 1000 * (ARRIVED + (1 - ARRIVED) * (stage?.touch(chosen) ?? 1)), number = (playing = Math.random());
  const from = Number(slider.value) >= end - 1 || Math.abs(slider.value - 1000 * ARRIVED) < 1 ? 0 : Number(slider.value), began = performance.now();
  play.textContent = "Stop";
  (function frame(now) {
    if (playing !== number) return;
    slider.value = Math.min(end, from + (1000 * Math.max(0, now - began)) / PLAYED);
    move();
    if (slider.value >= end - 1) {  // a frame may come just before the end
      slider.value = end;
      move();
      return stop();
    }
    requestAnimationFrame(frame);
  })(began);
}

rows.forEach((row, i) => {
  row.addEventListener("click", () => choose(i, { scroll: false }));
  row.addEventListener("click", () => table.mark(i));
  row.addEventListener("pointerenter", () => stage?.set({ marked: i }));
  row.addEventListener("pointerleave", () => stage?.set({ marked: -1 }));
});
slider.addEventListener("input", () => { stop(); move(); });
play.addEventListener("click", run);
for (const button of document.querySelectorAll("[data-eye]")) button.addEventListener("click", () => look(button.dataset.eye));
for (const button of document.querySelectorAll("[data-step]")) button.addEventListener("click", () => step(Number(button.dataset.step)));
for (const box of document.querySelectorAll("[data-part]")) box.addEventListener("input", () => stage?.turnOff(box.dataset.part, !box.checked));
find("#through").addEventListener("input", (event) => stage?.set({ through: event.target.checked }));
find("#colours").addEventListener("input", (event) => stage?.paint(event.target.value));

function look(eye) {
  if (eye === "camera") stage?.lookAsCamera();
  else if (eye === "grasp") stage?.lookAtGrasp();
  else stage?.lookFrom(eye);
}

const help = find("dialog");
find("#help").addEventListener("click", () => help.showModal());
const KEYS = {
  ArrowDown: () => step(1), ArrowRight: () => step(1), j: () => step(1), ArrowUp: () => step(-1), ArrowLeft: () => step(-1), k: () => step(-1),
  f: () => look("front"), g: () => look("grasp"), a: () => look("above"), " ": run, "+": () => stage?.zoom(0.8), "-": () => stage?.zoom(1.25), "?": () => help.showModal(), t: theme,
  h: () => find("#through").click(),
};
addEventListener("keydown", (event) => {
  const within = event.target.closest?.("input, select, textarea, dialog"), pressed = event.key === " " && event.target.closest?.("button, a, summary");
  if (within || pressed || event.ctrlKey || event.metaKey || event.altKey || !KEYS[event.key]) return;
  event.preventDefault();
  KEYS[event.key]();
});

// What the mouse is at, in words; a click chooses it.
function words(found) {
  if (found.grasp !== undefined) {
    const { type, probability } = content.grasps[found.grasp];
    return `grasp ${found.grasp + 1}: ${type}, ${percent(probability)}`;
  }
  const { prototype, gain, probability, support } = stage.votes, k = prototype[found.vote];
  return `${content.prototypes[k].name}: ${signed(gain[found.vote])} in log-odds; ${percent(probability[found.vote])} of ${support[found.vote].toFixed(1)} tries held`;
}
let pressedAt = null;
const placeOf = (event) => ({ x: event.offsetX, y: event.offsetY });
canvas.addEventListener("pointerdown", (event) => { pressedAt = placeOf(event); });
canvas.addEventListener("pointermove", (event) => {
  if (!stage || event.buttons || event.pointerType === "touch") return;
  const place = placeOf(event), found = stage.at(place);
  canvas.style.cursor = found ? "pointer" : "grab";
  tip.hidden = !found;
  stage.set({ marked: found?.grasp ?? -1 });
  canvas.dataset.at = found?.grasp === undefined ? "" : found.grasp + 1;
  if (!found) return;
  tip.textContent = words(found);
  tip.style.left = `${Math.min(place.x + 14, canvas.clientWidth - tip.offsetWidth - 6)}px`;
  tip.style.top = `${Math.max(4, place.y - 34)}px`;
});
canvas.addEventListener("pointerleave", () => { tip.hidden = true; stage?.set({ marked: -1 }); });
canvas.addEventListener("pointerup", (event) => {
  const place = placeOf(event);
  if (!stage || !pressedAt || Math.hypot(place.x - pressedAt.x, place.y - pressedAt.y) > 6) return; // it turned the view
  const found = stage.at(place, event.pointerType === "touch" ? 26 : undefined);
  if (found?.grasp !== undefined) choose(found.grasp);
  else if (found) onPrototype(stage.votes.prototype[found.vote], true);
});

// Light, dark or as the system has it; the choice is kept where the browser keeps anything for a file.
const THEMES = ["auto", "light", "dark"];
function remembered(value) {
  try {
    if (value !== undefined) localStorage.setItem("spgf-theme", value);
    return localStorage.getItem("spgf-theme");
  } catch { return null; }
}
function paintTheme() {
  const style = getComputedStyle(document.documentElement), word = (name) => style.getPropertyValue(`--${name}`).trim();
  find("#theme").textContent = `Theme: ${document.documentElement.dataset.theme}`;
  stage?.colour({ paper: word("stage"), ink: word("ink"), soft: word("soft"), accent: word("mark"), table: [word("table"), word("grid")] });
}
function theme(_, value = THEMES[(THEMES.indexOf(document.documentElement.dataset.theme) + 1) % 3]) {
  document.documentElement.dataset.theme = THEMES.includes(value) ? value : "auto";
  remembered(document.documentElement.dataset.theme);
  paintTheme();
}
find("#theme").addEventListener("click", () => theme());
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", paintTheme);

function drawScale() {
  const metres = stage.metresAcross(120), power = 10 ** Math.floor(Math.log10(metres)), length = [5, 2, 1].find((n) => n * power <= metres) * power;
  const bar = find(".scale");
  bar.style.width = `${(120 * length) / metres}px`;
  bar.textContent = length >= 1 ? `${length} m` : `${Math.round(1e6 * length) / 1000} mm`;
}

document.body.classList.toggle("flat", !stage);
addEventListener("beforeprint", () => { find(".about").open = true; });
find(".motion").hidden = !content.grasps.length;
find(".about").open = !matchMedia("(max-width: 860px)").matches; // on a phone the view is wanted first
theme(null, remembered() ?? "auto");
if (stage) {
  stage.onDraw(drawScale);
  const sensed = stage.clouds.some((cloud) => cloud.coloured);
  find("#colours").value = sensed ? "sensed" : "plain";
  find('#colours option[value="sensed"]').disabled = !sensed;
  stage.paint(find("#colours").value);
  for (const box of document.querySelectorAll("[data-part]")) stage.turnOff(box.dataset.part, !box.checked);
  stage.resize();
  new ResizeObserver(stage.resize).observe(canvas.parentElement);
}
table.filter();
look("grasp");
