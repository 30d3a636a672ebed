"use strict";
// Draws a run: maps that are shifted, turned and zoomed, a slider over time, curves of errors and residuals.
// Places are floats of 32 bits about an origin of each map; stamps are seconds since the start of the run.
(() => {
  const data = JSON.parse(document.getElementById("data").textContent);
  const $ = (id) => document.getElementById(id);
  const el = (tag, text, into) => { const e = document.createElement(tag); if (text !== undefined) e.textContent = text; if (into) into.append(e); return e; };
  const bytes = (s) => Uint8Array.from(atob(s), (c) => c.charCodeAt(0));
  const f32 = (s) => new Float32Array(bytes(s).buffer);
  const i32 = (s) => new Int32Array(bytes(s).buffer);
  const i8 = (s) => new Int8Array(bytes(s).buffer);
  const unit = data.counts ? "poses" : "s";

  // --- what is drawn ------------------------------------------------------------------------------------------------
  for (const part of data.parts) {
    for (const way of part.ways) {
      way.t = f32(way.t); way.p = f32(way.p); way.f = i8(way.f); way.ct = f32(way.ct); way.c = f32(way.c);
      way.truth = way.truth ? f32(way.truth) : null;
    }
    const m = part.marks;
    for (const k of ["p", "c", "truth", "second"]) m[k] = f32(m[k]);
    m.doubted = i8(m.doubted);
    part.weakest = f32(part.weakest);
    part.seen.who = i32(part.seen.who); part.seen.t = f32(part.seen.t);
    part.wayOf = new Map(part.ways.map((w) => [w.robot, w]));
    part.rows = []; part.rejected = [];
  }
  for (const kind of ["rows", "rejected"]) for (const rows of data[kind]) {
    rows.t = f32(rows.t); rows.size = f32(rows.size); rows.to = i32(rows.to);
    if (data.parts[rows.part]) data.parts[rows.part][kind].push(rows);
  }
  const ways = data.parts.flatMap((part) => part.ways);
  const begin = Math.min(...ways.map((w) => w.t[0])), end = Math.max(...ways.map((w) => w.t[w.t.length - 1]));
  const span = end > begin ? end - begin : 1;
  const has = {
    truth: ways.some((w) => w.truth) || data.parts.some((p) => p.marks.truth.some(Number.isFinite)),
    marks: data.parts.some((p) => p.marks.names.length),
    rows: data.rows.some((r) => r.to.some((t) => t >= 0)),
    rejected: data.rejected.length > 0,
    doubted: data.parts.some((p) => p.marks.doubted.some((d) => d)),
    seen: data.parts.some((p) => p.seen.t.length),
    weakest: data.parts.some((p) => p.weakest.length),
    second: data.parts.some((p) => p.marks.second.some(Number.isFinite)),
    regions: data.parts.some((p) => p.marks.c.some((x) => x > 0) || p.ways.some((w) => w.c.some((x) => x > 0))),
  };

  // --- what the reader has chosen -----------------------------------------------------------------------------------
  const state = { time: end, window: span / 60, colour: "robot", times: {}, on: {} };
  const layers = [
    ["ways", "robots", true, true], ["marks", "landmarks", has.marks, true], ["names", "names", true, true],
    ["regions", "95 % regions", has.regions, true], ["rows", "sightings", has.rows, true],
    ["seen", "robots seen", has.seen, true], ["truth", "truth", has.truth, true],
    ["second", "second places", has.second, true], ["rejected", "wrong sightings", has.rejected, true],
    ["doubted", "names in doubt", has.doubted, true],
    ["weakest", "weakest direction" + ([...new Set(data.parts.filter((p) => p.weakest.length).map((p) => p.weakest_times))].map((k) => k > 1 ? " \u00d7" + k : "").join(",")), has.weakest, true],
  ];
  for (const [key, word, there, on] of layers) {
    state.on[key] = there && on;
    if (!there) continue;
    const label = el("label", undefined, $("layers")), box = el("input", undefined, label);
    box.type = "checkbox"; box.checked = on; box.id = "layer-" + key; label.append(word);
    box.addEventListener("change", () => { state.on[key] = box.checked; draw(); });
  }
  const choice = (word, id, options, chosen, change) => {
    const label = el("label", word + " ", $("layers")), select = el("select", undefined, label);
    select.id = id;
    for (const [value, text] of options) { const o = el("option", text, select); o.value = value; o.selected = value === chosen; }
    select.addEventListener("change", () => { change(select.value); draw(); });
  };
  if (has.regions) {
    const common = Math.max(...data.parts.map((p) => p.times));
    state.times = common;
    const sizes = [...new Set([1, 2, 5, 10, 20, 50, 100, common])].sort((a, b) => a - b);
    choice("regions", "times", sizes.map((k) => [k, "\u00d7" + k]), common, (v) => { state.times = +v; });
  }
  const colourings = [["robot", "robot"]];
  if (ways.some((w) => w.truth)) colourings.push(["error", "error"]);
  if (has.rows) colourings.push(["residual", "residual"]);
  if (colourings.length > 1) choice("colour by", "colour", colourings, "robot", (v) => { state.colour = v; });
  const scale = el("span", "", $("layers")); scale.id = "scale";

  const nice = (x) => { const p = 10 ** Math.floor(Math.log10(x)); const m = x / p; return p * (m < 1.5 ? 1 : m < 3.5 ? 2 : m < 7.5 ? 5 : 10); };
  const short = (x) => Math.abs(x) >= 1e5 || (x !== 0 && Math.abs(x) < 1e-3) ? x.toExponential(1) : String(+x.toPrecision(3));
  const last = (share) => (data.counts ? Math.max(1, nice(span / share)) : nice(span / share));
  state.window = last(60);
  for (const length of new Set([300, 60, 10].map(last))) {
    const o = el("option", "the last " + (data.counts && length === 1 ? "pose" : short(length) + " " + unit), $("window"));
    o.value = length; o.selected = length === state.window;
  }
  el("option", "all so far", $("window")).value = "Infinity";
  $("window").addEventListener("change", () => { state.window = +$("window").value; draw(); });

  // --- time ---------------------------------------------------------------------------------------------------------
  const upper = (t, x) => { let a = 0, b = t.length; while (a < b) { const m = (a + b) >> 1; if (t[m] <= x) a = m + 1; else b = m; } return a; };
  const goTo = (t) => { state.time = Math.min(end, Math.max(begin, t)); $("slider").value = Math.round((1000 * (state.time - begin)) / span); clock(); draw(); };
  const clock = () => { $("clock").textContent = (data.counts ? "pose " : "") + short3(state.time) + (data.counts ? "" : " s"); };
  const decimals = data.counts ? 0 : Math.max(0, Math.min(12, Math.ceil(3 - Math.log10(span))));
  const short3 = (x) => x.toFixed(decimals);
  $("slider").addEventListener("input", () => { state.time = begin + (span * $("slider").value) / 1000; clock(); draw(); });
  let playing = null;
  const stop = () => { playing = null; $("play").textContent = "\u25b6"; };
  $("play").addEventListener("click", () => {
    if (playing) return stop();
    if (state.time >= end) goTo(begin);
    playing = { at: performance.now(), from: state.time }; $("play").textContent = "\u23f8";
    const step = (now) => {
      if (!playing) return;
      goTo(playing.from + (span * Math.max(0, now - playing.at)) / 30000);
      if (state.time >= end) stop(); else requestAnimationFrame(step);
    };
    requestAnimationFrame(step);
  });

  // --- colours ------------------------------------------------------------------------------------------------------
  let css = {};
  const colours = () => { const s = getComputedStyle(document.documentElement); for (const n of ["page", "ink", "quiet", "line", "mark", "truth", "grid", "bad", "weak"]) css[n] = s.getPropertyValue("--" + n).trim(); };
  const robotColour = (r) => data.colours[r % data.colours.length];
  const heat = (x) => { // blue, through grey-violet, to red: x from 0 to 1
    const c = Math.max(0, Math.min(1, x));
    return `rgb(${Math.round(40 + 200 * c)},${Math.round(120 - 60 * Math.abs(2 * c - 0.7))},${Math.round(210 - 180 * c)})`;
  };
  let worstError = 0;
  const errors = [];
  for (const w of ways) if (w.truth) for (let i = 0; i < w.t.length; i++) { const e = Math.hypot(w.p[3 * i] - w.truth[3 * i], w.p[3 * i + 1] - w.truth[3 * i + 1], w.p[3 * i + 2] - w.truth[3 * i + 2]); if (Number.isFinite(e)) errors.push(e); }
  if (errors.length) { errors.sort((a, b) => a - b); worstError = errors[Math.floor(0.98 * (errors.length - 1))] || 1e-9; }

  // --- one map ------------------------------------------------------------------------------------------------------
  const maps = data.parts.map((part, number) => new MapView(part, number));

  function MapView(part, number) {
    const figure = el("figure", undefined, $("maps"));
    el("figcaption", part.title + " \u00b7 " + part.frame, figure);
    const canvas = el("canvas", undefined, figure), g = canvas.getContext("2d");
    canvas.id = "map-" + (number + 1); canvas.tabIndex = 0; canvas.setAttribute("role", "img"); canvas.setAttribute("aria-label", "map, " + part.title);
    const views = el("div", undefined, figure); views.className = "views";
    for (const [word, yaw, pitch] of [["fit"], ["top", 0, 90], ["front", 0, 0], ["side", 90, 0], ["turned", 35, 30]]) {
      if (!part.spatial && word !== "fit" && word !== "top" && word !== "turned") continue;
      const b = el("button", word, views); b.type = "button"; b.dataset.view = word;
      b.addEventListener("click", () => { if (yaw !== undefined) look(yaw, pitch); touched = false; fit(); draw(); });
    }
    const cam = { c: [0, 0, 0], scale: 1, r: [1, 0, 0], u: [0, 1, 0], yaw: 0, pitch: 90 };
    const look = (yaw, pitch) => {
      cam.yaw = yaw; cam.pitch = Math.max(-90, Math.min(90, pitch));
      const a = (yaw * Math.PI) / 180, e = (cam.pitch * Math.PI) / 180;
      cam.r = [Math.cos(a), Math.sin(a), 0];
      cam.u = [-Math.sin(a) * Math.sin(e), Math.cos(a) * Math.sin(e), Math.cos(e)];
    };
    let w = 0, h = 0, touched = false; // whether the reader has moved it
    const along = (v, p, i) => v[0] * (p[3 * i] - cam.c[0]) + v[1] * (p[3 * i + 1] - cam.c[1]) + v[2] * (p[3 * i + 2] - cam.c[2]);
    const X = (p, i) => w / 2 + cam.scale * along(cam.r, p, i), Y = (p, i) => h / 2 - cam.scale * along(cam.u, p, i);
    const clouds = () => [part.marks.p, part.marks.second, ...part.ways.map((x) => x.p)];

    const box = () => { // what a view takes up across and upwards [m]
      const ends = [Infinity, -Infinity, Infinity, -Infinity];
      for (const p of clouds()) for (let i = 0; i < p.length / 3; i++) {
        const a = along(cam.r, p, i), b = along(cam.u, p, i);
        if (!Number.isFinite(a)) continue;
        ends[0] = Math.min(ends[0], a); ends[1] = Math.max(ends[1], a); ends[2] = Math.min(ends[2], b); ends[3] = Math.max(ends[3], b);
      }
      return Number.isFinite(ends[0]) ? ends : [-1, 1, -1, 1];
    };
    const fit = () => {
      cam.c = [0, 0, 0];
      const [x0, x1, y0, y1] = box();
      cam.c = [0, 1, 2].map((k) => ((x0 + x1) / 2) * cam.r[k] + ((y0 + y1) / 2) * cam.u[k]);
      cam.scale = Math.min((w - 80) / Math.max(x1 - x0, 1e-9), (h - 80) / Math.max(y1 - y0, 1e-9));
      if (!(cam.scale > 0) || !Number.isFinite(cam.scale)) cam.scale = 1;
    };
    const shape = () => { // as high as the map needs at this width, and no higher than the window
      const [x0, x1, y0, y1] = box(), wide = canvas.clientWidth - 80;
      canvas.style.height = Math.round(Math.max(260, Math.min(0.7 * window.innerHeight, 620, 80 + (wide * (y1 - y0)) / Math.max(x1 - x0, 1e-9)))) + "px";
    };

    this.size = () => {
      if (!touched) shape();
      const r = canvas.getBoundingClientRect(), dots = window.devicePixelRatio || 1, old = [w, h];
      if (!r.width || !r.height) return;
      w = r.width; h = r.height; canvas.width = Math.round(w * dots); canvas.height = Math.round(h * dots);
      g.setTransform(dots, 0, 0, dots, 0, 0);
      if (!touched) fit(); else cam.scale *= Math.min(w / old[0], h / old[1]);
    };

    const segment = (way, t) => { const i = Math.min(Math.max(upper(way.t, t) - 1, 0), way.t.length - 1), j = Math.min(i + 1, way.t.length - 1); const d = way.t[j] - way.t[i]; return [i, j, d > 0 ? Math.max(0, Math.min(1, (t - way.t[i]) / d)) : 0]; };
    const at = (way, t) => { const [i, j, s] = segment(way, t); return [X(way.p, i) * (1 - s) + X(way.p, j) * s, Y(way.p, i) * (1 - s) + Y(way.p, j) * s]; };
    const line = (p, from, to) => { let down = false; g.beginPath(); for (let i = from; i < to; i++) { const x = X(p, i), y = Y(p, i); if (!Number.isFinite(x)) { down = false; continue; } if (down) g.lineTo(x, y); else { g.moveTo(x, y); down = true; } } g.stroke(); };
    const ellipse = (p, i, c, j, times) => { // the shadow of a region on the plane of the screen
      const q = (a, b) => { const C = (m, n) => c[6 * j + [[0, 1, 2], [1, 3, 4], [2, 4, 5]][m][n]]; let s = 0; for (let m = 0; m < 3; m++) for (let n = 0; n < 3; n++) s += a[m] * C(m, n) * b[n]; return s; };
      const xx = q(cam.r, cam.r), xy = q(cam.r, cam.u), yy = q(cam.u, cam.u), mean = (xx + yy) / 2, d = Math.hypot((xx - yy) / 2, xy);
      const k = Math.sqrt(part.quantile) * times * cam.scale, [x, y] = Array.isArray(p) ? p : [X(p, i), Y(p, i)];
      const big = k * Math.sqrt(Math.max(mean + d, 0)), small = k * Math.sqrt(Math.max(mean - d, 0));
      if (!(big > 0.3) || big > 20 * (w + h)) return;
      g.beginPath(); g.ellipse(x, y, big, small, -0.5 * Math.atan2(2 * xy, xx - yy), 0, 2 * Math.PI); if (big < 0.4 * Math.min(w, h)) g.fill(); g.stroke(); // what is larger would hide the map
    };

    this.draw = () => {
      if (!w) return;
      g.fillStyle = css.page; g.fillRect(0, 0, w, h); g.lineJoin = g.lineCap = "round";
      grid(); if (state.on.rows) rows(); if (state.on.rejected) rejected(); if (state.on.seen) seen(); if (state.on.truth) truth(); if (state.on.ways) paths();
      if (state.on.regions) regions(); if (state.on.weakest) weakest(); if (state.on.second) second(); if (state.on.marks) marks(); if (state.on.doubted) doubted(); if (state.on.marks && state.on.truth) trueMarks(); if (state.on.ways) robots();
      if (state.on.names) names(); scaleBar();
    };
    const grid = () => {
      g.lineWidth = 1.2; const o = part.origin.map((x) => -x), length = 42 / cam.scale;
      for (const [axis, colour, word] of [[0, "#d04a3a", "x"], [1, "#2f9e58", "y"], [2, "#3a6fd0", "z"]]) {
        const e = [...o]; e[axis] += length; const x0 = X(o, 0), y0 = Y(o, 0), x1 = X(e, 0), y1 = Y(e, 0);
        if (Math.hypot(x1 - x0, y1 - y0) < 4) continue;
        g.strokeStyle = g.fillStyle = colour; g.beginPath(); g.moveTo(x0, y0); g.lineTo(x1, y1); g.stroke(); g.font = "11px sans-serif"; g.textAlign = "center"; g.textBaseline = "middle"; g.fillText(word, x1 + (x1 - x0) * 0.2, y1 + (y1 - y0) * 0.2);
      }
    };
    const within = (t) => [upper(t, state.time - state.window), upper(t, state.time)];
    const rows = () => {
      for (const r of part.rows) {
        const way = part.wayOf.get(r.robot); if (!way) continue;
        const [a, b] = within(r.t), step = Math.max(1, Math.ceil((b - a) / 3000));
        g.lineWidth = 0.8; g.globalAlpha = b - a > 300 ? 0.35 : 0.6; g.strokeStyle = robotColour(r.robot);
        for (let i = a; i < b; i += step) {
          if (r.to[i] < 0) continue;
          if (state.colour === "residual") g.strokeStyle = heat(Math.log10(Math.max(r.size[i], 0.3) / 0.3) / 1.3);
          const [x, y] = at(way, r.t[i]); g.beginPath(); g.moveTo(x, y); g.lineTo(X(part.marks.p, r.to[i]), Y(part.marks.p, r.to[i])); g.stroke();
        }
      }
      g.globalAlpha = 1;
    };
    const rejected = () => { // to where the landmark or the robot is that they name
      g.strokeStyle = css.bad; g.lineWidth = 1.1; g.setLineDash([2, 3]);
      for (const r of part.rejected) {
        const way = part.wayOf.get(r.robot); if (!way) continue;
        const [a, b] = within(r.t), step = Math.max(1, Math.ceil((b - a) / 3000));
        for (let i = a; i < b; i += step) {
          const other = r.to[i] < 0 ? part.wayOf.get(-1 - r.to[i]) : null; if (r.to[i] < 0 && !other) continue;
          const [x, y] = at(way, r.t[i]), [u, v] = other ? at(other, r.t[i]) : [X(part.marks.p, r.to[i]), Y(part.marks.p, r.to[i])];
          g.beginPath(); g.moveTo(x, y); g.lineTo(u, v); g.stroke();
        }
      }
      g.setLineDash([]);
    };
    const doubted = () => { const m = part.marks; g.strokeStyle = css.bad; g.lineWidth = 2; for (let i = 0; i < m.names.length; i++) if (m.doubted[i]) { g.beginPath(); g.arc(X(m.p, i), Y(m.p, i), 10, 0, 2 * Math.PI); g.stroke(); } };
    const seen = () => {
      const s = part.seen; g.strokeStyle = css.ink; g.lineWidth = 0.9; g.setLineDash([5, 3]); g.globalAlpha = 0.6;
      const last = s.t.length / 2; let a = 0, b = 0; // rising in the later stamp of the two
      const later = (i) => Math.max(s.t[2 * i], s.t[2 * i + 1]);
      const first = (x) => { let lo = 0, hi = last; while (lo < hi) { const m = (lo + hi) >> 1; if (later(m) <= x) lo = m + 1; else hi = m; } return lo; };
      a = first(state.time - state.window); b = first(state.time);
      for (let i = a, step = Math.max(1, Math.ceil((b - a) / 2000)); i < b; i += step) {
        const one = part.wayOf.get(s.who[2 * i]), two = part.wayOf.get(s.who[2 * i + 1]); if (!one || !two) continue;
        const [x, y] = at(one, s.t[2 * i]), [u, v] = at(two, s.t[2 * i + 1]); g.beginPath(); g.moveTo(x, y); g.lineTo(u, v); g.stroke();
      }
      g.setLineDash([]); g.globalAlpha = 1;
    };
    const truth = () => {
      g.strokeStyle = css.truth; g.lineWidth = 0.9; g.setLineDash([5, 3]); g.globalAlpha = 0.75;
      for (const way of part.ways) if (way.truth) line(way.truth, 0, upper(way.t, state.time));
      g.setLineDash([]); g.globalAlpha = 1;
    };
    const trueMarks = () => {
      const t = part.marks.truth; g.strokeStyle = css.truth; g.lineWidth = 1;
      for (let i = 0; i < t.length / 3; i++) if (Number.isFinite(t[3 * i])) diamond(X(t, i), Y(t, i), 7, false);
    };
    const paths = () => {
      for (const way of part.ways) {
        const now = upper(way.t, state.time); g.lineWidth = 1.4; g.strokeStyle = robotColour(way.robot);
        if (now < way.t.length) { g.globalAlpha = 0.22; line(way.p, Math.max(now - 1, 0), way.t.length); g.globalAlpha = 1; }
        if (state.colour !== "error" || !way.truth) { line(way.p, 0, now); continue; }
        g.lineWidth = 2.2; const leap = Math.max(1, Math.floor(now / 1500));
        for (let i = 0; i + 1 < now; i += leap) {
          const e = Math.hypot(way.p[3 * i] - way.truth[3 * i], way.p[3 * i + 1] - way.truth[3 * i + 1], way.p[3 * i + 2] - way.truth[3 * i + 2]);
          g.strokeStyle = Number.isFinite(e) ? heat(e / worstError) : css.quiet; line(way.p, i, Math.min(i + leap + 1, now));
        }
      }
    };
    const regions = () => {
      const times = state.times, m = part.marks;
      g.lineWidth = 0.9; g.strokeStyle = css.mark; g.fillStyle = css.mark + "22";
      if (state.on.marks) for (let i = 0; i < m.names.length; i++) ellipse(m.p, i, m.c, i, times);
      if (!state.on.ways) return;
      for (const way of part.ways) {
        if (!way.ct.length) continue;
        const j = Math.min(Math.max(upper(way.ct, state.time) - 1, 0), way.ct.length - 1);
        if (state.time < way.t[0]) continue;
        g.strokeStyle = robotColour(way.robot); g.fillStyle = robotColour(way.robot) + "22"; ellipse(at(way, state.time), 0, way.c, j, times);
      }
    };
    const diamond = (x, y, s, full) => { g.beginPath(); g.moveTo(x, y - s); g.lineTo(x + s, y); g.lineTo(x, y + s); g.lineTo(x - s, y); g.closePath(); if (full) g.fill(); else g.stroke(); };
    const marks = () => { const m = part.marks, s = m.names.length > 60 ? 3 : 4.5; g.fillStyle = css.mark; for (let i = 0; i < m.names.length; i++) diamond(X(m.p, i), Y(m.p, i), s, true); };
    const weakest = () => { // one sigma to either side of what the map knows least
      g.strokeStyle = css.weak; g.lineWidth = 1.6;
      for (let i = 0; i < part.weakest.length / 6; i++) line(part.weakest, 2 * i, 2 * i + 2);
    };
    const second = () => {
      const m = part.marks; g.strokeStyle = css.mark; g.lineWidth = 1.1;
      for (let i = 0; i < m.names.length; i++) {
        if (!Number.isFinite(m.second[3 * i])) continue;
        const x = X(m.second, i), y = Y(m.second, i); g.setLineDash([2, 3]); g.beginPath(); g.moveTo(X(m.p, i), Y(m.p, i)); g.lineTo(x, y); g.stroke(); diamond(x, y, 5.5, false); g.setLineDash([]);
      }
    };
    const robots = () => {
      for (const way of part.ways) {
        if (state.time < way.t[0]) continue;
        const [i, j, s] = segment(way, state.time), [x, y] = at(way, state.time), k = s < 0.5 ? i : j;
        const f = [0, 1, 2].map((n) => way.f[3 * k + n] / 127), dx = cam.r[0] * f[0] + cam.r[1] * f[1] + cam.r[2] * f[2], dy = -(cam.u[0] * f[0] + cam.u[1] * f[1] + cam.u[2] * f[2]);
        g.fillStyle = robotColour(way.robot); g.strokeStyle = css.page; g.lineWidth = 1.2; g.beginPath();
        g.moveTo(x + 11 * dx, y + 11 * dy); g.lineTo(x - 6 * dx - 6 * dy, y - 6 * dy + 6 * dx); g.lineTo(x - 6 * dx + 6 * dy, y - 6 * dy - 6 * dx); g.closePath(); g.fill(); g.stroke();
      }
    };
    const names = () => {
      const taken = []; g.font = "12px sans-serif"; g.textAlign = "left"; g.textBaseline = "middle";
      const label = (text, x, y, colour) => {
        if (x < -20 || y < 0 || x > w || y > h) return;
        const shown = text.length > 24 ? text.slice(0, 22) + "\u2026" : text, box = [x + 8, y - 15, x + 10 + g.measureText(shown).width, y - 1];
        if (box[2] > w || taken.some((o) => box[0] < o[2] && box[2] > o[0] && box[1] < o[3] && box[3] > o[1])) return;
        taken.push(box); g.lineWidth = 3; g.strokeStyle = css.page; g.lineJoin = "round"; g.strokeText(shown, x + 9, y - 8); g.fillStyle = colour; g.fillText(shown, x + 9, y - 8);
      };
      if (state.on.ways) for (const way of part.ways) if (state.time >= way.t[0]) label(data.robots[way.robot], ...at(way, state.time), robotColour(way.robot));
      if (state.on.marks) for (let i = 0; i < part.marks.names.length; i++) label(part.marks.names[i], X(part.marks.p, i), Y(part.marks.p, i), css.mark);
    };
    const scaleBar = () => {
      const metres = nice(90 / cam.scale), px = metres * cam.scale, y = h - 14;
      g.strokeStyle = g.fillStyle = css.ink; g.lineWidth = 1.4; g.beginPath(); g.moveTo(12, y - 4); g.lineTo(12, y); g.lineTo(12 + px, y); g.lineTo(12 + px, y - 4); g.stroke();
      g.font = "12px sans-serif"; g.textAlign = "left"; g.textBaseline = "bottom"; g.fillText(short(metres) + " m", 14, y - 4);
    };

    // fingers and mice: one shifts (or turns, in space), two shift and zoom, the wheel zooms
    const down = new Map(); let moved = 0;
    const shift = (dx, dy) => { touched = true; for (let k = 0; k < 3; k++) cam.c[k] += (-dx * cam.r[k] + dy * cam.u[k]) / cam.scale; };
    const zoom = (factor, x, y) => { shift(w / 2 - x, h / 2 - y); cam.scale *= factor; shift(x - w / 2, y - h / 2); };
    const place = (e) => { const r = canvas.getBoundingClientRect(); return [e.clientX - r.left, e.clientY - r.top]; };
    canvas.addEventListener("pointerdown", (e) => { canvas.setPointerCapture(e.pointerId); down.set(e.pointerId, place(e)); if (down.size === 1) moved = 0; });
    canvas.addEventListener("pointermove", (e) => {
      const now = place(e), was = down.get(e.pointerId);
      if (!was) { if (e.pointerType === "mouse") say(...now); return; }
      const [dx, dy] = [now[0] - was[0], now[1] - was[1]]; moved += Math.abs(dx) + Math.abs(dy);
      if (down.size === 1) { if (turns(e)) { touched = true; look(cam.yaw - 0.4 * dx, cam.pitch + 0.4 * dy); } else shift(dx, dy); }
      else {
        const other = [...down].find(([id]) => id !== e.pointerId)[1], before = Math.hypot(was[0] - other[0], was[1] - other[1]), after = Math.hypot(now[0] - other[0], now[1] - other[1]);
        shift(dx / 2, dy / 2); if (before > 5) zoom(after / before, (now[0] + other[0]) / 2, (now[1] + other[1]) / 2);
      }
      down.set(e.pointerId, now); draw();
    });
    const turns = (e) => (part.spatial || cam.pitch < 90) && !e.shiftKey && e.buttons !== 2 && e.buttons !== 4;
    for (const kind of ["pointerup", "pointercancel"]) canvas.addEventListener(kind, (e) => { down.delete(e.pointerId); if (kind === "pointerup" && moved < 6) say(...place(e)); });
    canvas.addEventListener("contextmenu", (e) => e.preventDefault());
    canvas.addEventListener("wheel", (e) => { e.preventDefault(); zoom(Math.exp(-0.0015 * e.deltaY * (e.deltaMode ? 30 : 1)), ...place(e)); draw(); }, { passive: false });
    canvas.addEventListener("dblclick", () => { touched = false; fit(); draw(); });
    canvas.addEventListener("keydown", (e) => {
      const way = { ArrowLeft: [40, 0], ArrowRight: [-40, 0], ArrowUp: [0, 40], ArrowDown: [0, -40] }[e.key];
      if (way) shift(...way); else if (e.key === "+" || e.key === "=") zoom(1.25, w / 2, h / 2); else if (e.key === "-") zoom(0.8, w / 2, h / 2); else if (e.key === "0") { touched = false; fit(); } else return;
      e.preventDefault(); draw();
    });

    // what is under the finger, in words
    const say = (x, y) => {
      const m = part.marks; let best = 14, found = "";
      const near = (a, b, words) => { const d = Math.hypot(a - x, b - y); if (d < best) { best = d; found = words(); } };
      const where = (p, i) => "(" + [0, 1, 2].slice(0, part.spatial || m.p.some((v, n) => n % 3 === 2 && Math.abs(v - m.p[2]) > 1e-9) ? 3 : 2).map((k) => (p[3 * i + k] + part.origin[k]).toFixed(3)).join(", ") + ") m";
      const sd = (c, i) => [0, 3, 5].map((k) => Math.sqrt(Math.max(c[6 * i + k], 0))).filter((s, k) => k < 2 || s > 0).map((s) => s.toPrecision(2)).join(", ");
      if (state.on.marks) for (let i = 0; i < m.names.length; i++) near(X(m.p, i), Y(m.p, i), () => {
        const off = Number.isFinite(m.truth[3 * i]) ? "; " + Math.hypot(...[0, 1, 2].map((k) => m.p[3 * i + k] - m.truth[3 * i + k]).filter(Number.isFinite)).toFixed(3) + " m from its truth" : "";
        const n = part.rows.reduce((s, r) => s + r.to.reduce((k, t) => k + (t === i), 0), 0);
        return "landmark " + m.names[i] + " at " + where(m.p, i) + ", sigma " + sd(m.c, i) + " m" + off + (n ? "; seen " + n + " times in what is drawn" : "") + (m.doubted[i] ? "; some name of it is not to be believed" : "");
      });
      if (state.on.ways) for (const way of part.ways) { if (state.time < way.t[0]) continue; const [u, v] = at(way, state.time), i = segment(way, state.time)[0]; near(u, v, () => "robot " + data.robots[way.robot] + " at " + where(way.p, i) + (way.truth && Number.isFinite(way.truth[3 * i]) ? ", " + Math.hypot(...[0, 1, 2].map((k) => way.p[3 * i + k] - way.truth[3 * i + k])).toFixed(3) + " m from its truth" : "")); }
      if (!found && cam.pitch === 90) { const a = (x - w / 2) / cam.scale, b = (h / 2 - y) / cam.scale; found = [0, 1].map((k) => ["x ", "y "][k] + (cam.c[k] + a * cam.r[k] + b * cam.u[k] + part.origin[k]).toFixed(2)).join(", ") + " m"; }
      $("info").textContent = found;
    };
    if (part.spatial) look(35, 30); else look(0, 90);
  }

  // --- curves over time ---------------------------------------------------------------------------------------------
  function chart(canvas, series, log, word) {
    const g = canvas.getContext("2d"), left = 54, bottom = 26, top = 8, right = 10; let w = 0, h = 0;
    const x = (t) => left + ((w - left - right) * (t - begin)) / span;
    canvas.addEventListener("click", (e) => { const r = canvas.getBoundingClientRect(); goTo(begin + (span * (e.clientX - r.left - left)) / (w - left - right)); });
    return {
      size() { const r = canvas.getBoundingClientRect(), dots = window.devicePixelRatio || 1; if (!r.width) return; w = r.width; h = r.height; canvas.width = Math.round(w * dots); canvas.height = Math.round(h * dots); g.setTransform(dots, 0, 0, dots, 0, 0); },
      draw() {
        if (!w) return;
        const shown = series(); let most = 0;
        for (const s of shown) for (const v of s.y) if (v > most) most = v;
        const floor = 0.03, high = log ? Math.max(most, 10) * 1.3 : Math.max(most * 1.05, 1e-9);
        const y = (v) => log ? h - bottom - ((h - bottom - top) * Math.log(Math.max(v, floor) / floor)) / Math.log(high / floor) : h - bottom - ((h - bottom - top) * v) / high;
        g.fillStyle = css.page; g.fillRect(0, 0, w, h); g.font = "11px sans-serif"; g.lineWidth = 1; g.strokeStyle = css.grid; g.fillStyle = css.quiet;
        const ticks = []; if (log) for (let v = 0.1; v < high; v *= 10) ticks.push(v); else for (let v = 0, s = nice(high / 4); v < high; v += s) ticks.push(v);
        g.textAlign = "right"; g.textBaseline = "middle";
        for (const v of ticks) { g.beginPath(); g.moveTo(left, y(v)); g.lineTo(w - right, y(v)); g.stroke(); g.fillText(short(v), left - 6, y(v)); }
        g.textAlign = "center"; g.textBaseline = "top"; const s = nice(span / (w < 500 ? 3 : 7));
        for (let v = Math.ceil(begin / s) * s; v <= end; v += s) { g.beginPath(); g.moveTo(x(v), top); g.lineTo(x(v), h - bottom); g.stroke(); g.fillText(short(v) + " " + unit, Math.min(Math.max(x(v), left + 16), w - 24), h - bottom + 6); }
        if (log) for (const v of [1, 3]) { g.strokeStyle = v === 1 ? css.ink : css.quiet; g.setLineDash(v === 1 ? [] : [4, 3]); g.beginPath(); g.moveTo(left, y(v)); g.lineTo(w - right, y(v)); g.stroke(); }
        g.setLineDash([]); g.save(); g.translate(11, (h - bottom) / 2); g.rotate(-Math.PI / 2); g.textAlign = "center"; g.fillStyle = css.quiet; g.fillText(word, 0, 0); g.restore();
        const dot = Math.max(1.3, Math.min(4, 130 / Math.sqrt(shown.reduce((n, q) => n + q.x.length, 1))));
        for (const q of shown) {
          g.fillStyle = g.strokeStyle = q.colour; g.globalAlpha = log ? 0.65 : 1; g.lineWidth = 1.1;
          if (log) for (let i = 0; i < q.x.length; i++) g.fillRect(x(q.x[i]) - dot / 2, y(q.y[i]) - dot / 2, dot, dot);
          else { let pen = false; g.beginPath(); for (let i = 0; i < q.x.length; i++) { if (!Number.isFinite(q.y[i])) { pen = false; continue; } if (pen) g.lineTo(x(q.x[i]), y(q.y[i])); else g.moveTo(x(q.x[i]), y(q.y[i])); pen = true; } g.stroke(); }
        }
        g.globalAlpha = 1; g.strokeStyle = css.ink; g.lineWidth = 1; g.beginPath(); g.moveTo(x(state.time), top); g.lineTo(x(state.time), h - bottom); g.stroke();
      },
    };
  }
  const charts = [];
  if (errors.length) {
    $("errors").hidden = false;
    const lines = ways.filter((w) => w.truth).map((w) => ({ colour: robotColour(w.robot), x: w.t, y: w.t.map((_, i) => Math.hypot(w.p[3 * i] - w.truth[3 * i], w.p[3 * i + 1] - w.truth[3 * i + 1], w.p[3 * i + 2] - w.truth[3 * i + 2])) }));
    charts.push(chart($("errorchart"), () => lines, false, "distance [m]"));
  }
  if (data.rows.length) {
    $("residuals").hidden = false;
    const sources = [...new Set(data.rows.map((r) => r.source))], most = (s) => data.rows.filter((r) => r.source === s && r.to.some((t) => t >= 0)).length;
    sources.sort((a, b) => most(b) - most(a));
    for (const s of sources) el("option", s, $("sensor")).value = s;
    $("sensor").addEventListener("change", draw);
    charts.push(chart($("residualchart"), () => data.rows.filter((r) => r.source === $("sensor").value).map((r) => ({ colour: robotColour(r.robot), x: r.t, y: r.size })), true, "size [sigma]"));
  }
  data.robots.slice(0, 24).forEach((name, r) => { const s = el("span", name, $("legend")); s.className = "robot"; s.style.setProperty("--own", robotColour(r)); });

  // --- drawing ------------------------------------------------------------------------------------------------------
  let asked = false;
  function draw() { if (!asked) { asked = true; requestAnimationFrame(drawNow); } }
  function drawNow() {
    asked = false;
    const from = { error: ["0", short(worstError) + " m from the truth, or more"], residual: ["0.3", "6 sigma left, or more"] }[state.colour];
    $("scale").textContent = from ? from[0] + " \u2013 " + from[1] : "";
    $("scale").style.backgroundImage = from ? "linear-gradient(to right," + [0, 0.25, 0.5, 0.75, 1].map(heat).join(",") + ")" : "none";
    for (const m of maps) m.draw();
    for (const c of charts) c.draw();
  }
  const resize = () => { colours(); for (const m of [...maps, ...charts]) m.size(); drawNow(); };
  window.addEventListener("resize", resize);
  window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", resize);
  window.addEventListener("beforeprint", () => { document.documentElement.classList.add("print"); for (const d of document.querySelectorAll("details")) d.open = true; resize(); });
  window.addEventListener("afterprint", () => { document.documentElement.classList.remove("print"); resize(); });
  clock(); resize();
})();
