// The room in 3D: cameras, their uncertainty, and people moving on the common clock.
// THREE (three.js with TrackballControls) and SCENE (the data) come before this in the page.
(function () {
  "use strict";
  const MISSING = -32768;
  const UP = new THREE.Vector3(0, 0, 1);
  const STEEPEST = 0.985;

  const box = document.getElementById("scene");
  const play = document.getElementById("play");
  const slider = document.getElementById("time");
  const clock = document.getElementById("clock");
  const speed = document.getElementById("speed");
  const calm = matchMedia("(prefers-reduced-motion: reduce)").matches;

  let renderer;
  try {
    renderer = new THREE.WebGLRenderer({ antialias: true, alpha: true });
  } catch (error) {
    box.classList.add("without");
    document.getElementById("no-webgl").hidden = false;
    return;
  }
  renderer.setPixelRatio(Math.min(window.devicePixelRatio || 1, 2));
  box.appendChild(renderer.domElement);

  const scene = new THREE.Scene();
  scene.add(new THREE.HemisphereLight(0xffffff, 0x9aa0a6, 1.0));
  const sun = new THREE.DirectionalLight(0xffffff, 0.35);
  sun.position.set(0.4, -0.7, 1);
  scene.add(sun);

  const size = SCENE.size;
  const eye = new THREE.PerspectiveCamera(40, 1, size / 500, size * 40);
  eye.up.copy(UP);
  const middle = new THREE.Vector3().fromArray(SCENE.view.middle);
  const towards = new THREE.Vector3().fromArray(SCENE.view.towards);
  const controls = new THREE.TrackballControls(eye, renderer.domElement);
  controls.rotateSpeed = 2.2;
  controls.zoomSpeed = 1.1;
  controls.panSpeed = 0.6;
  controls.minDistance = size / 20;
  controls.maxDistance = size * 8;
  controls.dynamicDampingFactor = 0.35;
  controls.staticMoving = calm;
  controls.keys = ["", "", ""];

  function vector(numbers) {
    return new THREE.Vector3(numbers[0], numbers[1], numbers[2]);
  }

  // A straight stick between two points, as a matrix of a unit cylinder.
  const HIDDEN = new THREE.Matrix4().makeScale(0, 0, 0);
  const turned = new THREE.Quaternion();
  const along = new THREE.Vector3();
  const centre = new THREE.Vector3();
  const sizes = new THREE.Vector3();
  const Y = new THREE.Vector3(0, 1, 0);
  function stick(matrix, from, to, radius) {
    along.subVectors(to, from);
    const length = along.length();
    if (!(length > 0)) return matrix.copy(HIDDEN);
    centre.addVectors(from, to).multiplyScalar(0.5);
    turned.setFromUnitVectors(Y, along.divideScalar(length));
    return matrix.compose(centre, turned, sizes.set(radius, length, radius));
  }
  const cylinder = new THREE.CylinderGeometry(1, 1, 1, 8);
  const ball = new THREE.SphereGeometry(1, 24, 16);
  const matrix = new THREE.Matrix4();

  function sticks(pairs, radius, color, opacity) {
    const material = new THREE.MeshLambertMaterial({ color: color });
    if (opacity < 1) Object.assign(material, { transparent: true, opacity: opacity });
    const mesh = new THREE.InstancedMesh(cylinder, material, pairs.length);
    pairs.forEach(function (pair, i) {
      mesh.setMatrixAt(i, stick(matrix, pair[0], pair[1], radius));
    });
    mesh.frustumCulled = false;
    scene.add(mesh);
    return mesh;
  }

  // Floor
  const [left, right, near, far, step] = SCENE.floor;
  const grid = [];
  for (let x = left; x <= right + step / 2; x += step) grid.push(x, near, 0, x, far, 0);
  for (let y = near; y <= far + step / 2; y += step) grid.push(left, y, 0, right, y, 0);
  const lines = new THREE.BufferGeometry();
  lines.setAttribute("position", new THREE.Float32BufferAttribute(grid, 3));
  const faint = { color: 0x8a939b, transparent: true, opacity: 0.45 };
  scene.add(new THREE.LineSegments(lines, new THREE.LineBasicMaterial(faint)));

  // Cameras
  const labels = [];
  function label(text, color, place) {
    const element = document.createElement("span");
    element.textContent = text;
    element.style.color = color;
    box.appendChild(element);
    labels.push({ element: element, place: place });
    return element;
  }
  function frustum(camera, radius, color, opacity) {
    const top = vector(camera.centre);
    const corners = camera.corners.map(vector);
    const pairs = [];
    corners.forEach(function (corner, i) {
      pairs.push([top, corner], [corner, corners[(i + 1) % 4]]);
    });
    sticks(pairs, radius, color, opacity);
    return corners;
  }
  const ellipsoids = [];
  SCENE.cameras.forEach(function (camera) {
    const corners = frustum(camera, size / 700, camera.color, 1);
    const page = new THREE.BufferGeometry().setFromPoints(corners);
    page.setIndex([0, 1, 2, 0, 2, 3]);
    const glass = { color: camera.color, transparent: true, opacity: 0.22, depthWrite: false };
    scene.add(new THREE.Mesh(page, new THREE.MeshBasicMaterial(
      Object.assign({ side: THREE.DoubleSide }, glass))));
    const plumb = [vector(camera.centre), vector([camera.centre[0], camera.centre[1], 0])];
    sticks([plumb], size / 2400, camera.color, 0.45);
    label(camera.name, camera.color, function () { return plumb[0]; });
    if (camera.ellipsoid) {
      const mesh = new THREE.Mesh(ball, new THREE.MeshLambertMaterial(
        Object.assign({}, glass, { opacity: 0.45 })));
      const [x, y, z] = camera.ellipsoid.map(vector);
      mesh.matrixAutoUpdate = false;
      mesh.matrix.makeBasis(x, y, z).setPosition(vector(camera.centre));
      scene.add(mesh);
      ellipsoids.push(mesh);
    }
    const dot = new THREE.Mesh(ball, new THREE.MeshLambertMaterial({ color: camera.color }));
    dot.scale.setScalar(size / 260);
    dot.position.copy(plumb[0]);
    scene.add(dot);
  });
  SCENE.true_cameras.forEach(function (camera) {
    frustum(camera, size / 1500, getComputedStyle(box).color, 0.8);
  });

  // People
  function decoded(text) {
    const bytes = Uint8Array.from(atob(text), function (c) { return c.charCodeAt(0); });
    return new Int16Array(bytes.buffer);
  }
  const people = SCENE.people.map(function (person) {
    const points = [];
    for (let j = 0; j < person.n_joints; j++) points.push(new THREE.Vector3());
    const radius = SCENE.person_size / 85;
    const mesh = sticks(person.bones.map(function () { return [UP, UP]; }), radius, person.color, 1);
    mesh.instanceMatrix.setUsage(THREE.DynamicDrawUsage);
    const skin = new THREE.MeshLambertMaterial({ color: person.color });
    const head = new THREE.Mesh(ball, skin);
    head.scale.setScalar(SCENE.person_size / 17);
    scene.add(head);
    const top = new THREE.Vector3();
    const name = label(person.name, person.color, function () { return top; });
    return Object.assign({
      values: decoded(person.data), points: points, mesh: mesh, radius: radius,
      ball: head, top: top, label: name, seen: points.map(function () { return false; }),
    }, person);
  });

  // Joints of one person at a moment between two samples
  function place(person, at) {
    const n = person.n_joints * 3;
    const last = person.values.length / n - 1;
    const k = at - person.first;
    const there = k >= 0 && k <= last;
    const low = Math.min(Math.max(Math.floor(k), 0), last);
    const high = Math.min(low + 1, last);
    const part = Math.min(Math.max(k - low, 0), 1);
    person.points.forEach(function (point, j) {
      const a = low * n + 3 * j;
      const b = high * n + 3 * j;
      let weight = part;
      if (person.values[a] === MISSING) weight = 1;
      if (person.values[b] === MISSING) weight = person.values[a] === MISSING ? -1 : 0;
      person.seen[j] = there && weight >= 0;
      if (!person.seen[j]) return;
      for (let i = 0; i < 3; i++) {
        const value = (1 - weight) * person.values[a + i] + weight * person.values[b + i];
        point.setComponent(i, value * SCENE.resolution);
      }
    });
    person.bones.forEach(function (bone, i) {
      const both = person.seen[bone[0]] && person.seen[bone[1]];
      if (both) stick(matrix, person.points[bone[0]], person.points[bone[1]], person.radius);
      person.mesh.setMatrixAt(i, both ? matrix : HIDDEN);
    });
    person.mesh.instanceMatrix.needsUpdate = true;
    const heads = person.head.filter(function (j) { return person.seen[j]; });
    person.ball.visible = heads.length > 0;
    person.ball.position.set(0, 0, 0);
    heads.forEach(function (j) { person.ball.position.add(person.points[j]); });
    person.ball.position.divideScalar(Math.max(heads.length, 1));
    const some = person.seen.indexOf(true);
    person.label.hidden = some < 0;
    if (some < 0) return;
    person.top.copy(person.points[some]);
    person.points.forEach(function (point, j) {
      if (person.seen[j] && point.z > person.top.z) person.top.copy(point);
    });
    person.top.z += SCENE.person_size / 9;
  }

  function show(seconds) {
    slider.value = seconds;
    clock.textContent = seconds.toFixed(2) + " s";
    people.forEach(function (person) { place(person, seconds / SCENE.step_s); });
    dirty = true;
  }

  // Names stand above what they name; one that would cover another is raised.
  const projected = new THREE.Vector3();
  const LINE = 15;
  function placeLabels() {
    const width = box.clientWidth;
    const height = box.clientHeight;
    const placed = [];
    labels.forEach(function (one) {
      projected.copy(one.place()).project(eye);
      const x = (projected.x + 1) / 2 * width;
      let y = (1 - projected.y) / 2 * height - 13;
      const inside = x > 0 && x < width && y > 0 && y < height && projected.z < 1;
      const visible = inside && !one.element.hidden;
      one.element.style.visibility = visible ? "visible" : "hidden";
      if (!visible) return;
      const reach = 3.6 * one.element.textContent.length + 3;
      const covers = function (other) {
        return Math.abs(other.x - x) < other.reach + reach && Math.abs(other.y - y) < LINE;
      };
      for (let k = 0; k < 14 && placed.some(covers); k++) y -= 5;
      placed.push({ x: x, y: y, reach: reach });
      one.element.style.transform =
        "translate(-50%, -50%) translate(" + x.toFixed(1) + "px," + y.toFixed(1) + "px)";
    });
  }

  // Turning keeps the room upright: the controls may not roll or look from below a pole.
  const arm = new THREE.Vector3();
  function keepUpright() {
    arm.subVectors(eye.position, controls.target);
    const length = arm.length();
    if (Math.abs(arm.z) > STEEPEST * length) {
      const z = Math.sign(arm.z) * STEEPEST * length;
      const flat = Math.hypot(arm.x, arm.y) || 1e-9;
      const shrink = Math.sqrt(length * length - z * z) / flat;
      arm.set(arm.x * shrink, arm.y * shrink, z);
      eye.position.addVectors(controls.target, arm);
    }
    eye.up.copy(UP);
    eye.lookAt(controls.target);
  }

  // Everything in the middle of the view, with room for the names
  const outline = SCENE.where_people_are.map(vector);
  for (const x of [left, right]) for (const y of [near, far]) outline.push(vector([x, y, 0]));
  SCENE.cameras.forEach(function (camera) {
    outline.push(vector(camera.centre));
    camera.corners.forEach(function (corner) { outline.push(vector(corner)); });
  });
  function reset() {
    const bounds = new THREE.Box3();
    const right_of = new THREE.Vector3();
    const above = new THREE.Vector3();
    let distance = SCENE.view.distance;
    controls.target.copy(middle);
    for (let k = 0; k < 12; k++) {
      eye.position.copy(controls.target).addScaledVector(towards, distance);
      eye.up.copy(UP);
      eye.lookAt(controls.target);
      eye.updateMatrixWorld();
      bounds.makeEmpty();
      outline.forEach(function (point) { bounds.expandByPoint(projected.copy(point).project(eye)); });
      const half = distance * Math.tan(eye.fov * Math.PI / 360);
      eye.matrixWorld.extractBasis(right_of, above, projected);
      controls.target
        .addScaledVector(right_of, (bounds.min.x + bounds.max.x) / 2 * half * eye.aspect)
        .addScaledVector(above, (bounds.min.y + bounds.max.y) / 2 * half);
      distance *= Math.max((bounds.max.x - bounds.min.x) / 1.7, (bounds.max.y - bounds.min.y) / 1.65);
    }
    eye.position.copy(controls.target).addScaledVector(towards, distance);
    dirty = true;
  }

  let dirty = true;
  let playing = false;
  let now = SCENE.start_s;
  let before = 0;
  function frame(stamp) {
    requestAnimationFrame(frame);
    if (playing) {
      now += Math.min((stamp - before) / 1000, 0.2) * Number(speed.value);
      if (now > SCENE.length_s) now = 0;
      show(now);
    }
    before = stamp;
    controls.update();
    keepUpright();
    if (!dirty) return;
    dirty = false;
    renderer.render(scene, eye);
    placeLabels();
  }
  controls.addEventListener("change", function () { dirty = true; });

  play.addEventListener("click", function () {
    playing = !playing;
    play.textContent = playing ? "Pause" : "Play";
  });
  slider.addEventListener("input", function () {
    now = Number(slider.value);
    show(now);
  });
  document.getElementById("reset").addEventListener("click", reset);
  document.getElementById("ellipsoids").addEventListener("change", function (event) {
    ellipsoids.forEach(function (mesh) { mesh.visible = event.target.checked; });
    dirty = true;
  });

  function fit() {
    renderer.setSize(box.clientWidth, box.clientHeight);
    eye.aspect = box.clientWidth / box.clientHeight;
    eye.updateProjectionMatrix();
    controls.handleResize();
    dirty = true;
  }
  new ResizeObserver(fit).observe(box);
  fit();
  reset();
  show(now);
  requestAnimationFrame(frame);
})();
