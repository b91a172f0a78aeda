// The view: everything in three dimensions, and where it is looked at from. Drawn when something changes, not always.
const ANGLE = 28, ROOM = 1.12; // deg of the view's height; so much more than fits is shown
const AROUND = 0.075; // m around the TCP that are in sight where a grasp is looked at
const PALM = 0.5; // opacity of what stands still while the hand closes
const REACH = 14; // pixels around the mouse within which an outline is meant

function makeStage(content, canvas, gizmo) {
  const renderer = new THREE.WebGLRenderer({ canvas, antialias: true, preserveDrawingBuffer: true }); // kept for printing
  const scene = new THREE.Scene(), camera = new THREE.PerspectiveCamera(ANGLE, 1, 0.01, 10);
  const up = new THREE.Vector3(...content.up), lamp = new THREE.DirectionalLight("#ffffff", 1.9);
  camera.up.copy(up);
  const sky = new THREE.HemisphereLight("#ffffff", "#8d8677", 1.5);
  sky.position.copy(up);
  scene.add(sky, camera);
  lamp.position.set(-0.5, 0.9, 0.6); // over the left shoulder, wherever the eye goes
  camera.add(lamp, lamp.target);
  lamp.target.position.set(0, 0, -1);

  const hands = Object.fromEntries(Object.entries(content.hands).map(([type, packed]) => [type, decodedHand(packed)]));
  const grasps = content.grasps.map((grasp) => ({ ...grasp, matrix: matrix(grasp.pose), colour: onScale(content.scale, grasp.probability) }));
  const groups = Object.fromEntries(Object.entries(hands).map(([type, hand]) => [type, handGroup(hand)]));
  const clouds = content.clouds.map((cloud, i) => dotsOf(cloud, i, up)), outlines = outlinesOf(content, grasps, hands);
  const votes = decodedVotes(content.votes);
  const discs = discsOf(votes, content.prototypes, Math.max(0, ...grasps.map((grasp) => grasp.votes.count)));
  const table = content.table && tableOf(content.table), cameras = camerasOf(content.cameras, up), axes = axesOf(content.origin);
  const way = new THREE.LineSegments(new THREE.BufferGeometry(), new THREE.LineBasicMaterial());
  scene.add(...clouds.map(({ dots }) => dots), outlines.rods, discs.group, cameras, axes, way, ...Object.values(groups), ...(table ? [table.group] : []));
  const parts = { rest: [clouds[1]?.dots], table: [table?.group], cameras: [cameras], axes: [axes], others: [outlines.rods], votes: [discs.group], hand: [...Object.values(groups), way] };
  const off = new Set(), state = { chosen: -1, back: 0, share: 0, shown: new Set(), marked: -1, only: null, colours: "plain", through: false };
  const accent = new THREE.Color(), touches = new Map();
  const controls = new THREE.OrbitControls(camera, canvas);
  controls.enableDamping = false;
  controls.zoomToCursor = true;
  const listeners = [];
  let wanted = false;

  function draw() {
    wanted = false;
    const distance = camera.position.distanceTo(controls.target);
    camera.near = Math.max(0.002, distance / 100);
    camera.far = distance * 20 + 5;
    camera.updateProjectionMatrix();
    for (const { uniforms } of clouds) uniforms.tall.value = canvas.height;
    renderer.render(scene, camera);
    drawGizmo(gizmo, camera);
    listeners.forEach((listener) => listener());
  }
  function later() {
    if (!wanted) requestAnimationFrame(draw);
    wanted = true;
  }
  controls.addEventListener("change", later);

  function resize() {
    const { clientWidth: width, clientHeight: height } = canvas.parentElement;
    if (!width || !height) return;
    renderer.setPixelRatio(Math.min(2, devicePixelRatio));
    renderer.setSize(width, height, false);
    camera.aspect = width / height;
    camera.updateProjectionMatrix();
    later();
  }

  // What must be in sight: the targets, or what is around the chosen TCP, and the fingers of the chosen hand: a whole
  // palm in sight would leave little room for what is grasped.
  function corners(near = false) {
    const points = [], grasp = grasps[state.chosen], middle = new THREE.Vector3();
    if (near && grasp) middle.setFromMatrixPosition(grasp.matrix);
    const [x, y, z] = near && grasp ? content.half.map((half) => Math.min(half, AROUND)) : content.half;
    for (const a of [-x, x]) for (const b of [-y, y]) for (const c of [-z, z]) points.push(new THREE.Vector3(a, b, c).add(middle));
    if (!grasp) return points;
    const { shapes, closes } = hands[grasp.type];
    for (const { vertices } of shapes.filter(({ moving }) => moving || !closes))
      for (let i = 0; i < vertices.length; i += 3) points.push(new THREE.Vector3().fromArray(vertices, i).applyMatrix4(grasp.matrix));
    return points;
  }

  // Look from a direction, or from where one looks already, at all that must be in sight.
  function fit(towards = camera.position.clone().sub(controls.target), points = corners()) {
    const z = towards.clone().normalize();
    if (Math.abs(z.dot(up)) > 0.9999) z.addScaledVector(new THREE.Vector3(up.y, up.z, up.x), 0.01).normalize();
    const x = up.clone().cross(z).normalize(), y = z.clone().cross(x), tall = Math.tan((ANGLE / 2) * (Math.PI / 180)) / ROOM, wide = tall * camera.aspect;
    const middle = new THREE.Vector3();
    for (const axis of [x, y]) {
      const along = points.map((point) => point.dot(axis));
      middle.addScaledVector(axis, (Math.min(...along) + Math.max(...along)) / 2);
    }
    const far = Math.max(...points.map((point) => {
      const at = point.clone().sub(middle);
      return at.dot(z) + Math.max(Math.abs(at.dot(x)) / wide, Math.abs(at.dot(y)) / tall);
    }));
    controls.target.copy(middle);
    camera.position.copy(middle).addScaledVector(z, far);
    controls.update();
    later();
  }

  function inSight() {
    camera.updateMatrixWorld();
    return corners(true).every((point) => point.project(camera) && Math.max(Math.abs(point.x), Math.abs(point.y)) < 1 && point.z < 1);
  }

  function show() {
    const grasp = grasps[state.chosen];
    for (const [name, things] of Object.entries(parts)) things.forEach((thing) => { if (thing) thing.visible = !off.has(name); });
    for (const [type, group] of Object.entries(groups)) group.visible &&= grasp?.type === type;
    outlines.rods.visible &&= grasps.length > 0;
    way.visible &&= Boolean(grasp);
    const others = new Set([...state.shown].filter((i) => i !== state.chosen));
    outlines.show(others, state.marked === state.chosen ? -1 : state.marked, accent);
    const voted = Boolean(votes && grasp?.votes.count && !off.has("votes"));
    outlines.look.opacity = voted ? 0.22 : Math.min(0.6, Math.max(0.15, 7 / others.size)); // what is explained is not to be hidden
    if (grasp) {
      placeHand(groups[grasp.type], grasp, state.back, state.share);
      groups[grasp.type].userData.looks.forEach((look, moves) => {
        const opacity = state.through ? 0.28 : moves || !hands[grasp.type].closes ? 1 : PALM;
        Object.assign(look, { transparent: opacity < 1, opacity, depthWrite: opacity === 1 });
      });
      const from = new THREE.Vector3(0, 0, -grasp.back).applyMatrix4(grasp.matrix), to = new THREE.Vector3().setFromMatrixPosition(grasp.matrix);
      way.geometry.setFromPoints(arrow(from, to, grasp.matrix));
    }
    if (votes) discs.show(grasp?.votes ?? { first: 0, count: 0 }, state.only);
    for (const { uniforms } of clouds) uniforms.faded.value = voted ? 0.4 : 0;
    later();
  }

  // Where a point of the scene is on the canvas, in CSS pixels.
  function onScreen(point) {
    const at = point.clone().project(camera);
    return { x: ((at.x + 1) / 2) * canvas.clientWidth, y: ((1 - at.y) / 2) * canvas.clientHeight, z: at.z };
  }

  // The vote or the grasp at a place of the canvas: { vote } or { grasp }, or null.
  function at(place, reach = REACH) {
    const perMetre = canvas.clientHeight / (2 * Math.tan((ANGLE / 2) * (Math.PI / 180)));
    let found = null, nearest = Infinity;
    for (const { vote, at: point, radius } of off.has("votes") ? [] : discs.shown()) {
      const { x, y, z } = onScreen(point), size = Math.max(4, (perMetre * radius) / camera.position.distanceTo(point));
      if (Math.hypot(place.x - x, place.y - y) < size && z < nearest) [found, nearest] = [{ vote }, z];
    }
    if (found) return found;
    nearest = reach;
    outlines.ends.forEach((lines, i) => {
      if (!state.shown.has(i) || off.has("others") || i === state.chosen) return;
      for (const [a, b] of lines) {
        const distance = offLine(place, onScreen(a), onScreen(b));
        if (distance < nearest) [found, nearest] = [{ grasp: i }, distance];
      }
    });
    return found;
  }

  return {
    camera, controls, clouds, grasps, hands, votes, fit, inSight, resize, at, onScreen, later,
    set(changes) { Object.assign(state, changes); show(); },
    turnOff(name, gone) { off[gone ? "add" : "delete"](name); show(); },
    lookFrom(name) { fit(new THREE.Vector3(...content.eyes[name])); },
    lookAtGrasp() {
      const grasp = grasps[state.chosen], front = new THREE.Vector3(...content.eyes.front);
      if (!grasp) return fit(front);
      const [across, , approach] = [1, 0, 2].map((k) => new THREE.Vector3().setFromMatrixColumn(grasp.matrix, k));
      if (across.dot(front) < 0) across.negate();
      // Across closing and approach, where nothing of the hand hides its fingers; a little from above and behind. More from
      // the front where that is from above or below, so that what stands is not seen from its top alone.
      const upright = across.dot(up) ** 2;
      fit(across.multiplyScalar(2.2 - 1.4 * upright).addScaledVector(up, 0.6 * (1 - upright)).addScaledVector(front, 0.5 + 0.5 * upright).addScaledVector(approach, -0.15), corners(true));
    },
    lookAsCamera(i = 0) { fit(new THREE.Vector3(...content.cameras[i].eye)); },
    paint(how) { clouds.forEach((cloud) => cloud.paint(how)); later(); },
    touch(i) {
      if (!touches.has(i)) touches.set(i, firstTouch(hands[grasps[i].type], grasps[i], clouds[0].points));
      return touches.get(i);
    },
    onDraw(listener) { listeners.push(listener); },
    zoom(factor) { camera.position.sub(controls.target).multiplyScalar(factor).add(controls.target); controls.update(); later(); },
    colour({ paper, ink, soft, accent: word, table: [surface, grid] }) {
      renderer.setClearColor(paper);
      for (const { uniforms } of clouds) uniforms.paper.value.setRGB(...rgb(paper), THREE.LinearSRGBColorSpace);
      cameras.material.color.set(ink);
      way.material.color.set(soft);
      accent.set(word);
      if (table) { table.surface.material.color.set(surface); table.grid.material.color.set(grid); }
      show();
    },
    metresAcross(pixels) {
      return (2 * camera.position.distanceTo(controls.target) * Math.tan((ANGLE / 2) * (Math.PI / 180)) * pixels) / canvas.clientHeight;
    },
  };
}

// The way of the TCP as a line with a head.
function arrow(from, to, T) {
  const x = new THREE.Vector3().setFromMatrixColumn(T, 0), back = from.clone().sub(to).normalize().multiplyScalar(0.008);
  const barbs = [1, -1].flatMap((side) => [to, to.clone().add(back).addScaledVector(x, 0.003 * side)]);
  return [from, to, ...barbs];
}
