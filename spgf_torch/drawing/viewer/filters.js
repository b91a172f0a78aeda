// The table of grasps: which rows are shown, which is chosen.
function makeTable(grasps, form, rows, count, onShown) {
  const least = form.elements.least, most = form.elements.most, target = form.elements.target;
  const types = [...form.querySelectorAll('input[name="type"]')];
  let shown = [];

  function filter() {
    if (Number(least.value) > Number(most.value)) most.value = least.value;
    const kinds = new Set(types.filter((box) => box.checked).map((box) => box.value));
    const low = Number(least.value) / 100, high = Number(most.value) / 100, rounding = 0.005; // sliders have whole percents
    shown = grasps.flatMap((grasp, i) => {
      const kept = (!types.length || kinds.has(grasp.type)) && grasp.probability >= low - rounding && grasp.probability <= high + rounding && (!target?.value || Number(target.value) === grasp.target);
      rows[i].hidden = !kept;
      return kept ? [i] : [];
    });
    form.querySelector('output[for="least most"]').textContent = `${least.value} to ${most.value} %`;
    count.textContent = `${shown.length} of ${grasps.length} shown`;
    onShown(shown);
  }
  form.addEventListener("input", filter);
  form.addEventListener("reset", () => setTimeout(filter)); // once the values are back
  form.addEventListener("submit", (event) => event.preventDefault());
  return {
    filter,
    shown: () => shown,
    mark(chosen) {
      rows.forEach((row, i) => {
        row.classList.toggle("chosen", i === chosen);
        row.querySelector("button").setAttribute("aria-pressed", String(i === chosen));
      });
      const box = rows[chosen]?.closest(".wide"), row = rows[chosen];
      if (!box || row.hidden) return;
      const head = box.querySelector("thead").offsetHeight, top = row.offsetTop - head, bottom = row.offsetTop + row.offsetHeight - box.clientHeight;
      if (box.scrollTop > top) box.scrollTop = top;
      if (box.scrollTop < bottom) box.scrollTop = bottom;
    },
  };
}
