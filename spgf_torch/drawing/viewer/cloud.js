// Points as round dots of a size in the scene, lit where their normals are known.
const PLAIN = ["#c3ccd4", "#7d9cc0"]; // of targets and of the rest, where the input has no colours

const DOTS = {
  vertexShader: `
    attribute vec3 facing, tint;
    uniform float radius, tall, lit;
    varying vec3 colour;
    void main() {
      vec4 place = modelViewMatrix * vec4(position, 1.0);
      gl_Position = projectionMatrix * place;
      gl_PointSize = clamp(radius * tall * projectionMatrix[1][1] / -place.z, 2.0, 64.0);
      vec3 seen = normalMatrix * facing;
      float light = dot(facing, facing) < 0.25 ? 0.95 : 0.62 + 0.4 * max(0.0, dot(normalize(seen), normalize(vec3(-0.4, 0.6, 0.8))));
      colour = tint * mix(1.0, light, lit);
    }`,
  fragmentShader: `
    uniform vec3 paper;
    uniform float faded;
    varying vec3 colour;
    void main() {
      vec2 at = 2.0 * gl_PointCoord - 1.0;
      if (dot(at, at) > 1.0) discard;
      gl_FragColor = vec4(mix(colour, paper, faded), 1.0);
    }`,
};

// Each cloud of the page as { dots, points, paint(how) }: how is sensed, height or plain.
function dotsOf(packed, index, up) {
  const points = unpackedPoints(packed.points), count = points.length / 3;
  const colours = packed.colours ? unpacked(packed.colours) : null;
  const normals = packed.normals ? Float32Array.from(unpacked(packed.normals), (n) => n / 127) : new Float32Array(points.length);
  const tint = new Float32Array(points.length), geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(points, 3));
  geometry.setAttribute("facing", new THREE.BufferAttribute(normals, 3));
  geometry.setAttribute("tint", new THREE.BufferAttribute(tint, 3));
  const uniforms = { radius: { value: packed.radius }, tall: { value: 1 }, lit: { value: 1 }, faded: { value: 0 }, paper: { value: new THREE.Color() } };
  const dots = new THREE.Points(geometry, new THREE.ShaderMaterial({ ...DOTS, uniforms }));
  const heights = Array.from({ length: count }, (_, i) => up.x * points[3 * i] + up.y * points[3 * i + 1] + up.z * points[3 * i + 2]);
  let low = Infinity, high = -Infinity; // of many points: too many to spread into Math.min
  for (const height of heights) { low = Math.min(low, height); high = Math.max(high, height); }

  function paint(how) {
    const own = how === "sensed" && colours, plain = rgb(PLAIN[index]);
    for (let i = 0; i < count; i++) {
      const [r, g, b] = own ? [0, 1, 2].map((k) => colours[3 * i + k] / 255) : how === "height" ? heightColour((heights[i] - low) / (high - low || 1)) : plain;
      tint.set([r, g, b], 3 * i);
    }
    uniforms.lit.value = own ? 0.5 : 1; // a photograph's colours have light in them already
    geometry.attributes.tint.needsUpdate = true;
  }
  return { dots, points, uniforms, coloured: Boolean(colours), paint };
}

// Dark violet over teal to light yellow: lightness rises with height.
function heightColour(share) {
  const stops = [[0.27, 0.13, 0.42], [0.2, 0.45, 0.56], [0.3, 0.71, 0.47], [0.97, 0.9, 0.25]], at = Math.min(0.9999, Math.max(0, share)) * 3;
  const k = Math.floor(at), part = at - k;
  return [0, 1, 2].map((c) => stops[k][c] + part * (stops[k + 1][c] - stops[k][c]));
}

// Screen colours 0 to 1 as they stand in a style sheet: dots write them as they are.
function rgb(word) {
  const digits = Number.parseInt(word.slice(1), 16);
  return [digits >> 16, (digits >> 8) & 255, digits & 255].map((value) => value / 255);
}
