// The parts of three.js that spgf_torch/drawing/viewer/*.js use. Another one is added here; then: make viewer.
export {
  BoxGeometry, BufferAttribute, BufferGeometry, CircleGeometry, Color, CylinderGeometry, DirectionalLight, DoubleSide,
  Group, HemisphereLight, InstancedMesh, Line, LineBasicMaterial, LineSegments, Matrix4, Mesh, MeshBasicMaterial,
  MeshStandardMaterial, PerspectiveCamera, Plane, Points, Quaternion, Raycaster, RingGeometry, Scene, ShaderMaterial,
  Vector2, Vector3, WebGLRenderer,
} from "three";
export { TrackballControls } from "three/addons/controls/TrackballControls.js";
export { OrbitControls } from "three/addons/controls/OrbitControls.js";
