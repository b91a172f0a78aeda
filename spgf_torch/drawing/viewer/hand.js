// A whole hand: a solid for each of its shapes, which move as the page was told in steps, and straight between them.
const STANDING = "#8796a5", MOVING = "#3f6ea6"; // shapes that stay where they are while it closes, and those that do not
const TOUCH = 0.001, TOUCHING = 3; // m that points of the target lie inside a finger which touches it, and how many
const NEAR = 0.2; // m about the TCP within which points are looked at

function decodedHand(packed) {
  const vertices = unpacked(packed.vertices), triangles = unpacked(packed.triangles), moves = unpacked(packed.moves);
  const shapes = packed.corners.slice(0, -1).map((from, s) => ({
    vertices: vertices.slice(3 * from, 3 * packed.corners[s + 1]),
    triangles: triangles.slice(3 * packed.faces[s], 3 * packed.faces[s + 1]),
    moves: Array.from({ length: packed.steps }, (_, f) => matrix(moves, 12 * (f * (packed.corners.length - 1) + s))),
  }));
  shapes.forEach((shape) => { shape.moving = !shape.moves.at(-1).equals(shape.moves[0]); });
  return { shapes, outline: packed.outline, steps: packed.steps, closes: shapes.some((shape) => shape.moving) };
}

// Where a shape is when so much of the way to closed, 0 to 1, is done.
function movedBy(shape, share) {
  const at = share * (shape.moves.length - 1), before = Math.floor(at), after = Math.ceil(at), part = at - before;
  const from = shape.moves[before].elements, to = shape.moves[after].elements;
  return new THREE.Matrix4().fromArray(from.map((value, i) => value + part * (to[i] - value)));
}

function handGroup(hand) {
  const group = new THREE.Group();
  const looks = [STANDING, MOVING].map((color) => new THREE.MeshStandardMaterial({ color, roughness: 0.55, metalness: 0.15, flatShading: true, side: THREE.DoubleSide }));
  const edge = new THREE.LineBasicMaterial({ color: "#16202b", transparent: true, opacity: 0.45 });
  for (const shape of hand.shapes) {
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(shape.vertices, 3));
    geometry.setIndex(new THREE.BufferAttribute(Uint32Array.from(shape.triangles), 1));
    const solid = new THREE.Mesh(geometry, looks[Number(shape.moving)]);
    solid.add(new THREE.LineSegments(new THREE.EdgesGeometry(geometry, 25), edge));
    solid.matrixAutoUpdate = false;
    group.add(solid);
  }
  group.matrixAutoUpdate = false;
  group.userData = { hand, looks };
  return group;
}

// The hand of a grasp, `back` m before it, closed to a share.
function placeHand(group, grasp, back, share) {
  group.matrix.copy(grasp.matrix).multiply(new THREE.Matrix4().makeTranslation(0, 0, -back));
  group.children.forEach((solid, s) => solid.matrix.copy(movedBy(group.userData.hand.shapes[s], share)));
  group.updateMatrixWorld(true);
}

// Planes of a convex shape's faces, outwards: a x + b y + c z + d > 0 is outside.
function facePlanes({ vertices, triangles }) {
  const corner = (i) => new THREE.Vector3().fromArray(vertices, 3 * i), planes = [], middle = new THREE.Vector3();
  for (let i = 0; i < vertices.length / 3; i++) middle.addScaledVector(corner(i), 3 / vertices.length);
  for (let t = 0; t < triangles.length; t += 3) {
    const plane = new THREE.Plane().setFromCoplanarPoints(...[0, 1, 2].map((k) => corner(triangles[t + k])));
    if (Number.isFinite(plane.constant)) planes.push(plane.distanceToPoint(middle) > 0 ? plane.negate() : plane);
  }
  return planes;
}

// How far a hand closes, 0 to 1, until a finger of it touches the points of the target (an array x y z x y z ...).
function firstTouch(hand, grasp, points) {
  const toHand = grasp.matrix.clone().invert(), near = [], at = new THREE.Vector3();
  for (let i = 0; i < points.length; i += 3) {
    at.fromArray(points, i).applyMatrix4(toHand);
    if (at.length() < NEAR) near.push(at.clone());
  }
  const fingers = hand.shapes.filter((shape) => shape.moving).map((shape) => ({ shape, planes: facePlanes(shape) }));
  const inside = (share) => fingers.some(({ shape, planes }) => {
    const back = movedBy(shape, share).invert();
    let count = 0;
    return near.some((point) => {
      at.copy(point).applyMatrix4(back);
      return planes.every((plane) => plane.distanceToPoint(at) < -TOUCH) && ++count >= TOUCHING;
    });
  });
  if (!near.length || inside(0)) return 1; // nothing to touch, or it does already: the way is shown whole
  const steps = 4 * (hand.steps - 1);
  for (let step = 1; step <= steps; step++) if (inside(step / steps)) return (step - 1) / steps;
  return 1;
}
