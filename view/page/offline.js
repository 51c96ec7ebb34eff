// What is over already: results of a run, and recordings with a time line.
"use strict";

const WaymarkOffline = (() => {
  const byId = (id) => document.getElementById(id);
  const style = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  const TRACKS = {live: {colour: 0x009e73, text: "live"}, final: {colour: 0xcc79a7, text: "against the final map"}};
  const TRUTH = {colour: 0x888888, text: "truth"};
  const at = {t: 0, begin: 0, end: 1, playing: false, last_ms: 0};
  let result = null;
  let frames = [];             // of the final track, by time
  let playback = null;         // of a recording: what the server said last
  let send = () => {};
  let showPose = () => {};
  let sliding = false;
  let asked_ms = 0;

  function startTimeline() {
    byId("timeline").hidden = false;
    document.body.classList.add("timed");
  }

  function showTime(t, begin, end, playing) {
    const slider = byId("time");
    slider.max = String(Math.max(end - begin, 0.001));
    if (!sliding) slider.value = String(t - begin);
    byId("now").textContent = `${(t - begin).toFixed(1)} of ${(end - begin).toFixed(1)} s`;
    slider.setAttribute("aria-valuetext", byId("now").textContent);
    byId("play").textContent = playing ? "Pause" : "Play";
    byId("play").setAttribute("aria-pressed", String(playing));
  }

  // The frame at a time: the last one that is not after it.
  function frameAt(t) {
    let [low, high] = [0, frames.length];
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (frames[middle][0] <= t) low = middle; else high = middle;
    }
    return low;
  }

  function poseOf(row, i) {
    if (row.length === 2) return {status: "lost", reason: row[1], sequence: i, had_pose: false};
    return {status: "tracking", reason: "", sequence: i, p: row.slice(1, 4), q: row.slice(4, 8),
            piece: row[8], sigma_m: row[9], markers: row[10], rms_px: row[11], source: row[12].replace("_", " ")};
  }

  function drawCurves() {
    const canvas = byId("errors");
    const context = canvas.getContext("2d");
    context.clearRect(0, 0, canvas.width, canvas.height);
    context.font = "13px sans-serif";
    const curves = result.errors.length > 0
      ? result.errors.map((e) => ({name: e.name, points: e.points}))
      : result.tracks.map((track) => ({name: track.name, points: track.poses.filter((r) => r.length > 2).map((r) => [r[0], r[9]])}));
    const most = Math.max(1e-6, ...curves.flatMap((c) => c.points.map((p) => p[1]))) * 1000;
    const x = (t) => 6 + (canvas.width - 12) * (t - at.begin) / Math.max(1e-6, at.end - at.begin);
    const y = (mm) => canvas.height - 6 - (canvas.height - 40) * mm / most;
    for (const {name, points} of curves) {
      context.strokeStyle = "#" + TRACKS[name].colour.toString(16).padStart(6, "0");
      context.lineWidth = 1.5;
      context.beginPath();
      let last = null;
      for (const [t, m] of points) {
        if (last === null || t - last > 0.5) context.moveTo(x(t), y(1000 * m));
        else context.lineTo(x(t), y(1000 * m));
        last = t;
      }
      context.stroke();
    }
    context.strokeStyle = style("--bad");
    context.beginPath();
    context.moveTo(x(at.t), 22);
    context.lineTo(x(at.t), canvas.height);
    context.stroke();
    context.fillStyle = style("--soft");
    context.fillText(`${most.toFixed(1)} mm`, 6, 14);
  }

  function showAt(t) {
    at.t = Math.min(Math.max(t, at.begin), at.end);
    showTime(at.t, at.begin, at.end, at.playing);
    const i = frameAt(at.t);
    showPose(poseOf(frames[i], i));
    drawCurves();
  }

  function run(now_ms) {
    if (!at.playing) return;
    const t = at.t + 1e-3 * Math.min(now_ms - at.last_ms, 250);
    at.last_ms = now_ms;
    if (t >= at.end) at.playing = false;
    showAt(t);
    requestAnimationFrame(run);
  }

  function setResult(message) {
    result = message;
    document.title = `Waymark: ${result.name}`;
    for (const id of ["camera-section", "rates-section", "counters-section"]) byId(id).hidden = true;
    byId("offline").hidden = false;
    const tracks = result.tracks.map((track) => ({...TRACKS[track.name],
      points: track.poses.filter((r) => r.length > 2).map((r) => [r[0], r.slice(1, 4), r[8]])}));
    if (result.truth.length > 0) {
      tracks.unshift({...TRUTH, points: result.truth.map((r) => [r[0], r.slice(1, 4), r[4]])});
    }
    const counts = {};
    frames = result.tracks[result.tracks.length - 1].poses;
    for (const row of frames) if (row.length > 2) counts[row[8]] = (counts[row[8]] || 0) + 1;
    const piece = Number(Object.keys(counts).sort((a, b) => counts[b] - counts[a])[0] || 0);
    WaymarkScene.setTracks(tracks.map((track) => ({...track, points: track.points.filter((p) => p[2] === piece)})));
    const localized = frames.filter((r) => r.length > 2).length;
    let text = `${result.name}: ${frames.length} frames, ${localized} with a pose`;
    if (result.verdict) {
      const advice = result.verdict.advice || [];
      text += `. ${result.verdict.grade}: ${result.verdict.text}` + (advice.length > 0 ? `; ${advice.join("; ")}` : "");
    }
    byId("offline-text").textContent = text;
    byId("errors-text").textContent = result.errors.length > 0
      ? "Position error against the truth over time, live (green) and against the final map (purple)"
      : "How well each position is known (one sigma), live (green) and against the final map (purple)";
    const list = byId("offline-errors");
    list.textContent = "";
    for (const e of result.errors) {
      const [dt, dd] = [document.createElement("dt"), document.createElement("dd")];
      dt.textContent = `ATE, ${TRACKS[e.name].text}`;
      dd.textContent = `rms ${(1000 * e.rms_m).toFixed(2)} mm, median ${(1000 * e.median_m).toFixed(2)}, worst ${(1000 * e.max_m).toFixed(2)}`;
      list.append(dt, dd);
    }
    if (frames.length === 0) return;
    [at.begin, at.end] = [frames[0][0], frames[frames.length - 1][0]];
    startTimeline();
    showAt(at.begin);
  }

  function setPlayback(message) {
    if (message.name === undefined) return;
    if (playback === null) {
      document.title = `Waymark: ${message.name}`;
      startTimeline();
    }
    playback = message;
    showTime(message.now_s, 0, message.length_s, message.playing);
  }

  function playOrPause() {
    if (playback) return send({command: playback.playing ? "pause" : "play"});
    if (!result) return undefined;
    at.playing = !at.playing;
    if (at.playing && at.t >= at.end) at.t = at.begin;
    at.last_ms = performance.now();
    showAt(at.t);
    if (at.playing) requestAnimationFrame(run);
    return undefined;
  }

  function start(parts) {
    [send, showPose] = [parts.send, parts.showPose];
    byId("play").addEventListener("click", playOrPause);
    byId("time").addEventListener("input", () => {
      const value = Number(byId("time").value);
      if (playback) {
        // A few a second: each is read from the file anew.
        sliding = true;
        if (performance.now() - asked_ms > 200) {
          asked_ms = performance.now();
          send({command: "seek", to_s: value});
        }
      } else if (result) {
        showAt(at.begin + value);
      }
    });
    byId("time").addEventListener("change", () => {
      sliding = false;
      if (playback) send({command: "seek", to_s: Number(byId("time").value)});
    });
    document.addEventListener("keydown", (event) => {
      if (event.key !== " " || event.target.tagName === "BUTTON" || byId("timeline").hidden) return;
      event.preventDefault();
      playOrPause();
    });
  }

  return {start, setResult, setPlayback, isResult: () => result !== null, isOffline: () => result !== null || playback !== null,
          time: () => (playback ? playback.now_s : at.t - at.begin)};
})();
