// Everything beside the map: words, numbers, the image with what was found in it.
"use strict";

const WaymarkPanels = (() => {
  const byId = (id) => document.getElementById(id);
  const style = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  const history = [];          // {frames, poses} of each second
  const SECONDS = 120;
  const pixels = {width: 640, height: 480};
  const SIZES = [[320, 240], [640, 480], [800, 600], [1280, 720], [1280, 800], [1600, 1200],
                 [1920, 1080], [2592, 1944], [3840, 2160], [16384, 16384]];
  let advice = {};

  function number(value, digits, unit) {
    return Number.isFinite(value) ? value.toFixed(digits) + (unit ? " " + unit : "") : "\u2013";
  }

  function fill(list, rows) {
    list.textContent = "";
    for (const [what, value] of rows) {
      const dt = document.createElement("dt");
      const dd = document.createElement("dd");
      dt.textContent = what;
      dd.textContent = value;
      list.append(dt, dd);
    }
  }

  // In words: how it is, and why it is not better.
  function showStatus(connected, link, pose, calibration) {
    let level = "bad";
    let state = "no connection";
    let why = "to waymark-view; trying again";
    if (connected && link.fault) {
      [state, why] = ["cannot listen", link.fault];
    } else if (connected && !link.alive) {
      [state, why] = ["no daemon", "nothing comes from waymarkd: is it running, with this URL and prefix?"];
    } else if (connected && calibration.advice) {
      [level, state, why] = [calibration.enough ? "good" : "warn", "calibrating", calibration.advice];
    } else if (connected && pose.status) {
      state = pose.status;
      why = pose.reason || "";
      if (pose.status === "tracking") level = "good";
      else if (pose.status !== "no camera") level = "warn";
      if (pose.status === "bridging") why = why || "no marker gives a pose; natural features carry it";
      if (!pose.p && pose.had_pose && pose.last_pose_age_s > 0) {
        why += `; the last pose is ${number(pose.last_pose_age_s, 1, "s")} old`;
      }
    } else if (connected) {
      [level, state, why] = ["warn", "waiting", "for the first frame"];
    }
    document.body.dataset.level = level;
    // Only what is new: it is read out.
    if (byId("state").textContent !== state) byId("state").textContent = state;
    if (byId("why").textContent !== why) byId("why").textContent = why;
    byId("nothing").hidden = !(level === "bad");
    byId("nothing").textContent = `${state}: ${why}`;
  }

  function showPose(pose) {
    const rows = [["Frame", String(pose.sequence === undefined ? "\u2013" : pose.sequence)]];
    if (pose.p) {
      rows.push(["Position", pose.p.map((v) => number(v, 3)).join("  ") + " m"],
                ["Orientation", pose.q.map((v) => number(v, 3)).join("  ") + "  (w x y z)"],
                ["Known to", `${number(1000 * pose.sigma_m, 1, "mm")}, ${number(180 / Math.PI * pose.sigma_rad, 2)}\u00b0 (one sigma)`],
                ["From", `${pose.source}, ${pose.markers} markers, ${number(pose.rms_px, 2, "px")} residual`]);
    } else {
      rows.push(["Position", "no pose"], ["Why", pose.reason || "\u2013"]);
    }
    if (pose.sigma_rad === undefined && pose.p) rows[3][1] = `${number(1000 * pose.sigma_m, 1, "mm")} (one sigma)`;
    fill(byId("pose"), rows);
    showHistogram(pose.latency_histogram);
  }

  function pen(canvas) {
    const context = canvas.getContext("2d");
    context.clearRect(0, 0, canvas.width, canvas.height);
    context.font = "13px sans-serif";
    return context;
  }

  function showHistogram(histogram) {
    if (!histogram) return;
    const canvas = byId("histogram");
    const context = pen(canvas);
    const counts = histogram.counts;
    const most = Math.max(1, ...counts);
    const wide = canvas.width / counts.length;
    counts.forEach((count, i) => {
      const high = (canvas.height - 38) * count / most;
      context.fillStyle = style("--good");
      context.fillRect(i * wide + 3, canvas.height - 20 - high, wide - 6, high);
      context.fillStyle = style("--soft");
      context.textAlign = "center";
      const bound = histogram.bounds_ms[i];
      context.fillText(bound === undefined ? "more" : String(bound), (i + 0.5) * wide, canvas.height - 5);
      if (count > 0) context.fillText(String(count), (i + 0.5) * wide, canvas.height - 24 - high);
    });
    context.textAlign = "right";
    context.fillText("ms", canvas.width - 2, 12);
  }

  function showSpark() {
    const canvas = byId("spark");
    const context = pen(canvas);
    const most = Math.max(10, ...history.map((h) => h.frames));
    const at = (i) => canvas.width - (history.length - i) * canvas.width / SECONDS;
    const up = (value) => canvas.height - 2 - (canvas.height - 20) * value / most;
    context.fillStyle = style("--good");
    context.globalAlpha = 0.35;
    history.forEach((h, i) => context.fillRect(at(i), up(h.poses), canvas.width / SECONDS + 0.5, canvas.height));
    context.globalAlpha = 1;
    context.strokeStyle = style("--ink");
    context.beginPath();
    history.forEach((h, i) => context.lineTo(at(i), up(h.frames)));
    context.stroke();
    context.fillStyle = style("--soft");
    context.fillText(`${number(most, 0)} Hz`, 4, 14);
  }

  function showHealth(health) {
    if (health.version === undefined) return;
    history.push({frames: health.frame_rate_hz || 0, poses: health.pose_rate_hz || 0});
    if (history.length > SECONDS) history.shift();
    const ms = (ns) => number(1e-6 * ns, 2, "ms");
    const counters = health.counters || {};
    const lost = Object.keys(counters).filter((n) => n.startsWith("dropped.") && counters[n] > 0)
      .map((n) => `${counters[n]} ${n.slice(8)}`);
    fill(byId("rates"), [
      ["Frames", `${number(health.frame_rate_hz, 1)} a second, ${number(health.pose_rate_hz, 1)} with a pose`],
      ["Latency", `median ${ms(health.latency_median_ns)}, 99 % ${ms(health.latency_p99_ns)}, worst ${ms(health.latency_max_ns)}`],
      ["A frame takes", `median ${ms(health.processing_median_ns)}, worst ${ms(health.processing_max_ns)}`],
      ["Lost frames", lost.length > 0 ? lost.join(", ") : "none"],
      ["Deadlines missed", String(counters["deadline.missed"] || 0)],
      ["Camera", health.camera ? health.camera.state + (health.camera.reason ? ": " + health.camera.reason : "") : "\u2013"],
      ["Daemon", `waymarkd ${health.version}, up ${number(health.uptime_ns / 60e9, 1, "min")}`],
    ]);
    showLens(health.lens);
    showSpark();
    showGrown(health.grown || {});
  }

  function showLens(lens) {
    byId("lens").hidden = !lens || !(lens.width > 0);
    if (byId("lens").hidden) return;
    byId("lens-text").textContent = `Lens ${lens.state}: focal length ${number(lens.fx, 1, "px")}`;
  }

  // Those that somebody can do something about.
  function showGrown(grown) {
    const rows = Object.keys(grown).filter((name) => advice[name] && advice[name].help)
      .map((name) => [`${name} +${grown[name]}`, `${advice[name].counts}. ${advice[name].help}`]);
    byId("no-counters").hidden = rows.length > 0;
    fill(byId("counters"), rows);
  }

  function showMap(map) {
    const posed = map.markers;
    const unposed = map.unposed;
    const natural = map.natural.map((m) => ({...m, id: m.name || m.id, views: "\u2013",
      state: `natural, ${number(m.width, 3)} \u00d7 ${number(m.height, 3, "m")}`}));
    byId("map-text").textContent = posed.length + unposed.length + natural.length === 0 ? "No map yet"
      : `${map.dictionary}: ${posed.length} markers, ` +
        (natural.length > 0 ? `${natural.length} natural ones, ` : "") + `${map.keyframes} keyframes` +
        (unposed.length > 0 ? `; ${unposed.length} without a pose` : "");
    const body = byId("markers").tBodies[0];
    body.textContent = "";
    for (const m of [...posed, ...natural, ...unposed]) {
      const row = body.insertRow();
      const sigma = m.p ? (m.sigma_m > 0 ? number(1000 * m.sigma_m, 1) : "\u2013") : "";
      const state = m.piece > 0 ? `${m.state}, piece ${m.piece}` : m.state;
      for (const value of [m.id, state, m.views, sigma]) row.insertCell().textContent = String(value);
    }
  }

  // What `waymark calibrate` still needs, while it runs.
  function showCalibration(calibration) {
    byId("calibration-section").hidden = !calibration.advice;
    document.body.classList.toggle("calibrating", Boolean(calibration.advice));
    if (!calibration.advice) return;
    if (byId("advice").textContent !== calibration.advice) byId("advice").textContent = calibration.advice;
    fill(byId("calibration"), [
      ["Views", `${calibration.views} kept`],
      ["With the board", `${calibration.frames_with_board} of ${calibration.frames} frames`],
      ["Of the image", `${number(100 * calibration.covered, 0)} % has had the board in it`],
    ]);
  }

  // The newest preview whose image is there, and when it came.
  const photo = {image: null, shown: null, came_ms: -1e9};
  const FRESH_MS = 2500;     // but in a recording, which may stand still
  let drawnKey = null;
  const TIMES = 20;          // residuals are drawn so much longer

  // Its image is there later than the message, and perhaps nothing comes after that: ready is called.
  function addPreview(preview, ready) {
    if (!preview.image) {
      photo.shown = null;
      return;
    }
    const image = new Image();
    image.onload = () => {
      photo.image = image;
      photo.shown = preview;
      photo.came_ms = performance.now();
      ready();
    };
    image.src = preview.image;
  }

  function sizeImage(canvas, detections, preview) {
    if (preview) {
      [pixels.width, pixels.height] = [preview.width, preview.height];
    } else {
      for (const [x, y] of detections.markers.flatMap((m) => m.corners)) {
        const fits = SIZES.find(([w, h]) => x < w && y < h);
        if (fits && (fits[0] > pixels.width || fits[1] > pixels.height)) {
          [pixels.width, pixels.height] = fits;
        }
      }
    }
    if (canvas.width !== pixels.width || canvas.height !== pixels.height) {
      [canvas.width, canvas.height] = [pixels.width, pixels.height];
    }
  }

  function outline(context, corners) {
    context.beginPath();
    corners.forEach(([x, y]) => context.lineTo(x + 0.5, y + 0.5));
    context.closePath();
    context.stroke();
  }

  // From where the corners are to where they should be. Root mean square of the distances, pixels;
  // null where one of the two is not known.
  function drawResidual(context, m, unit) {
    if (!m.corners || !m.expected) return null;
    let sum = 0;
    context.strokeStyle = style("--bad");
    context.lineWidth = 2 * unit;
    m.corners.forEach(([x, y], i) => {
      const [dx, dy] = [m.expected[i][0] - x, m.expected[i][1] - y];
      sum += dx * dx + dy * dy;
      context.beginPath();
      context.moveTo(x + 0.5, y + 0.5);
      context.lineTo(x + 0.5 + TIMES * dx, y + 0.5 + TIMES * dy);
      context.stroke();
    });
    return Math.sqrt(sum / 4);
  }

  function drawName(context, corners, name, unit, onImage) {
    const middle = [0, 1].map((k) => corners.reduce((total, c) => total + c[k], 0) / 4);
    context.textAlign = "center";
    if (onImage) {
      context.lineWidth = 4 * unit;
      context.strokeStyle = "#000";
      context.strokeText(name, middle[0], middle[1] + 6 * unit);
    }
    context.fillStyle = onImage ? "#fff" : style("--ink");
    context.fillText(name, middle[0], middle[1] + 6 * unit);
  }

  function drawMarker(context, m, unit, onImage) {
    context.strokeStyle = m.hamming > 0 ? style("--warn") : style("--good");
    context.setLineDash(m.hamming > 0 ? [6 * unit, 4 * unit] : []);
    context.lineWidth = 2.5 * unit;
    outline(context, m.corners);
    context.setLineDash([]);
    context.fillStyle = style("--bad");  // where its top left corner is
    context.fillRect(m.corners[0][0] - 3 * unit, m.corners[0][1] - 3 * unit, 6 * unit, 6 * unit);
    const residual = drawResidual(context, m, unit);
    drawName(context, m.corners, String(m.id), unit, onImage);
    return residual;
  }

  // Where it was found in this very frame, or else where the map has it; dashed where nobody has
  // found it lately.
  function drawPicture(context, m, unit, onImage) {
    context.strokeStyle = style("--picture");
    context.lineWidth = 2.5 * unit;
    context.setLineDash(m.lately ? [] : [6 * unit, 4 * unit]);
    outline(context, m.corners || m.expected);
    context.setLineDash([]);
    const residual = drawResidual(context, m, unit);
    drawName(context, m.corners || m.expected, String(m.name || m.id), unit, onImage);
    return residual;
  }

  function drawRejected(context, squares, unit) {
    context.strokeStyle = style("--warn");
    context.lineWidth = 1.5 * unit;
    context.setLineDash([2 * unit, 3 * unit]);
    for (const corners of squares) outline(context, corners);
    context.setLineDash([]);
  }

  // Where the board has not been yet is veiled; its points in this frame are dots.
  function drawBoard(context, board, unit) {
    const [wide, high] = [context.canvas.width / board.columns, context.canvas.height / board.rows];
    context.fillStyle = style("--warn");
    context.globalAlpha = 0.4;
    board.cells.forEach((points, i) => {
      if (points > 0) return;
      context.fillRect((i % board.columns) * wide, Math.floor(i / board.columns) * high, wide, high);
    });
    context.globalAlpha = 1;
    context.fillStyle = style("--good");
    for (const [x, y] of board.points) {
      context.beginPath();
      context.arc(x + 0.5, y + 0.5, 4 * unit, 0, 2 * Math.PI);
      context.fill();
    }
  }

  function boardText(preview) {
    const board = preview.board;
    const empty = board.cells.filter((points) => points === 0).length;
    return `Frame ${preview.sequence}: ${board.points.length} points of the board (dots)` +
      (empty > 0 ? "; where it is veiled, the board has not been yet" : "; the board has been everywhere");
  }

  // The live image where one comes, with what was found in that very frame; else the newest frame's
  // markers alone.
  function showImage(detections, pose, images) {
    const fresh = WaymarkOffline.isOffline() || performance.now() - photo.came_ms < FRESH_MS;
    const preview = fresh ? photo.shown : null;
    // Drawn once: it comes a few times a second, poses much more often.
    const found = preview ? (preview.pictures || []).filter((m) => m.corners).length : 0;  // comes late
    const key = preview ? `image ${preview.sequence} ${found}` : `frame ${detections.sequence} ${images}`;
    if (key === drawnKey) return;
    drawnKey = key;
    const canvas = byId("image");
    sizeImage(canvas, detections, preview);
    const context = pen(canvas);
    const unit = canvas.width / 640;
    context.font = `bold ${16 * unit}px sans-serif`;
    if (preview) context.drawImage(photo.image, 0, 0, canvas.width, canvas.height);
    canvas.dataset.image = preview ? String(preview.sequence) : "";
    if (preview && preview.board) {
      drawBoard(context, preview.board, unit);
      byId("image-text").textContent = boardText(preview);
      return;
    }
    if (preview) drawRejected(context, preview.rejected, unit);
    const {markers = [], pictures = []} = preview || detections;
    const drawn = (m, draw) => {
      const residual = draw(context, m, unit, Boolean(preview));
      return {residual, text: (m.name || m.id) + (residual === null ? "" : ` ${number(residual, 2)}`)};
    };
    const natural = pictures.map((m) => drawn(m, drawPicture));
    const squares = markers.map((m) => drawn(m, drawMarker));
    const listed = (list) => ` (${list.map((m) => m.text).join(", ")})`;
    const sequence = preview ? preview.sequence : detections.sequence;
    let text = sequence === undefined ? "Nothing yet" : `Frame ${sequence}: ${markers.length} markers`;
    if (squares.length > 0) text += listed(squares);
    if (natural.length > 0) {
      text += `; natural markers${listed(natural)}`;
      if (pictures.some((m) => !m.lately)) text += ", dashed: not found within a second, there by the map";
    }
    if ([...squares, ...natural].some((m) => m.residual !== null)) text += "; beside each id its residual in pixels, drawn 20 times longer";
    if (preview && preview.rejected.length > 0) {
      text += `; ${preview.rejected.length} dark ${preview.rejected.length === 1 ? "square that is no marker" : "squares that are no markers"} (dotted)`;
    }
    if (!preview) text += `. ${images}`;
    byId("image-text").textContent = text;
  }

  // Why there is no image.
  let images = "No image comes: nobody answers on the daemon's control socket";
  const whyNoImage = () => images;

  function showControl(status) {
    images = status ? "The image is being asked for" : "No image comes: nobody answers on the daemon's control socket";
    if (!status || !status.map) return;
    const recorder = status.recorder;
    const recording = recorder && recorder.state === "recording";
    for (const button of document.querySelectorAll("#buttons [data-command^=record]")) {
      button.disabled = !recorder || (button.dataset.command === "record-start") === recording;
    }
    if (recorder) byId("answer").dataset.recorder = recorder.state;
  }

  async function start() {
    try {
      const reply = await fetch("advice.json");
      advice = await reply.json();
    } catch (e) {
      advice = {};
    }
  }

  return {start, showStatus, showPose, showHealth, showMap, showImage, showCalibration, addPreview, whyNoImage, showControl};
})();
