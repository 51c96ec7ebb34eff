// The connection: what comes in goes to the map and to the panels; it is opened again for ever.
"use strict";

(() => {
  const token = new URLSearchParams(location.hash.slice(1)).get("token") || "";
  const state = {link: {}, pose: {}, detections: {markers: [], pictures: []}, calibration: {}};
  let socket = null;
  let connected = false;
  let pause_ms = 500;
  let trailSequence = -1;    // of its end
  let newestMap = null;      // that is not drawn yet
  let drawnMap = null;
  let piece = 0;             // of the map, in which the camera is
  let mapDrawn_ms = -1000;
  let received = false;      // since more was asked for
  let wanted = false;  // something is to be shown with the next frame of the screen

  function clearTrail() {
    WaymarkScene.clearTrail();
    trailSequence = -1;
  }

  // What is beyond its end.
  function addToTrail(points) {
    for (const [sequence, x, y, z, source, begins] of points) {
      if (sequence <= trailSequence) continue;
      WaymarkScene.addToTrail([x, y, z], source, begins === 1);
      trailSequence = sequence;
    }
  }

  const takers = {
    hello: (m) => { document.getElementById("buttons").hidden = !m.control; },
    trail: (m) => {
      clearTrail();
      addToTrail(m.points);
    },
    link: (m) => { state.link = m; },
    pose: (m) => {
      if (WaymarkOffline.isResult()) return;
      // Another daemon, or the same one started anew.
      if (m.sequence < trailSequence) clearTrail();
      state.pose = m;
      if (m.p && m.piece !== piece) {
        piece = m.piece;
        clearTrail();
        if (drawnMap && newestMap === null) {
          newestMap = drawnMap;
          drawMap();
        }
      }
      // Whoever is not ready for each pose still sees where the camera went.
      addToTrail(m.way || []);
    },
    map: (m) => {
      // While it grows it changes ten times a second, and drawing it anew takes a while.
      const waiting = newestMap !== null;
      newestMap = m;
      if (!waiting) setTimeout(drawMap, Math.max(0, mapDrawn_ms + 1000 - performance.now()));
    },
    result: (m) => WaymarkOffline.setResult(m),
    playback: (m) => WaymarkOffline.setPlayback(m),
    health: (m) => WaymarkPanels.showHealth(m),
    detections: (m) => { state.detections = m; },
    calibration: (m) => {
      state.calibration = m;
      WaymarkPanels.showCalibration(m);
    },
    preview: (m) => WaymarkPanels.addPreview(m, show),
    control: (m) => WaymarkPanels.showControl(m.status),
    answer: (m) => {
      if (WaymarkOffline.isOffline()) return;
      document.getElementById("answer").textContent = m.ok ? (m.result || "done") : `not done: ${m.error}`;
    },
  };

  function drawMap() {
    drawnMap = newestMap;
    // Each piece has a world of its own: the one that the camera is in is shown.
    const here = (list) => list.filter((m) => m.piece === piece);
    WaymarkScene.setMap({side: drawnMap.side, markers: here(drawnMap.markers), natural: here(drawnMap.natural)});
    WaymarkPanels.showMap(newestMap);
    newestMap = null;
    mapDrawn_ms = performance.now();
  }

  function show() {
    if (wanted) return;
    wanted = true;
    requestAnimationFrame(() => {
      wanted = false;
      WaymarkPanels.showStatus(connected, WaymarkOffline.isResult() ? {alive: true} : state.link, state.pose, state.calibration);
      WaymarkPanels.showPose(state.pose);
      WaymarkPanels.showImage(state.detections, state.pose, WaymarkPanels.whyNoImage());
      WaymarkScene.setPose(state.pose);
      askForMore();
    });
  }

  // What comes is drawn before more is asked for: a slow browser gets less, and nothing piles up in it.
  function askForMore() {
    if (!connected || !received) return;
    received = false;
    socket.send("{\"command\":\"more\"}");
  }

  function connect() {
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    const query = token ? `?token=${encodeURIComponent(token)}` : "";
    socket = new WebSocket(`${scheme}://${location.host}/ws${query}`);
    socket.onopen = () => {
      connected = true;
      pause_ms = 500;
      received = true;
      show();
    };
    socket.onmessage = (event) => {
      const message = JSON.parse(event.data);
      received = true;
      if (takers[message.type]) takers[message.type](message);
      show();
    };
    socket.onclose = () => {
      connected = false;
      show();
      setTimeout(connect, pause_ms);
      pause_ms = Math.min(2 * pause_ms, 5000);
    };
  }

  for (const button of document.querySelectorAll("#buttons button")) {
    button.addEventListener("click", () => {
      if (button.dataset.ask && !window.confirm(button.dataset.ask)) return;
      document.getElementById("answer").textContent = "\u2026";
      if (connected) socket.send(JSON.stringify({command: button.dataset.command}));
    });
  }

  document.getElementById("save-calibration").href =
    "calib.yml" + (token ? `?token=${encodeURIComponent(token)}` : "");

  WaymarkOffline.start({
    send: (command) => { if (connected) socket.send(JSON.stringify(command)); },
    showPose: (pose) => {
      state.pose = pose;
      show();
    },
  });
  WaymarkScene.start();
  WaymarkPanels.start();
  show();
  connect();
})();
