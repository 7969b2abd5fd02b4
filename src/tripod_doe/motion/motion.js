"use strict";
// Moves a tripod joint: painted on 2-D canvases, far parts first; reads its poses from the element "motion-data".
(() => {
  const points = JSON.parse(document.getElementById("motion-data").textContent);
  for (const point of points) {
    for (const [name, text] of Object.entries(point.arrays)) {
      const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
      point.arrays[name] = new Float32Array(bytes.buffer);
    }
  }
  const element = (id) => document.getElementById(id);
  const samples = points[0].count;  // the first point tells the time
  const state = { at: 0, playing: false, yaw: -0.6, pitch: 0.35, zoom: 1, view: "oblique", last: 0 };
  // two points have one scale of forces, loads and pressures
  const most = (read) => Math.max(...points.map((point) => largest(read(point.arrays))));
  const mostLoad = most((arrays) => arrays.needle.filter((_, i) => i % 5 === 3)) || 1;
  const mostForce = most((arrays) => arrays.normal) || 1;
  const mostThrust = Math.max(most((arrays) => arrays.thrust.map(Math.abs)), most((arrays) => arrays.part.map(Math.abs))) || 1;
  const pressures = [-most((arrays) => arrays.pressure.map((p) => -p)), most((arrays) => arrays.pressure)];
  // the point that is painted: its data, its canvases, and its sample at this time
  let data, size, needles, arrays, side, scene, ring, plot, at;
  function use(which) {
    data = points[which];
    ({ sizes: size, needles, arrays } = data);
    side = size.torque < 0 ? -1 : 1;
    [scene, ring, plot] = ["scene", "ring", "plot"].map((name) => element(`${name}-${which}`));
    at = Math.floor((state.at * data.count) / samples);
  }
  let colour = {}, mixed = [];  // from cold to hot, in hundredths

  function largest(values) {
    let most = -Infinity;
    for (const v of values) if (v > most) most = v;
    return Number.isFinite(most) ? most : 0;
  }
  function readColours() {
    const style = getComputedStyle(document.documentElement);
    for (const name of ["ink", "paper", "faint", "line", "steel", "hot", "cold", "force", "slide"])
      colour[name] = style.getPropertyValue("--" + name).trim();
    const [hot, cold] = [colour.hot, colour.cold].map((hex) => [1, 3, 5].map((at) => parseInt(hex.slice(at, at + 2), 16)));
    for (let n = 0; n <= 100; n++) mixed[n] = `rgb(${hot.map((c, at) => Math.round(cold[at] + (n / 100) * (c - cold[at]))).join()})`;
  }

  // vectors
  const add = (a, b, s = 1) => [a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]];
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const unit = (a) => { const l = Math.hypot(...a) || 1; return [a[0] / l, a[1] / l, a[2] / l]; };
  const vector = (name, i, k = 0, per = 3) => { const o = (i * (per / 3) + k) * 3; return [arrays[name][o], arrays[name][o + 1], arrays[name][o + 2]]; };

  // the frame that is seen: turned back with the housing where asked
  let turn = [1, 0];
  const seen = (p) => [turn[0] * p[0] + turn[1] * p[1], -turn[1] * p[0] + turn[0] * p[1], p[2]];

  function camera(width, height) {
    let { yaw, pitch } = state;
    const span = 2.35 * (size.pitch_radius + size.groove_radius);
    const close = state.view === "trunnion";
    const scale = (Math.min(width, height) / (close ? 2.6 * size.roller_radius : span)) * state.zoom;
    // right, up, towards the viewer; yaw 0 and pitch 0 look along the input axis
    const cy = Math.cos(yaw), sy = Math.sin(yaw), cp = Math.cos(pitch), sp = Math.sin(pitch);
    const right = [cy, 0, -sy], near = [sy * cp, -sp, cy * cp], up = cross(near, right);
    const target = close ? seen(vector("rollers", at, 0, 9)) : [0, 0, 0];
    return (p) => {
      const q = add(seen(p), target, -1);
      return [width / 2 + scale * dot(q, right), height / 2 - scale * dot(q, up), dot(q, near), scale];
    };
  }

  function fit(canvas) {
    const ratio = window.devicePixelRatio || 1, w = canvas.clientWidth, h = canvas.clientHeight;
    if (canvas.width !== Math.round(w * ratio) || canvas.height !== Math.round(h * ratio)) {
      canvas.width = Math.round(w * ratio);
      canvas.height = Math.round(h * ratio);
    }
    const g = canvas.getContext("2d");
    g.setTransform(ratio, 0, 0, ratio, 0, 0);
    g.clearRect(0, 0, w, h);
    g.font = "12px system-ui, sans-serif";
    return [g, w, h];
  }

  function circle(centre, axis, radius, count = 40) {
    const first = unit(cross(axis, Math.abs(axis[2]) < 0.9 ? [0, 0, 1] : [1, 0, 0])), second = cross(unit(axis), first);
    const points = [];
    for (let i = 0; i < count; i++) {
      const a = (2 * Math.PI * i) / count;
      points.push(add(add(centre, first, radius * Math.cos(a)), second, radius * Math.sin(a)));
    }
    return points;
  }
  function path(g, points, close = true) {
    g.beginPath();
    points.forEach((p, i) => (i ? g.lineTo(p[0], p[1]) : g.moveTo(p[0], p[1])));
    if (close) g.closePath();
  }
  function hull(points) {
    const sorted = points.slice().sort((a, b) => a[0] - b[0] || a[1] - b[1]);
    const half = (list) => {
      const out = [];
      for (const p of list) {
        while (out.length > 1 && (out.at(-1)[0] - out.at(-2)[0]) * (p[1] - out.at(-2)[1]) <= (out.at(-1)[1] - out.at(-2)[1]) * (p[0] - out.at(-2)[0])) out.pop();
        out.push(p);
      }
      return out.slice(0, -1);
    };
    return half(sorted).concat(half(sorted.reverse()));
  }
  function mix(share) {
    return mixed[Math.round(100 * Math.max(0, Math.min(1, share)))];
  }

  // needles of trunnion k: centre and half axis, in space
  function needleAt(i, k, j, frame, magnify) {
    const o = ((i * 3 + k) * needles + j) * 5, n = arrays.needle;
    const angle = n[o], place = n[o + 1] * magnify, skew = n[o + 2] * magnify;
    const normal = add(frame.load.map((x) => x * Math.cos(angle)), frame.across, Math.sin(angle));
    const centre = add(add(frame.spider, frame.trunnion, size.ring_distance + place), normal, size.bearing_radius);
    const axis = add(frame.trunnion.map((x) => x * Math.cos(skew)), cross(normal, frame.trunnion), Math.sin(skew));
    return { centre, axis, load: n[o + 3], stop: n[o + 4] };
  }
  function frameOf(i, k) {
    const trunnion = vector("trunnions", i, k, 9), phi = arrays.phi[i] + (2 * Math.PI * k) / 3;
    const flank = [side * Math.sin(phi), -side * Math.cos(phi), 0];
    const load = unit(add(flank, trunnion, -dot(flank, trunnion)));
    return { trunnion, load, across: cross(trunnion, load), spider: vector("spider", i) };
  }

  function arrowLength(force) {
    const kind = element("arrows").value, most = 0.8 * size.pitch_radius;
    if (kind === "none") return 0;
    const share = Math.abs(force) / mostForce;
    return most * (kind === "root" ? Math.sqrt(share) : share);
  }
  function drawArrow(g, from, to, stroke) {
    const dx = to[0] - from[0], dy = to[1] - from[1], length = Math.hypot(dx, dy);
    if (length < 1.5) return;
    const head = Math.min(9, 0.45 * length), ux = dx / length, uy = dy / length;
    g.strokeStyle = g.fillStyle = stroke;
    g.lineWidth = 2.4;
    g.beginPath();
    g.moveTo(from[0], from[1]);
    g.lineTo(to[0] - ux * head * 0.8, to[1] - uy * head * 0.8);
    g.stroke();
    path(g, [to, [to[0] - ux * head - uy * head * 0.45, to[1] - uy * head + ux * head * 0.45], [to[0] - ux * head + uy * head * 0.45, to[1] - uy * head - ux * head * 0.45]]);
    g.fill();
  }

  function paintScene() {
    const [g, w, h] = fit(scene);
    const i = at, phi = arrays.phi[i], solid = Number(element("solid").value), magnify = Number(element("magnify").value);
    const following = element("follow").checked || state.view === "trunnion";
    turn = following ? [Math.cos(phi), Math.sin(phi)] : [1, 0];
    const see = camera(w, h), jobs = [];
    const put = (depth, paint) => jobs.push([depth, paint]);
    const stroke = (a, b, width, style, alpha = 1) => {
      const p = see(a), q = see(b);
      put((p[2] + q[2]) / 2, () => {
        g.lineCap = "butt";
        g.globalAlpha = alpha;
        g.strokeStyle = style;
        g.lineWidth = Math.max(width * p[3], 0.8);
        path(g, [p, q], false);
        g.stroke();
        g.globalAlpha = 1;
      });
    };
    // housing: three grooves
    const long = 1.15 * size.roller_radius + size.pitch_radius * Math.tan(size.joint_angle);
    for (let k = 0; k < 3; k++) {
      const a = phi + (2 * Math.PI * k) / 3, middle = [size.pitch_radius * Math.cos(a), size.pitch_radius * Math.sin(a), 0];
      const ends = [-long, long].map((z) => circle([middle[0], middle[1], z], [0, 0, 1], size.groove_radius).map(see));
      put(-1e6, () => {
        g.globalAlpha = 0.06 + 0.2 * solid;
        g.fillStyle = colour.faint;
        path(g, hull(ends[0].concat(ends[1])));
        g.fill();
        g.globalAlpha = 0.5;
        g.strokeStyle = colour.faint;
        g.lineWidth = 1;
        for (const end of ends) { path(g, end); g.stroke(); }
        g.globalAlpha = 1;
      });
    }
    const spider = vector("spider", i), shaft = [Math.sin(size.joint_angle), 0, Math.cos(size.joint_angle)];
    stroke(spider, add(spider, shaft, 2.6 * size.pitch_radius), 1.5 * size.trunnion_radius, colour.steel, 0.3 + 0.7 * solid); // it may hide a bearing
    const reach = (size.needle_length + size.needle_axial_clearance) / 2;
    for (let k = 0; k < 3; k++) {
      const frame = frameOf(i, k), roller = vector("rollers", i, k, 9), contact = vector("contacts", i, k, 9);
      const end = add(spider, frame.trunnion, size.ring_distance + reach);
      stroke(spider, end, 2 * size.trunnion_radius, colour.steel);
      const cap = circle(end, frame.trunnion, size.trunnion_radius).map(see);
      put(see(end)[2] + 0.01, () => {
        g.fillStyle = colour.steel;
        g.strokeStyle = colour.ink;
        g.lineWidth = 0.6;
        path(g, cap); g.fill(); g.stroke();
      });
      for (let j = 0; j < needles; j++) {
        const n = needleAt(i, k, j, frame, magnify), half = size.needle_length / 2;
        const style = Number.isNaN(n.load) ? colour.faint : mix(Math.sqrt(Math.max(n.load, 0) / mostLoad));
        stroke(add(n.centre, n.axis, -half), add(n.centre, n.axis, half), 1.8 * size.needle_radius, style);
      }
      const true_axis = vector("axes", i, k, 9), axis = unit(add(frame.trunnion, add(true_axis, frame.trunnion, -1), magnify));
      const half = Math.min(size.roller_width / 2, size.roller_radius), face = Math.sqrt(Math.max(size.roller_radius ** 2 - half ** 2, 0));
      const faces = [-half, half].map((x) => circle(add(roller, axis, x), axis, face).map(see));
      const bores = [-half, half].map((x) => circle(add(roller, axis, x), axis, size.bore_radius).map(see));
      const body = hull(faces[0].concat(faces[1], circle(roller, axis, size.roller_radius).map(see)));
      put(see(roller)[2] - size.roller_radius, () => {
        g.globalAlpha = 0.15 + 0.6 * solid;
        g.fillStyle = colour.line;
        path(g, body); g.fill();
        g.globalAlpha = 1;
      });
      put(see(roller)[2] + size.roller_radius, () => {
        g.strokeStyle = colour.ink;
        g.lineWidth = 1;
        path(g, body); g.stroke();
        g.globalAlpha = 0.55;
        for (const p of faces.concat(bores)) { path(g, p); g.stroke(); }
        g.globalAlpha = 1;
      });
      const touch = add(roller, contact, size.roller_radius), force = arrays.normal[3 * i + k], drag = arrays.friction[3 * i + k];
      put(1e6, () => {
        const p = see(touch), share = (arrays.pressure[3 * i + k] - pressures[0]) / (pressures[1] - pressures[0] || 1);
        g.fillStyle = mix(share);
        g.beginPath();
        g.arc(p[0], p[1], 4, 0, 7);
        g.fill();
        drawArrow(g, p, see(add(touch, contact, -arrowLength(force))), colour.force);
        drawArrow(g, p, see(add(touch, [0, 0, 1], Math.sign(drag) * arrowLength(drag))), colour.slide);
      });
    }
    const thrust = arrays.thrust[i];
    put(1e6 + 1, () => drawArrow(g, see([0, 0, 0]), see([0, 0, Math.sign(thrust) * arrowLength(thrust)]), colour.hot));
    jobs.sort((a, b) => a[0] - b[0]);
    for (const [, paint] of jobs) paint();
    legend(g, w, h, see([0, 0, 0])[3], magnify);
  }

  function legend(g, w, h, scale, magnify) {
    g.fillStyle = colour.ink;
    const lines = [`rotation ${((180 * arrays.phi[at]) / Math.PI).toFixed(1)} deg`];
    lines.push(magnify === 1 ? "tilt and skew true to scale" : `tilt, skew and shift of needles x ${magnify}`);
    lines.forEach((text, n) => g.fillText(text, 10, 18 + 16 * n));
    if (element("arrows").value === "none") return;
    const round = (x) => { const p = 10 ** Math.floor(Math.log10(x)); return [5, 2, 1].map((f) => f * p).find((v) => v <= x) || p; };
    [[round(mostForce), "normal force", colour.force], [round(mostForce / 20), "friction along the axis", colour.slide], [round(mostForce / 20), "thrust on the housing", colour.hot]].forEach(([force, text, style], n) => {
      const y = h - 44 + 16 * n, length = arrowLength(force) * scale;
      drawArrow(g, [10, y - 4], [10 + length, y - 4], style);
      g.fillStyle = colour.ink;
      g.fillText(`${force} N ${text}`, 18 + length, y);
    });
  }

  function paintRing() {
    const [g, w, h] = fit(ring), i = at, magnify = Number(element("magnify").value);
    const left = 34, right = w - 8, top = 20, gap = 20, height = (h - top - 24 - 2 * gap) / 3;
    const reach = (size.needle_length + size.needle_axial_clearance) / 2, high = reach * 1.12;
    const x = (angle) => left + ((angle + Math.PI) / (2 * Math.PI)) * (right - left);
    g.fillStyle = colour.ink;
    const known = !Number.isNaN(arrays.needle[3]);
    g.fillText(known ? `needles unrolled, coloured by load up to ${mostLoad.toPrecision(3)} N` : "needles unrolled; this model has no single needles", left, 13);
    for (let k = 0; k < 3; k++) {
      const above = top + k * (height + gap), y = (place) => above + height / 2 - (place / high) * (height / 2);
      g.strokeStyle = colour.faint;
      g.lineWidth = 1;
      for (const stop of [-reach, reach]) { path(g, [[left, y(stop)], [right, y(stop)]], false); g.stroke(); }
      g.setLineDash([3, 3]);
      path(g, [[x(0), above], [x(0), above + height]], false); g.stroke();
      g.setLineDash([]);
      g.fillStyle = colour.ink;
      g.fillText(String(k + 1), 10, above + height / 2 + 4);
      for (let j = 0; j < needles; j++) {
        const o = ((i * 3 + k) * needles + j) * 5, n = arrays.needle;
        let angle = n[o] % (2 * Math.PI);
        if (angle > Math.PI) angle -= 2 * Math.PI;
        if (angle < -Math.PI) angle += 2 * Math.PI;
        const skew = n[o + 2] * magnify, half = size.needle_length / 2, place = n[o + 1] * magnify;
        const aside = (Math.sin(skew) * half) / size.bearing_radius, along = Math.cos(skew) * half, load = n[o + 3];
        g.strokeStyle = Number.isNaN(load) ? colour.faint : mix(Math.sqrt(Math.max(load, 0) / mostLoad));
        g.lineWidth = Math.max(2, (1.5 * size.needle_radius / (2 * Math.PI * size.bearing_radius)) * (right - left));
        g.lineCap = "round";
        // outward is up; counterclockwise about the outward normal of the trunnion, seen from outside, is to the left
        path(g, [[x(angle - aside), y(place + along)], [x(angle + aside), y(place - along)]], false);
        g.stroke();
        const stop = n[o + 4];
        if (Math.abs(stop) > 0.02 * mostLoad) {
          g.fillStyle = colour.slide;
          g.beginPath();
          g.arc(x(angle), y(Math.sign(stop) * reach), 4, 0, 7);
          g.fill();
        }
      }
    }
    g.fillStyle = colour.ink;
    g.fillText("-180", left, h - 6);
    g.fillText("0: loaded side", x(0) - 36, h - 6);
    g.fillText("180 deg", right - 44, h - 6);
  }

  const shades = ["#0b6bcb", "#7c3aed", "#0f8a5f", "#b45309", "#be185d", "#64748b"];
  function paintPlot() {
    const [g, w, h] = fit(plot), left = 46, right = w - 10, top = 22, bottom = h - 22;
    const key = [plot.width, plot.height, colour.ink].join();
    if (data.drawn !== key) {  // the curves stand still: they are painted once for each size and theme
      data.drawn = key;
      data.curves = document.createElement("canvas");
      [data.curves.width, data.curves.height] = [plot.width, plot.height];
      const pen = data.curves.getContext("2d");
      pen.setTransform(plot.width / w, 0, 0, plot.width / w, 0, 0);
      pen.font = g.font;
      paintCurves(pen, left, right, top, bottom, h);
    }
    g.drawImage(data.curves, 0, 0, w, h);
    g.strokeStyle = colour.hot;
    g.lineWidth = 1.5;
    const now = left + (at / data.count) * (right - left);
    path(g, [[now, top], [now, bottom]], false); g.stroke();
  }
  function paintCurves(g, left, right, top, bottom, h) {
    const count = data.parts.length;
    const x = (i) => left + (i / data.count) * (right - left), y = (v) => (top + bottom) / 2 - (v / mostThrust) * 0.5 * (bottom - top);
    g.strokeStyle = colour.line;
    g.lineWidth = 1;
    path(g, [[left, y(0)], [right, y(0)]], false); g.stroke();
    const curve = (read, style, width) => {
      const line = [];
      for (let i = 0; i <= data.count; i++) line.push([x(i), y(read(i % data.count))]);
      g.strokeStyle = style;
      g.lineWidth = width;
      path(g, line, false); g.stroke();
    };
    data.parts.forEach((name, n) => curve((i) => arrays.part[i * count + n], shades[n % shades.length], 1));
    curve((i) => arrays.thrust[i], colour.ink, 2.2);
    g.fillStyle = colour.ink;
    g.fillText(`${mostThrust.toPrecision(3)} N`, 2, top + 4);
    g.fillText("0", 32, y(0) + 4);
    g.fillText("thrust", left, 13);
    let begin = left + 46;
    data.parts.forEach((name, n) => {
      g.fillStyle = shades[n % shades.length];
      const text = name.replace("_", " ");
      if (begin + g.measureText(text).width < right) g.fillText(text, begin, 13);
      begin += g.measureText(text).width + 12;
    });
    g.fillStyle = colour.ink;
    for (let q = 0; q <= 4; q++) g.fillText(String(90 * q), x((data.count * q) / 4) - (q === 4 ? 22 : 8), h - 6);
  }

  function numbers() {
    const i = at, three = (name) => [0, 1, 2].map((k) => arrays[name][3 * i + k].toFixed(0)).join(", ");
    return `thrust ${arrays.thrust[i].toFixed(2)} N; normal forces ${three("normal")} N; pressures ${three("pressure")} MPa; orders 1 to 6: ${data.orders.slice(1, 7).map((a) => a.toPrecision(3)).join(", ")} N`;
  }
  function paint() {
    const begin = performance.now();
    points.forEach((_, which) => {
      use(which);
      paintScene();
      paintRing();
      paintPlot();
      element(`numbers-${which}`).textContent = numbers();
    });
    document.body.dataset.milliseconds = (performance.now() - begin).toFixed(2);
  }
  let asked = false;
  function ask() {
    if (!asked) { asked = true; requestAnimationFrame(tick); }
  }
  let fraction = 0;
  function tick(now) {
    asked = false;
    if (state.playing) {
      // a frame may have begun before the key that plays
      fraction += (Math.max(0, now - state.last) / 6000) * Number(element("pace").value) * samples;
      state.at = (state.at + Math.floor(fraction)) % samples;
      fraction -= Math.floor(fraction);
      document.body.dataset.frames = String(Number(document.body.dataset.frames || 0) + 1);
    }
    state.last = now;
    paint();
    if (state.playing) ask();
  }
  function step(by) {
    state.at = (((state.at + by) % samples) + samples) % samples;
    ask();
  }
  function play() {
    state.playing = !state.playing;
    state.last = performance.now();
    element("play").textContent = state.playing ? "Pause" : "Play";
    element("play").setAttribute("aria-pressed", String(state.playing));
    ask();
  }
  const views = { along: [0, 0], side: [Math.PI / 2, 0], oblique: [-0.6, 0.35], trunnion: [0, 0] };
  function look(name) {
    state.view = name;
    [state.yaw, state.pitch] = views[name];
    state.zoom = 1;
    element("view").value = name;
    ask();
  }
  element("play").addEventListener("click", play);
  element("back").addEventListener("click", () => step(-1));
  element("ahead").addEventListener("click", () => step(1));
  element("view").addEventListener("change", (event) => look(event.target.value));
  for (const id of ["follow", "magnify", "arrows", "solid", "pace"]) element(id).addEventListener("input", ask);
  document.addEventListener("keydown", (event) => {
    if (["SELECT", "INPUT", "BUTTON", "SUMMARY"].includes(event.target.tagName) || event.ctrlKey || event.metaKey || event.altKey) return;
    const name = Object.keys(views)[Number(event.key) - 1];
    if (event.key === " ") play();
    else if (event.key === "ArrowLeft") step(-1);
    else if (event.key === "ArrowRight") step(1);
    else if (event.key === "ArrowUp" || event.key === "+") { state.zoom *= 1.1; ask(); }
    else if (event.key === "ArrowDown" || event.key === "-") { state.zoom /= 1.1; ask(); }
    else if (name) look(name);
    else return;
    event.preventDefault();
  });
  points.forEach((_, which) => {
    const own = element(`scene-${which}`), curve = element(`plot-${which}`);
    own.addEventListener("pointermove", (event) => {
      if (!event.buttons) return;
      state.yaw += 0.008 * event.movementX;
      state.pitch = Math.max(-1.5, Math.min(1.5, state.pitch + 0.008 * event.movementY));
      ask();
    });
    own.addEventListener("wheel", (event) => { state.zoom *= Math.exp(-0.001 * event.deltaY); event.preventDefault(); ask(); }, { passive: false });
    const seek = (event) => {
      if (event.type === "pointermove" && !event.buttons) return;
      const share = (event.offsetX - 46) / (curve.clientWidth - 56);
      state.at = Math.max(0, Math.min(samples - 1, Math.round(share * samples)));
      ask();
    };
    curve.addEventListener("pointerdown", seek);
    curve.addEventListener("pointermove", seek);
  });
  window.addEventListener("resize", ask);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { readColours(); ask(); });
  readColours();
  paint();
})();
