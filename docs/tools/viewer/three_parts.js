// The parts of three.js that spgf_torch/drawing/viewer/*.js use. Another one is added here; then: make viewer.
export {
  BufferAttribute, BufferGeometry, CircleGeometry, Color, CylinderGeometry, DirectionalLight, DoubleSide, EdgesGeometry, Group,
  HemisphereLight, InstancedMesh, Line, LineBasicMaterial, LinearSRGBColorSpace, LineSegments, Matrix4, Mesh, MeshBasicMaterial,
  MeshStandardMaterial, PerspectiveCamera, Plane, Points, Quaternion, RingGeometry, Scene, ShaderMaterial, Vector3, WebGLRenderer,
} from "three";
export { OrbitControls } from "three/addons/controls/OrbitControls.js";
