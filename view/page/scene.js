// The map, the camera and where it has been, in three dimensions.
"use strict";

const WaymarkScene = (() => {
  // Okabe and Ito's colours; a state also has its word in the legend and the table.
  const STATES = {
    mapped: {colour: 0x0072b2, text: "marker"},
    undecided: {colour: 0xe69f00, text: "marker, of two poses one is right"},
  };
  const SOURCES = [
    {colour: 0x999999, text: ""},
    {colour: 0x009e73, text: "pose from markers"},
    {colour: 0xcc79a7, text: "pose from natural features"},
    {colour: 0xd55e00, text: "pose from motion alone"},
  ];
  const PICTURE = {colour: 0x9467bd, text: "natural marker"};
  const MOST_POINTS = 40000;

  const dark = window.matchMedia("(prefers-color-scheme: dark)");
  const canvas = document.getElementById("canvas");
  const renderer = new THREE.WebGLRenderer({canvas, antialias: true, alpha: true});
  const scene = new THREE.Scene();
  const eye = new THREE.PerspectiveCamera(50, 1, 0.02, 2000);
  const controls = new THREE.OrbitControls(eye, canvas);
  controls.enableKeys = false;         // ours do more
  const root = new THREE.Group();      // the world
  const markers = new THREE.Group();
  const pictures = new THREE.Group();  // natural markers
  const ids = new THREE.Group();
  const sigmas = new THREE.Group();
  const camera = new THREE.Group();
  const body = new THREE.Group();      // that carries the camera, where that is not the same
  let floor = null;
  let framed = false;                  // somebody has seen all of it once
  let wanted = true;                   // something has changed
  const shown = {follow: false, labels: true, trail: true, sigma: false, up: "-y"};

  function lines(points, colour) {
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.Float32BufferAttribute(points, 3));
    return new THREE.LineSegments(geometry, new THREE.LineBasicMaterial({color: colour}));
  }

  // Of a camera that sees 60 degrees across; which lens it is nobody says here.
  function frustum() {
    const [x, y, z] = [0.29, 0.22, 0.5];
    const corners = [[-x, -y, z], [x, -y, z], [x, y, z], [-x, y, z]];
    const points = [];
    corners.forEach((c, i) => points.push(0, 0, 0, ...c, ...c, ...corners[(i + 1) % 4]));
    points.push(-x * 0.5, -y, z, 0, -y * 1.5, z, 0, -y * 1.5, z, x * 0.5, -y, z);  // its top
    return lines(points, 0xd55e00);
  }

  // A wedge that points along x, its z up, and its axes.
  function wedge() {
    const [x, y, z] = [0.2, 0.12, 0.05];
    const shape = [[x, 0, 0], [-x, y, 0], [-x, -y, 0]];
    const points = [];
    shape.forEach((c, i) => {
      const next = shape[(i + 1) % 3];
      points.push(...c, ...next, c[0], c[1], z, next[0], next[1], z, ...c, c[0], c[1], z);
    });
    const group = new THREE.Group();
    group.add(lines(points, 0x56b4e9), new THREE.AxesHelper(0.15));
    return group;
  }

  function code(marker, side) {
    const cells = side + 2;
    const picture = document.createElement("canvas");
    picture.width = picture.height = cells;
    const pen = picture.getContext("2d");
    pen.fillStyle = "#000";
    pen.fillRect(0, 0, cells, cells);
    pen.fillStyle = "#fff";
    for (let i = 0; i < marker.cells.length; ++i) {
      if (marker.cells[i] === "1") pen.fillRect(1 + (i % side), 1 + Math.floor(i / side), 1, 1);
    }
    const texture = new THREE.CanvasTexture(picture);
    texture.magFilter = THREE.NearestFilter;
    texture.minFilter = THREE.LinearFilter;
    texture.generateMipmaps = false;
    return texture;
  }

  function label(text, size) {
    const picture = document.createElement("canvas");
    const font = "bold 46px sans-serif";
    let pen = picture.getContext("2d");
    pen.font = font;
    picture.width = Math.max(128, Math.ceil(pen.measureText(text).width) + 16);
    picture.height = 64;
    pen = picture.getContext("2d");
    pen.font = font;
    pen.textAlign = "center";
    pen.textBaseline = "middle";
    pen.lineWidth = 8;
    pen.strokeStyle = dark.matches ? "#12161c" : "#ffffff";
    pen.fillStyle = dark.matches ? "#ffffff" : "#17202a";
    pen.strokeText(text, picture.width / 2, 32);
    pen.fillText(text, picture.width / 2, 32);
    const sprite = new THREE.Sprite(new THREE.SpriteMaterial(
      {map: new THREE.CanvasTexture(picture), depthTest: false, transparent: true}));
    sprite.scale.set(0.8 * size * picture.width / picture.height, 0.8 * size, 1);
    return sprite;
  }

  function empty(group) {
    group.traverse((object) => {
      if (object.geometry) object.geometry.dispose();
      if (object.material) {
        for (const material of [].concat(object.material)) {
          if (material.map) material.map.dispose();
          material.dispose();
        }
      }
    });
    while (group.children.length > 0) group.remove(group.children[0]);
  }

  function isPose(m) {
    return m.p && m.q && m.p.every(Number.isFinite) && m.q.every(Number.isFinite);
  }

  function addSigma(m, colour) {
    if (!(m.sigma_m > 0)) return;
    const ball = new THREE.Mesh(new THREE.SphereBufferGeometry(3 * m.sigma_m, 16, 12),
      new THREE.MeshBasicMaterial({color: colour, transparent: true, opacity: 0.35}));
    ball.position.set(...m.p);
    sigmas.add(ball);
  }

  // The segments of a rectangle around the middle.
  function rectangle(x, y) {
    return [-x, y, 0, x, y, 0, x, y, 0, x, -y, 0, x, -y, 0, -x, -y, 0, -x, -y, 0, -x, y, 0];
  }

  // A frame around nothing: what is printed there nobody says here.
  function addPicture(m) {
    const place = new THREE.Group();
    place.position.set(...m.p);
    place.quaternion.set(m.q[1], m.q[2], m.q[3], m.q[0]);
    const [x, y] = [0.5 * m.width, 0.5 * m.height];
    const least = Math.min(m.width, m.height);
    const rim = 0.06 * least;
    place.add(new THREE.Mesh(new THREE.PlaneBufferGeometry(m.width, m.height),
      new THREE.MeshBasicMaterial({color: PICTURE.colour, side: THREE.DoubleSide,
                                   transparent: true, opacity: 0.15, depthWrite: false})));
    place.add(lines([...rectangle(x, y), ...rectangle(x - rim, y - rim),
                     0, 0, 0, 0, 0, 0.3 * least], PICTURE.colour));
    pictures.add(place);
    const size = 0.5 * least;
    const text = label((m.name || String(m.id)).slice(0, 40), size);
    text.position.set(...m.p);
    text.position.add(new THREE.Vector3(0, y + 0.5 * size, 0.02 * size).applyQuaternion(place.quaternion));
    ids.add(text);
    addSigma(m, PICTURE.colour);
  }

  function addMarker(m, side) {
    const state = STATES[m.state] || STATES.mapped;
    const place = new THREE.Group();
    place.position.set(...m.p);
    place.quaternion.set(m.q[1], m.q[2], m.q[3], m.q[0]);
    const plane = new THREE.PlaneBufferGeometry(m.size, m.size);
    const front = m.cells.length > 0
      ? new THREE.MeshBasicMaterial({map: code(m, side), side: THREE.FrontSide})
      : new THREE.MeshBasicMaterial({color: 0x222222, side: THREE.FrontSide});
    place.add(new THREE.Mesh(plane, front));
    place.add(new THREE.Mesh(plane, new THREE.MeshBasicMaterial(
      {color: state.colour, side: THREE.BackSide, transparent: true, opacity: 0.55})));
    const h = 0.62 * m.size;
    place.add(lines([...rectangle(h, h), 0, 0, 0, 0, 0, 0.5 * m.size], state.colour));
    markers.add(place);
    const text = label(String(m.id), m.size);
    text.position.set(...m.p);
    text.position.add(new THREE.Vector3(0, 1.05 * m.size, 0.02 * m.size).applyQuaternion(place.quaternion));
    ids.add(text);
    addSigma(m, state.colour);
  }

  const trail = (() => {
    const geometry = new THREE.BufferGeometry();
    const position = new THREE.BufferAttribute(new Float32Array(6 * MOST_POINTS), 3);
    const colour = new THREE.BufferAttribute(new Float32Array(6 * MOST_POINTS), 3);
    geometry.setAttribute("position", position);
    geometry.setAttribute("color", colour);
    geometry.setDrawRange(0, 0);
    const object = new THREE.LineSegments(geometry,
      new THREE.LineBasicMaterial({vertexColors: THREE.VertexColors}));
    object.frustumCulled = false;
    let count = 0;     // segments
    let last = null;
    const paint = new THREE.Color();

    function clear() {
      count = 0;
      last = null;
      geometry.setDrawRange(0, 0);
    }
    function add(p, source, begins) {
      if (last && !begins) {
        const at = 6 * (count % MOST_POINTS);  // the oldest gives way
        position.array.set([...last, ...p], at);
        paint.setHex((SOURCES[source] || SOURCES[0]).colour);
        colour.array.set([paint.r, paint.g, paint.b, paint.r, paint.g, paint.b], at);
        ++count;
        position.needsUpdate = colour.needsUpdate = true;
        geometry.setDrawRange(0, 2 * Math.min(count, MOST_POINTS));
      }
      last = p;
    }
    return {object, clear, add, segments: () => count};
  })();

  // Whole ways, each a line of its own colour; in the legend in place of the sources'.
  const tracks = new THREE.Group();
  let ways = SOURCES;          // what the legend says of them
  function setTracks(list) {
    empty(tracks);
    for (const {points, colour} of list) {
      const segments = [];
      points.forEach(([t, p], i) => {
        if (i > 0 && t - points[i - 1][0] < 0.5) segments.push(...points[i - 1][1], ...p);
      });
      tracks.add(lines(segments, colour));
    }
    ways = list;
    showLegend();
    framed = false;
    home();
  }

  // Most maps have no natural markers.
  function showLegend() {
    const legend = document.getElementById("legend");
    legend.textContent = "";
    const natural = pictures.children.length > 0 ? [PICTURE] : [];
    for (const {colour, text} of [...Object.values(STATES), ...natural, ...ways]) {
      if (!text) continue;
      const item = document.createElement("li");
      const swatch = document.createElement("i");
      swatch.style.background = "#" + colour.toString(16).padStart(6, "0");
      item.append(swatch, text);
      legend.append(item);
    }
  }

  // Three's world has y up.
  function turnUp() {
    root.rotation.set(shown.up === "z" ? -Math.PI / 2 : Math.PI, 0, 0);
    document.getElementById("up").textContent = shown.up === "z" ? "Up: z" : "Up: \u2212y";
  }

  function everything() {
    root.updateMatrixWorld(true);
    const box = new THREE.Box3();
    for (const group of [markers, pictures]) if (group.children.length > 0) box.expandByObject(group);
    if (tracks.children.length > 0) box.expandByObject(tracks);
    if (camera.visible) box.expandByPoint(camera.getWorldPosition(new THREE.Vector3()));
    return box;
  }

  function layFloor(box) {
    if (floor) {
      scene.remove(floor);
      floor.geometry.dispose();
    }
    const size = box.getSize(new THREE.Vector3());
    const step = Math.max(0.1, Math.pow(10, Math.round(Math.log10(Math.max(size.x, size.z, 0.3) / 8))));
    const half = Math.ceil(0.7 * Math.max(size.x, size.z, 4 * step) / step);
    floor = new THREE.GridHelper(2 * half * step, 2 * half, dark.matches ? 0x55606e : 0x8895a4,
                                 dark.matches ? 0x2a323c : 0xd5dae1);
    const middle = box.getCenter(new THREE.Vector3());
    floor.position.set(Math.round(middle.x / step) * step, box.min.y, Math.round(middle.z / step) * step);
    scene.add(floor);
  }

  function home() {
    const box = everything();
    if (box.isEmpty()) return;
    const middle = box.getCenter(new THREE.Vector3());
    const radius = Math.max(0.3, 0.5 * box.getSize(new THREE.Vector3()).length());
    const across = Math.min(1, eye.aspect) * Math.tan(0.5 * eye.fov * Math.PI / 180);
    controls.target.copy(middle);
    eye.position.copy(middle).add(
      new THREE.Vector3(0.45, 0.55, 0.75).normalize().multiplyScalar(1.05 * radius / across));
    eye.near = radius / 500;
    eye.far = radius * 50;
    eye.updateProjectionMatrix();
    wanted = true;
  }

  function setMap(map) {
    for (const group of [markers, pictures, ids, sigmas]) empty(group);
    for (const m of map.markers) if (isPose(m) && m.size > 0) addMarker(m, map.side);
    for (const m of map.natural) if (isPose(m) && m.width > 0 && m.height > 0) addPicture(m);
    showLegend();
    const box = everything();
    if (!box.isEmpty()) {
      layFloor(box);
      // As it grows it stays in view, until somebody looks elsewhere.
      if (!framed) home();
    }
    wanted = true;
  }

  function setPose(pose) {
    body.visible = false;
    camera.visible = Boolean(pose.p) && pose.p.every(Number.isFinite);
    if (camera.visible) {
      camera.position.set(...pose.p);
      camera.quaternion.set(pose.q[1], pose.q[2], pose.q[3], pose.q[0]);
      const b = pose.body;
      body.visible = Boolean(b) && b.p.concat(b.q).every(Number.isFinite);
      if (body.visible) {
        body.position.set(...b.p);
        body.quaternion.set(b.q[1], b.q[2], b.q[3], b.q[0]);
        const turned = 2 * Math.acos(Math.min(1, Math.abs(body.quaternion.dot(camera.quaternion))));
        body.visible = turned > 0.001 || body.position.distanceTo(camera.position) > 0.0005;
      }
      if (shown.follow) {
        const before = controls.target.clone();
        controls.target.copy(camera.getWorldPosition(new THREE.Vector3()));
        eye.position.add(controls.target.clone().sub(before));
      }
    }
    wanted = true;
  }

  function orbit(left, up) {
    const arm = eye.position.clone().sub(controls.target);
    const polar = new THREE.Spherical().setFromVector3(arm);
    polar.theta += left;
    polar.phi = Math.min(Math.max(polar.phi + up, 0.05), Math.PI - 0.05);
    eye.position.copy(controls.target).add(new THREE.Vector3().setFromSpherical(polar));
  }

  function zoom(factor) {
    eye.position.sub(controls.target).multiplyScalar(factor).add(controls.target);
  }

  function toggle(name, button) {
    shown[name] = !shown[name];
    button.setAttribute("aria-pressed", String(shown[name]));
    apply();
  }

  function apply() {
    ids.visible = shown.labels;
    sigmas.visible = shown.sigma;
    trail.object.visible = tracks.visible = shown.trail;
    wanted = true;
  }

  function listen() {
    const byId = (id) => document.getElementById(id);
    const actions = {
      home: () => { framed = false; home(); },
      follow: () => toggle("follow", byId("follow")),
      labels: () => toggle("labels", byId("labels")),
      trail: () => toggle("trail", byId("trail")),
      sigma: () => toggle("sigma", byId("sigma")),
      up: () => {
        shown.up = shown.up === "z" ? "-y" : "z";
        try { localStorage.setItem("waymark-up", shown.up); } catch (e) { /* not kept, then */ }
        turnUp();
        const box = everything();
        if (!box.isEmpty()) layFloor(box);
        home();
      },
    };
    for (const [id, act] of Object.entries(actions)) byId(id).addEventListener("click", act);
    const keys = {h: "home", f: "follow", i: "labels", t: "trail", u: "sigma", z: "up"};
    document.addEventListener("keydown", (event) => {
      if (event.ctrlKey || event.metaKey || event.altKey) return;
      if (keys[event.key]) return actions[keys[event.key]]();
      if (document.activeElement !== canvas) return;
      const moves = {ArrowLeft: [0.1, 0], ArrowRight: [-0.1, 0], ArrowUp: [0, -0.1], ArrowDown: [0, 0.1]};
      if (moves[event.key]) orbit(...moves[event.key]);
      else if (event.key === "+" || event.key === "=") zoom(0.85);
      else if (event.key === "-") zoom(1 / 0.85);
      else return;
      framed = wanted = true;
      event.preventDefault();
    });
    controls.addEventListener("start", () => { framed = true; });
    controls.addEventListener("change", () => { wanted = true; });
    dark.addEventListener("change", () => {
      const box = everything();
      if (!box.isEmpty()) layFloor(box);
      wanted = true;
    });
  }

  function draw() {
    requestAnimationFrame(draw);
    const width = canvas.clientWidth;
    const height = canvas.clientHeight;
    if (width === 0 || height === 0) return;
    const ratio = Math.min(window.devicePixelRatio || 1, 2);
    if (canvas.width !== Math.floor(width * ratio) || canvas.height !== Math.floor(height * ratio)) {
      renderer.setPixelRatio(ratio);
      renderer.setSize(width, height, false);
      eye.aspect = width / height;
      eye.updateProjectionMatrix();
      if (!framed) home();
      wanted = true;
    }
    if (!wanted) return;
    wanted = false;
    controls.update();
    renderer.render(scene, eye);
  }

  function start() {
    try { shown.up = localStorage.getItem("waymark-up") || "-y"; } catch (e) { /* as it is */ }
    eye.position.set(1, 1, 2);
    camera.add(frustum());
    camera.visible = false;
    body.add(wedge());
    body.visible = false;
    root.add(markers, pictures, ids, sigmas, camera, body, tracks, trail.object, new THREE.AxesHelper(0.5));
    scene.add(root);
    turnUp();
    apply();
    listen();
    showLegend();
    draw();
  }

  return {
    start, setMap, setPose, setTracks,
    clearTrail: () => { trail.clear(); wanted = true; },
    addToTrail: trail.add,
    // For who looks from outside.
    counts: () => ({markers: markers.children.length, pictures: pictures.children.length, segments: trail.segments(), camera: camera.visible, body: body.visible, tracks: tracks.children.length}),
  };
})();
