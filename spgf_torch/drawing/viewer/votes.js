// The texlets that voted for a grasp, as discs: the colour is the prototype, the area is how much a vote moved the
// grasp's log-odds, filled for it, a ring against it.
const LARGEST = 0.0027, SMALLEST = 0.0007; // m, radius of a disc
const ABOVE = 0.0012; // m between the surface and a disc

function decodedVotes(packed) {
  if (!packed.gain) return null;
  return {
    points: unpackedPoints(packed.points), normals: Float32Array.from(unpacked(packed.normals), (n) => n / 127), prototype: unpacked(packed.prototype),
    gain: unpacked(packed.gain), probability: Float32Array.from(unpacked(packed.probability), (p) => p / 255), support: unpacked(packed.support),
  };
}

// What each prototype said of a grasp: { prototype, count, gain }, who said most first.
function sayings(votes, { first, count }) {
  const said = new Map();
  for (let i = first; i < first + count; i++) {
    const k = votes.prototype[i], of = said.get(k) ?? { prototype: k, count: 0, gain: 0 };
    of.count += 1;
    of.gain += votes.gain[i];
    said.set(k, of);
  }
  return [...said.values()].sort((a, b) => Math.abs(b.gain) - Math.abs(a.gain));
}

function discsOf(votes, prototypes, most) {
  const flat = (geometry, color) => {
    const discs = new THREE.InstancedMesh(geometry, new THREE.MeshBasicMaterial({ side: THREE.DoubleSide, ...(color ? { color } : {}) }), Math.max(1, most));
    discs.count = 0;
    discs.frustumCulled = false;
    return discs;
  };
  const under = flat(new THREE.CircleGeometry(1, 24), "#10161d"), filled = flat(new THREE.CircleGeometry(0.86, 24)), rings = flat(new THREE.RingGeometry(0.5, 0.86, 24));
  const white = flat(new THREE.CircleGeometry(0.5, 24), "#ffffff"), group = new THREE.Group();
  group.add(under, filled, rings, white);
  let shown = []; // { vote, at, radius }

  // The votes of a grasp; of `only` one prototype, if it is not null.
  function show({ first, count }, only) {
    let strongest = 1e-9;
    for (let i = first; i < first + count; i++) strongest = Math.max(strongest, Math.abs(votes.gain[i]));
    const numbers = new Map([under, filled, rings, white].map((mesh) => [mesh, 0])), toFront = new THREE.Vector3(0, 0, 1);
    const put = (mesh, at, turn, radius, colour) => {
      const n = numbers.get(mesh);
      mesh.setMatrixAt(n, new THREE.Matrix4().compose(at, turn, new THREE.Vector3(radius, radius, radius)));
      if (colour) mesh.setColorAt(n, colour);
      numbers.set(mesh, n + 1);
    };
    shown = [];
    for (let vote = first; vote < first + count; vote++) {
      if (only !== null && votes.prototype[vote] !== only) continue;
      const normal = new THREE.Vector3().fromArray(votes.normals, 3 * vote).normalize(), turn = new THREE.Quaternion().setFromUnitVectors(toFront, normal);
      const radius = Math.max(SMALLEST, LARGEST * Math.sqrt(Math.abs(votes.gain[vote]) / strongest));
      const at = (above) => new THREE.Vector3().fromArray(votes.points, 3 * vote).addScaledVector(normal, above);
      const colour = new THREE.Color(prototypes[votes.prototype[vote]].colour), against = votes.gain[vote] < 0;
      put(under, at(ABOVE), turn, radius);
      put(against ? rings : filled, at(ABOVE + 0.0004), turn, radius, colour);
      if (against) put(white, at(ABOVE + 0.0004), turn, radius);
      shown.push({ vote, at: at(ABOVE), radius });
    }
    for (const [mesh, n] of numbers) {
      mesh.count = n;
      mesh.instanceMatrix.needsUpdate = true;
      if (mesh.instanceColor) mesh.instanceColor.needsUpdate = true;
    }
  }
  return { group, show, shown: () => shown };
}
