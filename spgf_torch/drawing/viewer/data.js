// What Python packed into the page: numbers in base64, points in whole steps about the page's origin.
const KINDS = { i1: Int8Array, u1: Uint8Array, i2: Int16Array, u2: Uint16Array, u4: Uint32Array, f4: Float32Array };

function unpacked({ kind, base64 }) {
  const bytes = Uint8Array.from(atob(base64), (letter) => letter.charCodeAt(0));
  return new KINDS[kind](bytes.buffer);
}

function unpackedPoints(packed) {
  return Float32Array.from(unpacked(packed), (steps) => steps * packed.step);
}

// 3 x 4 numbers row by row as a matrix of three.js.
function matrix(rows, at = 0) {
  const n = (i) => rows[at + i];
  return new THREE.Matrix4().set(n(0), n(1), n(2), n(3), n(4), n(5), n(6), n(7), n(8), n(9), n(10), n(11), 0, 0, 0, 1);
}

// The colour of a number from 0 to 1 on a scale of [place, colour].
function onScale(scale, value) {
  const next = Math.max(1, scale.findIndex(([place]) => place >= value)), [[a, from], [b, to]] = [scale[next - 1], scale[next]];
  return new THREE.Color(from).lerp(new THREE.Color(to), (value - a) / (b - a));
}
