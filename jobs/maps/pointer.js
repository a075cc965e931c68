// Says what the landing cell under the pointer is like.
"use strict";
const data = JSON.parse(document.getElementById("data").textContent);
const image = document.getElementById("map");
const said = document.getElementById("said");

function find(event) {
  const scale = data.width / image.getBoundingClientRect().width;
  const x = event.offsetX * scale, y = event.offsetY * scale;
  for (let k = 0; k < data.boxes.length; k += 1) {
    const box = data.boxes[k], [rows, columns] = data.planes[k].shape;
    const i = Math.floor((x - box.left) / box.cell_px);
    const j = rows - 1 - Math.floor((y - box.top) / box.cell_px);
    if (i >= 0 && i < columns && j >= 0 && j < rows) return [data.planes[k], j, i];
  }
  return null;
}

function number(value, factor, digits, unit) {
  return value === null ? "unknown" : `${(factor * value).toFixed(digits)} ${unit}`;
}

function words(plane, j, i) {
  const { values } = plane;
  const place = [i, j].map((n, k) => (plane.origin[k] + n * plane.resolution_m).toFixed(3));
  const where = `(${place.join(", ")}, ${plane.plane_z_m.toFixed(3)}) m: `;
  const state = values.state[j][i];
  if (state === 0) return `${where}not planned yet`;
  if (state !== 1) {
    return `${where}${state === 2 ? "refused, proven" : "refused, nothing found"}: ${plane.reasons[values.reason[j][i]]}`;
  }
  return `${where}release after ${number(values.release_time_s[j][i], 1000, 0, "ms")}; 10 ms early or late move the ` +
    `landing by ${number(values.landing_shift_10ms_m[j][i], 1000, 0, "mm")}; hit probability ` +
    `${number(values.hit_probability[j][i], 100, 0, "%")}; least margin ${number(values.margin[j][i], 100, 1, "%")} ` +
    `of its limit; plan ${plane.plans[j][i]}`;
}

image.addEventListener("pointermove", (event) => {
  const found = find(event);
  if (found !== null) said.textContent = words(...found);
});
