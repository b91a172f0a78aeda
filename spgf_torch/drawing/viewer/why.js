// Why a grasp is where it is in the list: what a judge weighed, and which shapes voted.
function element(name, attributes = {}, ...children) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  made.append(...children);
  return made;
}

const percent = (value) => `${Math.round(100 * value)} %`;
const signed = (value) => `${value < 0 ? "−" : "+"}${Math.abs(value).toFixed(Math.abs(value) < 10 ? 2 : 0)}`;

function meter(words, value) {
  const bar = element("span", { class: "meter", "aria-hidden": "true" }, element("i", { style: `width:${100 * value}%` }));
  return element("div", { class: "chance" }, element("span", {}, words), bar, element("b", {}, percent(value)));
}

function judgedPart(grasp) {
  if (!grasp.judged) return [];
  const [free, holds] = grasp.judged, strongest = Math.max(1e-9, ...grasp.weighed.map(({ moved }) => Math.abs(moved)));
  const rows = grasp.weighed.map(({ words, value, usual, moved }) => element(
    "tr", {}, element("th", { scope: "row" }, words), element("td", {}, value), element("td", { class: "soft" }, usual),
    element("td", { class: moved < 0 ? "against bar" : "for bar" }, element("i", { style: `width:${(50 * Math.abs(moved)) / strongest}%` }), element("span", {}, signed(moved))),
  ));
  const head = element("tr", {}, ...["what it weighed most", "here", "usual", "moved the log-odds"].map((words) => element("th", { scope: "col" }, words)));
  return [
    element("h3", {}, "What the judge weighed"), meter("reaches it freely", free), meter("then holds", holds),
    ...(rows.length ? [element("div", { class: "wide" }, element("table", { class: "weighed" }, element("thead", {}, head), element("tbody", {}, ...rows)))] : []),
  ];
}

// `onProtoype(k, kept)`: a prototype is pointed at, or clicked; k null: none is any more.
function votedPart(grasp, said, prototypes, onPrototype) {
  const total = grasp.voted.reduce((sum, [, count]) => sum + count, 0);
  if (!total && !said.length) return [];
  const known = said.length ? said : grasp.voted.map(([prototype, count]) => ({ prototype, count, gain: null }));
  const strongest = Math.max(1e-9, ...known.map(({ gain, count }) => Math.abs(gain ?? count)));
  const rows = known.map(({ prototype, count, gain }) => {
    const { name, colour, picture } = prototypes[prototype];
    const button = element("button", { type: "button", class: "prototype", "aria-pressed": "false", "data-prototype": prototype, title: "show its texlets alone" });
    button.append(element("i", { class: "swatch", style: `background:${colour}` }));
    if (picture) button.append(element("img", { alt: "", width: 44, height: 44, src: `data:image/svg+xml,${encodeURIComponent(picture)}` }));
    button.append(element("span", {}, name));
    const row = element("tr", {}, element("td", {}, button), element("td", {}, String(count)));
    if (gain !== null) row.append(element("td", { class: gain < 0 ? "against bar" : "for bar" }, element("i", { style: `width:${(50 * Math.abs(gain)) / strongest}%` }), element("span", {}, signed(gain))));
    row.addEventListener("pointerenter", (event) => { if (event.pointerType === "mouse") onPrototype(prototype, false); });
    row.addEventListener("pointerleave", (event) => { if (event.pointerType === "mouse") onPrototype(null, false); });
    button.addEventListener("click", () => onPrototype(prototype, true));
    return row;
  });
  const head = element("tr", {}, ...["shape", "votes", ...(said.length ? ["sum of gain"] : [])].map((words) => element("th", { scope: "col" }, words)));
  const { count, left } = grasp.votes, words = said.length
    ? `Each disc is a texlet that voted: its colour is its prototype, its area how much the vote moved the log-odds, filled for the grasp and a ring against it.${left ? ` The ${count} strongest of ${count + left} votes are on this page.` : ""}`
    : total ? `${total} votes by shape${left ? "; which texlets cast them is on this page for better grasps alone" : ""}.` : "";
  return [element("h3", {}, "Shapes that voted"), element("p", { class: "soft" }, words), element("div", { class: "wide" }, element("table", { class: "voted" }, element("thead", {}, head), element("tbody", {}, ...rows)))];
}
