// The robot as measured and as planned, its human, its feet and its balance.

import * as THREE from "three";
import { OrbitControls } from "/page/three/OrbitControls.js";

const LEFT = "#0072b2", RIGHT = "#d55e00"; // told apart with any colour vision
const FOLLOW_S = 0.4;
const PATH_STEP_M = 0.01, PATH_KEPT = 800;
const PATH_MEAN_S = 1.0; // its sway from foot to foot is no part of the way
const HALO_M = 0.004;
const HEADROOM = 0.05; // of the picture's height: free above the robot
const JUMP = 0.4, RISE = 0.08; // of its height: between two pictures it cannot go so far, and without torque not rise so much

// It knows where the robot is also in a browser that cannot draw it: steering goes on there.
export class Scene {
  // robot: what /robot gives.
  constructor(canvas, robot) {
    this.robot = robot;
    this.height = robot.height_m;
    this.canvas = canvas;
    this.renderer = rendererOn(canvas);
    this.scene = new THREE.Scene();
    this.camera = new THREE.PerspectiveCamera(38, 1, 0.02, 60);
    this.camera.up.set(0, 0, 1);
    const h = this.height;
    this.camera.position.set(2.1 * h, -1.5 * h, 1.15 * h);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.target.set(0, 0.3 * h, 0.48 * h);
    this.controls.minDistance = 0.6 * h;
    this.controls.maxDistance = 12 * h;
    this.controls.maxPolarAngle = 1.52;
    this.controls.enablePan = false;
    this.world = new THREE.Group(); // moves under the camera, so that the view can be turned meanwhile
    this.scene.add(this.world);
    this.centre = null;
    this.drawnAt = performance.now();
    this.addLights(h);
    this.addFloor();
    this.measured = this.figure((colour) => new THREE.MeshStandardMaterial({ color: colour, roughness: 0.75, metalness: 0.1 }), 0);
    this.planMaterial = new THREE.MeshBasicMaterial({ transparent: true, opacity: 0.5, side: THREE.BackSide, depthWrite: false });
    this.planned = this.figure(() => this.planMaterial, HALO_M);
    this.addHuman();
    this.addBalance();
    this.addPath();
    this.addMark();
    this.addHandles();
    this.odometry = [NaN, NaN, NaN];
    this.powered = true; // whether its torque may be on
    this.pickedUp = () => {}; // called when somebody has set up a robot whose torque is off
    this.shown = { plan: true, human: true, balance: false };
    this.covered = 0;
    this.resize = new ResizeObserver(() => this.fit());
    this.resize.observe(canvas.parentElement);
    this.fit();
  }

  addLights(h) {
    this.scene.add(new THREE.HemisphereLight(0xffffff, 0x8090a0, 1.6));
    const sun = new THREE.DirectionalLight(0xffffff, 2.2);
    sun.position.set(2 * h, -1.5 * h, 4 * h);
    sun.castShadow = true;
    sun.shadow.mapSize.set(1024, 1024);
    Object.assign(sun.shadow.camera, { left: -2 * h, right: 2 * h, top: 2 * h, bottom: -2 * h, near: 0.1, far: 10 * h });
    sun.shadow.radius = 4;
    this.scene.add(sun);
  }

  addFloor() {
    const size = 40 * this.height;
    this.cell = 0.25;
    // Lines as a picture: line segments that pass beside the camera are dropped by some drivers.
    this.tile = Object.assign(document.createElement("canvas"), { width: 256, height: 256 });
    this.tiles = new THREE.CanvasTexture(this.tile);
    this.tiles.colorSpace = THREE.SRGBColorSpace;
    this.tiles.wrapS = this.tiles.wrapT = THREE.RepeatWrapping;
    this.tiles.repeat.setScalar(size / this.cell);
    this.tiles.anisotropy = 8;
    this.floor = new THREE.Mesh(new THREE.PlaneGeometry(size, size), new THREE.MeshStandardMaterial({ roughness: 1, map: this.tiles }));
    this.floor.receiveShadow = true;
    this.scene.add(this.floor);
  }

  paintFloor(ground, line) {
    const context = this.tile.getContext("2d");
    context.fillStyle = ground;
    context.fillRect(0, 0, 256, 256);
    context.strokeStyle = line;
    context.lineWidth = 4;
    context.strokeRect(0, 0, 256, 256);
    this.tiles.needsUpdate = true;
  }

  figure(material, grow) {
    const root = new THREE.Group();
    const bodies = this.robot.bodies.map(() => { const body = new THREE.Group(); root.add(body); return body; });
    for (const mesh of this.robot.meshes) {
      const geometry = new THREE.BufferGeometry();
      geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(unpacked(mesh.vertices)), 3));
      geometry.setIndex(new THREE.BufferAttribute(new Uint32Array(unpacked(mesh.faces)), 1));
      geometry.computeVertexNormals();
      if (grow) {
        const [place, normal] = [geometry.attributes.position, geometry.attributes.normal];
        for (let i = 0; i < place.count; i++) {
          place.setXYZ(i, place.getX(i) + grow * normal.getX(i), place.getY(i) + grow * normal.getY(i), place.getZ(i) + grow * normal.getZ(i));
        }
      }
      const drawn = new THREE.Mesh(geometry, material(new THREE.Color(...mesh.colour.map((part) => part / 255)).convertSRGBToLinear()));
      drawn.castShadow = !grow;
      drawn.receiveShadow = !grow;
      bodies[mesh.body].add(drawn);
    }
    root.visible = false;
    this.world.add(root);
    return { root, bodies };
  }

  addHuman() {
    this.humanMaterial = new THREE.MeshStandardMaterial({ roughness: 0.6, transparent: true, opacity: 0.9 });
    const index = new Map(this.robot.points.map((name, place) => [name, place]));
    const place = (name) => (name === "neck" ? ["left_shoulder", "right_shoulder"] : [name]).map((one) => index.get(one));
    const thick = 0.022 * this.height;
    const shape = new THREE.CylinderGeometry(1, 1, 1, 12), ball = new THREE.SphereGeometry(thick, 12, 8);
    this.human = new THREE.Group();
    this.bones = this.robot.bones.map(([from, to]) => {
      const drawn = new THREE.Mesh(shape, this.humanMaterial);
      drawn.castShadow = true;
      this.human.add(drawn);
      const ends = [new THREE.Mesh(ball, this.humanMaterial), new THREE.Mesh(ball, this.humanMaterial)];
      this.human.add(...ends);
      return { drawn, ends, from: place(from), to: place(to), thick };
    });
    this.head = new THREE.Mesh(new THREE.SphereGeometry(0.06 * this.height, 20, 14), this.humanMaterial);
    this.head.castShadow = true;
    this.human.add(this.head);
    this.vertex = index.get("vertex");
    this.human.visible = false;
    this.world.add(this.human);
  }

  addBalance() {
    this.balance = new THREE.Group();
    const radius = 0.02 * this.height;
    const disc = (colour, size) => {
      const drawn = new THREE.Mesh(new THREE.CircleGeometry(size, 24), new THREE.MeshBasicMaterial({ color: colour, depthTest: false }));
      drawn.renderOrder = 2;
      this.balance.add(drawn);
      return drawn;
    };
    this.soles = this.robot.soles_m.map(([along, across], side) => {
      const colour = side ? RIGHT : LEFT;
      const drawn = new THREE.Mesh(new THREE.PlaneGeometry(along, across), new THREE.MeshBasicMaterial({ color: colour, transparent: true, depthTest: false }));
      drawn.renderOrder = 1;
      this.balance.add(drawn);
      return drawn;
    });
    this.marks = [disc("#00795c", radius), disc("#9b59b6", radius), disc("#1f2937", 0.7 * radius)];
    this.balance.visible = false;
    this.world.add(this.balance);
  }

  addPath() {
    this.path = [];
    this.line = new THREE.Line(new THREE.BufferGeometry(), new THREE.LineBasicMaterial());
    this.line.frustumCulled = false;
    this.world.add(this.line);
  }

  addMark() {
    const h = this.height;
    this.marked = new THREE.Mesh(new THREE.RingGeometry(0.06 * h, 0.09 * h, 40), new THREE.MeshBasicMaterial({ depthTest: false, transparent: true }));
    this.marked.renderOrder = 1;
    this.marked.visible = false;
    this.world.add(this.marked);
  }

  // A handle at each hand, and a ball where one is dragged to.
  addHandles() {
    const ball = (parent, colour, opacity) => {
      const drawn = new THREE.Mesh(new THREE.SphereGeometry(0.03 * this.height, 20, 14), new THREE.MeshBasicMaterial({ color: colour, transparent: true, opacity, depthTest: false }));
      drawn.renderOrder = 3;
      parent.add(drawn);
      return drawn;
    };
    this.handles = this.robot.hands.map(({ body, point }, side) => {
      const handle = ball(this.measured.bodies[body], side ? RIGHT : LEFT, 0.45);
      handle.position.set(...point);
      return handle;
    });
    this.aimed = ball(this.world, "#00795c", 0.7);
    this.aimed.visible = false;
  }

  // Distance of a pixel from the handle of a hand [pixels]; infinite where there is none.
  handPixels(side, clientX, clientY) {
    if (!this.handles[side] || !this.measured.root.visible || !this.renderer) return Infinity;
    this.scene.updateMatrixWorld();
    const seen = this.handles[side].getWorldPosition(new THREE.Vector3()).project(this.camera);
    const box = this.canvas.getBoundingClientRect();
    const [x, y] = [box.left + (0.5 + 0.5 * seen.x) * box.width, box.top + (0.5 - 0.5 * seen.y) * box.height];
    return Math.hypot(clientX - x, clientY - y);
  }

  // Where a hand is dragged to by a pixel, in the trunk's frame [m]: as far from the eye as the hand is now. null: nowhere.
  handAt(side, clientX, clientY) {
    this.scene.updateMatrixWorld();
    const hand = this.handles[side].getWorldPosition(new THREE.Vector3());
    const plane = new THREE.Plane().setFromNormalAndCoplanarPoint(this.camera.getWorldDirection(new THREE.Vector3()), hand);
    const hit = this.rayAt(clientX, clientY).intersectPlane(plane, new THREE.Vector3());
    if (!hit) return null;
    this.aim(this.world.worldToLocal(hit.clone()));
    return this.measured.bodies[this.robot.trunk].worldToLocal(hit).toArray();
  }

  // Show where a hand is dragged to, a place in the drawn world; null: nowhere.
  aim(place) {
    this.aimed.visible = place !== null;
    if (place) this.aimed.position.copy(place);
    this.changed = true;
  }

  // Colours of the page: light or dark.
  paint() {
    const style = getComputedStyle(document.documentElement);
    const colour = (name) => new THREE.Color(style.getPropertyValue(name).trim());
    const ground = colour("--stage");
    this.scene.background = ground;
    this.scene.fog = new THREE.Fog(ground, 5 * this.height, 16 * this.height);
    this.paintFloor(...["--stage", "--grid"].map((name) => style.getPropertyValue(name)));
    this.planMaterial.color = colour("--plan");
    this.humanMaterial.color = colour("--human");
    this.line.material.color = colour("--quiet");
    this.marked.material.color = colour("--accent");
    this.changed = true;
  }

  // Take a picture, an array of numbers as `flexmotion.streamer.page.pictures` makes it.
  take(numbers) {
    const count = this.robot.bodies.length * 7;
    let place = 1;
    const part = (length) => numbers.subarray(place, (place += length));
    this.passed = Math.max(numbers[0] - (this.time ?? numbers[0]), 0);
    this.time = numbers[0];
    this.changed = true;
    pose(this.measured, part(count), true);
    pose(this.planned, part(count), this.shown.plan);
    this.showHuman(part(3 * this.robot.points.length));
    const balance = [part(10), part(2), part(2), part(2), part(3)];
    this.showBalance(...balance);
    this.com = balance[4].slice(0, 2);
    this.odometry = part(3).slice();
    if (this.measured.root.visible) this.follow(this.measured.bodies[1].position);
  }

  // Heading of the measured robot in the drawn world [rad].
  get heading() {
    const forward = new THREE.Vector3(1, 0, 0).applyQuaternion(this.measured.bodies[1].quaternion);
    return Math.atan2(forward.y, forward.x);
  }

  // The place on the floor under a pixel, x and y in the drawn world [m]; null: there is none, or it is far away.
  floorAt(clientX, clientY) {
    const hit = this.rayAt(clientX, clientY).intersectPlane(new THREE.Plane(new THREE.Vector3(0, 0, 1), 0), new THREE.Vector3());
    if (!hit || hit.distanceTo(this.camera.position) > 14 * this.height) return null;
    hit.sub(this.world.position);
    return [hit.x, hit.y];
  }

  rayAt(clientX, clientY) {
    const box = this.canvas.getBoundingClientRect();
    const place = new THREE.Vector2((2 * (clientX - box.left)) / box.width - 1, 1 - (2 * (clientY - box.top)) / box.height);
    const ray = new THREE.Raycaster();
    ray.setFromCamera(place, this.camera);
    return ray.ray;
  }

  // A place in the drawn world as seen by the robot: ahead and left of its centre of mass [m]; NaN where it is unknown.
  fromRobot([x, y]) {
    const [dx, dy] = [x - this.com[0], y - this.com[1]];
    const [cos, sin] = [Math.cos(this.heading), Math.sin(this.heading)];
    return [cos * dx + sin * dy, cos * dy - sin * dx].map((value) => (Number.isFinite(this.odometry[0]) ? value : NaN));
  }

  // The other way; null where the robot's place is unknown.
  beforeRobot(ahead, left) {
    const [cos, sin] = [Math.cos(this.heading), Math.sin(this.heading)];
    const place = [this.com?.[0] + cos * ahead - sin * left, this.com?.[1] + sin * ahead + cos * left];
    return place.every(Number.isFinite) && Number.isFinite(this.odometry[0]) ? place : null;
  }

  // Mark a place of the drawn world; null: none.
  mark(place) {
    this.marked.visible = place !== null;
    if (place) this.marked.position.set(...place, 0.003);
    this.changed = true;
  }

  showHuman(points) {
    this.human.visible = this.shown.human && Number.isFinite(points[0]);
    if (!this.human.visible) return;
    const point = (places) => places.reduce((sum, at) => sum.add(new THREE.Vector3(...points.subarray(3 * at, 3 * at + 3))), new THREE.Vector3()).divideScalar(places.length);
    for (const { drawn, ends, from, to, thick } of this.bones) {
      const [a, b] = [point(from), point(to)];
      const along = b.clone().sub(a);
      drawn.position.copy(a).add(b).multiplyScalar(0.5);
      drawn.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), along.clone().normalize());
      drawn.scale.set(thick, along.length(), thick);
      ends[0].position.copy(a);
      ends[1].position.copy(b);
    }
    this.head.position.copy(point([this.vertex]));
    this.head.position.z -= 0.06 * this.height;
  }

  showBalance(feet, _planned, zmp, dcm, com) {
    this.balance.visible = this.shown.balance;
    this.soles.forEach((sole, side) => {
      const [x, y, z, yaw, bears] = feet.subarray(5 * side, 5 * side + 5);
      sole.visible = Number.isFinite(x);
      sole.position.set(x, y, Math.max(z, 0) + 0.002);
      sole.rotation.z = yaw;
      sole.material.opacity = bears ? 0.6 : 0.2;
    });
    [zmp, dcm, com].forEach(([x, y], index) => {
      this.marks[index].visible = Number.isFinite(x);
      this.marks[index].position.set(x, y, 0.004);
    });
  }

  follow(at) {
    const now = performance.now();
    const share = 1 - Math.exp(-Math.min(now - this.drawnAt, 1000) / 1000 / FOLLOW_S);
    this.drawnAt = now;
    this.centre ??= at.clone();
    this.centre.lerp(at, share);
    this.world.position.set(-this.centre.x, -this.centre.y, 0);
    this.tiles.offset.set((this.centre.x / this.cell) % 1, (this.centre.y / this.cell) % 1);
    this.mean ??= at.clone();
    this.last ??= at.clone();
    const far = Math.hypot(at.x - this.last.x, at.y - this.last.y) > JUMP * this.height;
    if (far) {
      this.path.length = 0; // it did not walk there
      this.mean.copy(at);
      this.centre.copy(at);
    }
    if (!this.powered && (far || at.z - this.last.z > RISE * this.height)) this.pickedUp();
    this.last.copy(at);
    this.mean.lerp(at, 1 - Math.exp(-this.passed / PATH_MEAN_S));
    const last = this.path.at(-1);
    if (!last || Math.hypot(last.x - this.mean.x, last.y - this.mean.y) > PATH_STEP_M) {
      this.path.push(new THREE.Vector3(this.mean.x, this.mean.y, 0.0015));
      if (this.path.length > PATH_KEPT) this.path.shift();
      this.line.geometry.dispose();
      this.line.geometry = new THREE.BufferGeometry().setFromPoints(this.path);
    }
  }

  // What lies over the top of the picture, down to `pixels`: the robot is drawn below it.
  cover(pixels) {
    this.covered = pixels;
    this.fit();
  }

  fit() {
    if (!this.renderer) return;
    const { clientWidth: width, clientHeight: height } = this.canvas.parentElement;
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    this.renderer.setSize(width, height, false);
    const top = Math.min(Math.max(this.covered - HEADROOM * height, 0), 0.5 * height), free = Math.max(height - top, 1);
    this.camera.aspect = width / free;
    this.camera.fov = width < height ? 48 : 38;
    // On a phone the stick lies over the lower left corner.
    const [aside, up] = width < 500 ? [0.1 * width, 0.08 * free] : [0, 0];
    this.camera.setViewOffset(width, free, -aside, up - top, width, height);
    this.camera.updateProjectionMatrix();
    this.changed = true;
  }

  // Draws where anything has changed: a page that shows a robot at rest costs nothing.
  draw() {
    if (!this.renderer || (!this.controls.update() && !this.changed)) return;
    this.changed = false;
    this.renderer.render(this.scene, this.camera);
  }

  // Place of a body of the measured robot in the world [m]; for tests.
  bodyPosition(name) {
    return this.measured.bodies[this.robot.bodies.indexOf(name)].position.toArray();
  }
}

// null: the browser has no WebGL, or has it switched off.
function rendererOn(canvas) {
  try {
    const renderer = new THREE.WebGLRenderer({ canvas, antialias: true });
    renderer.shadowMap.enabled = true;
    return renderer;
  } catch (error) {
    console.warn(`The robot is not drawn: ${error.message}`);
    return null;
  }
}

function pose(figure, numbers, shown) {
  figure.root.visible = shown && Number.isFinite(numbers[7]);
  if (!figure.root.visible) return;
  figure.bodies.forEach((body, index) => {
    const [x, y, z, w, i, j, k] = numbers.subarray(7 * index, 7 * index + 7);
    body.position.set(x, y, z);
    body.quaternion.set(i, j, k, w);
  });
}

function unpacked(text) {
  return Uint8Array.from(atob(text), (character) => character.charCodeAt(0)).buffer;
}
