// The open hands of all grasps as thin rods, in the colour of their probability: whole hands would hide each other.
const ROD = 0.0011; // m, radius

function outlinesOf(content, grasps, hands) {
  const ends = grasps.map((grasp) => hands[grasp.type].outline.map((line) => line.map((p) => new THREE.Vector3(...p).applyMatrix4(grasp.matrix))));
  const first = [0];
  for (const lines of ends) first.push(first.at(-1) + lines.length);
  const look = new THREE.MeshBasicMaterial({ transparent: true });
  const rods = new THREE.InstancedMesh(new THREE.CylinderGeometry(ROD, ROD, 1, 8), look, Math.max(1, first.at(-1)));
  rods.frustumCulled = false;
  const none = new THREE.Matrix4().makeScale(0, 0, 0), up = new THREE.Vector3(0, 1, 0);
  const place = ends.map((lines) => lines.map(([a, b]) => {
    const way = b.clone().sub(a), length = way.length();
    const turn = new THREE.Quaternion().setFromUnitVectors(up, way.normalize());
    return new THREE.Matrix4().compose(a.clone().add(b).multiplyScalar(0.5), turn, new THREE.Vector3(1, length, 1));
  }));

  // `marked` (or -1) is drawn in `accent`; of all others those that `shown` has.
  function show(shown, marked, accent) {
    grasps.forEach((grasp, i) => place[i].forEach((matrix, s) => {
      rods.setMatrixAt(first[i] + s, shown.has(i) || i === marked ? matrix : none);
      rods.setColorAt(first[i] + s, i === marked ? accent : grasp.colour);
    }));
    if (!grasps.length) return;
    rods.instanceMatrix.needsUpdate = rods.instanceColor.needsUpdate = true;
  }
  if (!grasps.length) rods.visible = false;
  return { rods, ends, look, show };
}

// The place (0 to 1) on a line from a to b on the screen that is nearest to p, and how many pixels p is off.
function offLine(p, a, b) {
  const x = b.x - a.x, y = b.y - a.y, share = Math.min(1, Math.max(0, ((p.x - a.x) * x + (p.y - a.y) * y) / (x * x + y * y || 1)));
  return Math.hypot(p.x - a.x - share * x, p.y - a.y - share * y);
}
