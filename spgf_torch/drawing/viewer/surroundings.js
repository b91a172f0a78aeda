// What stands around: the table, the cameras, the axes of the input's frame.
const SPAN = 0.012, LONG = 0.05; // m: half a side of a camera whose image is not known, and the length of an axis
const AXES = [["x", [1, 0, 0], "#d0342c"], ["y", [0, 1, 0], "#2c8a3d"], ["z", [0, 0, 1], "#2f62d9"]];

function tableOf(corners) {
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(Float32Array.from(corners.flat()), 3));
  geometry.setIndex([0, 1, 2, 0, 2, 3]);
  const look = { side: THREE.DoubleSide, polygonOffset: true, polygonOffsetFactor: 2, polygonOffsetUnits: 8 };
  const group = new THREE.Group(), surface = new THREE.Mesh(geometry, new THREE.MeshBasicMaterial(look));
  const [a, b, , d] = corners.map((corner) => new THREE.Vector3(...corner)), lines = [];
  for (const [from, along, across] of [[a, b.clone().sub(a), d.clone().sub(a)], [a, d.clone().sub(a), b.clone().sub(a)]]) {
    const cells = Math.max(1, Math.round(along.length() / 0.05)); // a line every 50 mm, or nearly
    for (let i = 0; i <= cells; i++) {
      const start = from.clone().addScaledVector(along, i / cells);
      lines.push(start, start.clone().add(across));
    }
  }
  const grid = new THREE.LineSegments(new THREE.BufferGeometry().setFromPoints(lines), new THREE.LineBasicMaterial());
  group.add(surface, grid);
  return { group, surface, grid };
}

function camerasOf(cameras, up) {
  const lines = [];
  for (const { eye, corners } of cameras) {
    const at = new THREE.Vector3(...eye), ends = corners ? corners.map((corner) => new THREE.Vector3(...corner)) : facingOrigin(at, up);
    ends.forEach((end, i) => lines.push(at, end, end, ends[(i + 1) % 4]));
  }
  return new THREE.LineSegments(new THREE.BufferGeometry().setFromPoints(lines), new THREE.LineBasicMaterial());
}

// The corners of a small pyramid from a camera towards the targets.
function facingOrigin(at, up) {
  const ahead = at.clone().negate().normalize(), right = ahead.clone().cross(up);
  if (right.length() < 1e-3) right.set(1, 0, 0).cross(ahead);
  const down = ahead.clone().cross(right.normalize());
  return [[-1, -1], [1, -1], [1, 1], [-1, 1]].map(([x, y]) => at.clone().addScaledVector(ahead, 3 * SPAN).addScaledVector(right, x * SPAN).addScaledVector(down, y * SPAN));
}

// The axes of the input's frame where its origin is.
function axesOf(origin) {
  const group = new THREE.Group(), at = new THREE.Vector3(...origin).negate();
  for (const [, way, color] of AXES) {
    const ends = [at, at.clone().addScaledVector(new THREE.Vector3(...way), LONG)];
    group.add(new THREE.Line(new THREE.BufferGeometry().setFromPoints(ends), new THREE.LineBasicMaterial({ color })));
  }
  return group;
}

// The input's axes as they lie for a camera, drawn into an svg of 72 x 72.
function drawGizmo(svg, camera) {
  const turn = camera.quaternion.clone().invert(), ways = AXES.map(([name, way, colour]) => ({ name, colour, at: new THREE.Vector3(...way).applyQuaternion(turn) }));
  svg.replaceChildren(...ways.sort((a, b) => a.at.z - b.at.z).flatMap(({ name, colour, at }) => {
    const line = document.createElementNS(svg.namespaceURI, "line"), letter = document.createElementNS(svg.namespaceURI, "text");
    const put = (element, values) => { for (const key in values) element.setAttribute(key, values[key]); };
    put(line, { x1: 36, y1: 36, x2: 36 + 23 * at.x, y2: 36 - 23 * at.y, stroke: colour, "stroke-width": 2.5, "stroke-linecap": "round" });
    put(letter, { x: 36 + 31 * at.x, y: 36 - 31 * at.y, fill: colour, "text-anchor": "middle", "dominant-baseline": "central" });
    letter.textContent = name;
    return [line, letter];
  }));
}
