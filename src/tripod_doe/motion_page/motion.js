// Moves tripod joints: painted on 2-D canvases, far parts first; reads poses from the element "motion-data".
(() => {
  const element = (id) => document.getElementById(id);
  const points = JSON.parse(element("motion-data").textContent);
  for (const point of points) {
    for (const [name, text] of Object.entries(point.arrays)) {
      const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
      point.arrays[name] = new Float32Array(bytes.buffer);
    }
  }
  const samples = points[0].count;  // the first point gives the time
  const state = { at: 0, playing: false, yaw: -0.6, pitch: 0.35, zoom: 1, view: "oblique", last: 0, frames: 0, written: 0 };
  const setting = {};  // the controls, read when they change
  // two points have one scale of forces, loads and pressures
  const largest = (values) => values.reduce((most, v) => (v > most ? v : most), 0);
  const most = (read) => Math.max(...points.map((point) => largest(read(point.arrays, point)))) || 1;
  const mostLoad = most((arrays) => arrays.needle.filter((_, i) => i % 5 === 3));
  const mostForce = most((arrays) => arrays.normal), mostSlip = most((arrays) => arrays.slip), mostPressure = most((arrays) => arrays.pressure);
  const mostThrust = Math.max(most((arrays) => arrays.thrust.map(Math.abs)), most((arrays) => arrays.part.map(Math.abs)));
  const mostOrder = most((_, point) => point.orders.slice(1));
  const SHADES = 16, TURN = (2 * Math.PI) / 3;
  let colour = {}, shades = [], tones = [];  // shades from cold to hot, tones of the parts

  // the point that is painted: its data, its canvases, and its poses at this time
  let data, size, needles, arrays, pose, side, canvases;
  function use(which) {
    data = points[which];
    ({ sizes: size, needles, arrays } = data);
    side = size.torque < 0 ? -1 : 1;
    canvases = data.canvases ||= Object.fromEntries(["scene", "ring", "plot", "orders", "cursor", "numbers"].map((name) => [name, element(`${name}-${which}`)]));
    pose = between(data, (state.at * data.count) / samples);
  }
  function between(point, at) {
    // poses between two samples, so that motion is smooth at any pace and for any number of samples
    const { arrays, count } = point, mixed = (point.mixed ||= {}), first = Math.floor(at) % count, next = (first + 1) % count, f = at - Math.floor(at);
    for (const [name, all] of Object.entries(arrays)) {
      const per = all.length / count, to = (mixed[name] ||= new Float32Array(per)), a = first * per, b = next * per;
      const turns = name === "phi" || name === "direction" ? 1 : name === "needle" ? 5 : 0;  // every how many is an angle that wraps
      for (let n = 0; n < per; n++) {
        let way = f ? all[b + n] - all[a + n] : 0;
        if (f && turns && n % turns === 0) way -= 2 * Math.PI * Math.round(way / (2 * Math.PI));
        to[n] = all[a + n] + f * way;
      }
    }
    return mixed;
  }
  const vector = (name, k = 0) => pose[name].subarray(3 * k, 3 * k + 3);
  const number = (name, k) => pose[name][k];

  function readColours() {
    const style = getComputedStyle(document.documentElement);
    for (const name of ["ink", "paper", "faint", "line", "steel", "hot", "cold", "force", "slide", "slip"])
      colour[name] = style.getPropertyValue("--" + name).trim();
    tones = style.getPropertyValue("--tones").trim().split(" ");
    const [hot, cold] = [colour.hot, colour.cold].map((hex) => [1, 3, 5].map((from) => parseInt(hex.slice(from, from + 2), 16)));
    for (let n = 0; n < SHADES; n++) shades[n] = `rgb(${hot.map((c, i) => Math.round(cold[i] + (n / (SHADES - 1)) * (c - cold[i]))).join()})`;
  }
  const shade = (share) => Math.round((SHADES - 1) * Math.max(0, Math.min(1, share)));

  // lengths of arrows in mm: forces have one scale, slip has its own
  const share = (part) => (setting.arrows === "none" ? 0 : setting.arrows === "root" ? Math.sqrt(part) : part);
  const ofForce = (force) => 0.8 * size.pitch_radius * share(Math.abs(force) / mostForce);
  const ofSlip = (slip) => 0.4 * size.pitch_radius * share(slip / mostSlip);
  const closeUp = () => Number(state.view.split(" ")[1] || 0);  // the trunnion that is looked at
  const enlarged = () => (closeUp() ? 1 : 3);  // contact patches

  function paintScene() {
    const [g, w, h] = sized(canvases.scene, state.ratio, state.changed), { solid, magnify } = setting, phi = pose.phi[0], close = closeUp();
    const turn = close ? phi + (close - 1) * TURN : setting.follow ? phi : 0;
    const scale = (Math.min(w, h) / (close ? 2.9 * size.roller_radius : 2.35 * (size.pitch_radius + size.groove_radius))) * state.zoom;
    const camera = cameraOf(state.yaw, state.pitch, scale, turn, close ? vector("rollers", close - 1) : [0, 0, 0], [w / 2, h / 2]);
    const { see, cast } = camera;
    still(canvases.scene, g, w, h, [scale, setting.arrows, magnify, close].join(), colour.paper, (pen) => legend(pen, w, h, scale));
    const outline = (draw, fill, opaque, stroke, wide = 1, lines = 1) => {
      g.beginPath();
      draw();
      g.globalAlpha = opaque;
      g.fillStyle = fill;
      if (opaque) g.fill();
      g.globalAlpha = lines;
      g.strokeStyle = stroke;
      g.lineWidth = wide;
      if (stroke) g.stroke();
      g.globalAlpha = 1;
    };
    const along = cast([0, 0, 1]), long = 1.15 * size.roller_radius + size.pitch_radius * Math.tan(size.joint_angle);
    const play = magnify * (size.groove_radius - size.roller_radius);
    if (!close) {  // the housing
      const outer = 1.04 * (size.pitch_radius + size.groove_radius) * scale;
      outline(() => cylinder(g, see([0, 0, -long]), see([0, 0, long]), outer, along, scale), colour.faint, 0, colour.line);
    }
    for (let k = 0; k < 3; k++) {  // its grooves, which touch their rollers
      if (close && k !== close - 1) continue;
      const middle = add(vector("rollers", k), vector("contacts", k), -play), ends = [-long, long].map((z) => see([middle[0], middle[1], z]));
      const r = (size.roller_radius + play) * scale;
      outline(() => cylinder(g, ...ends, r, along, scale), colour.faint, 0.05 + 0.2 * solid, colour.faint, 1, 0.5);
      outline(() => circle(g, ends[along[2] > 0 ? 1 : 0], r, along, scale), "", 0, colour.faint, 1, 0.5);
    }
    const spider = see(vector("spider")), shaft = cast([Math.sin(size.joint_angle), 0, Math.cos(size.joint_angle)]);
    const paintShaft = () => outline(() => cylinder(g, spider, add(spider, shaft, 2.6 * size.pitch_radius), 0.75 * size.trunnion_radius * scale, shaft, scale), colour.steel, 0.3 + 0.7 * solid);
    if (shaft[2] <= 0) paintShaft();
    const depth = [0, 1, 2].map((k) => cast(vector("trunnions", k))[2]);
    for (const k of [0, 1, 2].sort((a, b) => depth[a] - depth[b])) if (!close || k === close - 1) paintTrunnion(g, k, camera, outline, spider);
    if (shaft[2] > 0) paintShaft();  // it may hide a bearing, so one sees through it
    for (let k = 0; k < 3; k++) if (!close || k === close - 1) paintContact(g, k, camera);
    const thrust = pose.thrust[0];
    if (!close) arrow(g, see([0, 0, 0]), see([0, 0, Math.sign(thrust) * ofForce(thrust)]), colour.hot);
  }

  function paintTrunnion(g, k, { see, cast, scale }, outline, spider) {
    const { solid, magnify } = setting, trunnion = vector("trunnions", k), contact = vector("contacts", k), phi = pose.phi[0] + TURN * k;
    const flank = [side * Math.sin(phi), -side * Math.cos(phi), 0], load = unit(add(flank, trunnion, -dot(flank, trunnion)));
    const [t, l, c] = [trunnion, load, cross(trunnion, load)].map(cast), reach = (size.needle_length + size.needle_axial_clearance) / 2;
    // the roller lies against its loaded needles, which lie on the trunnion
    const gap = magnify * size.bearing_radial_clearance, middle = see(add(vector("rollers", k), contact, -gap));
    const own = unit(add(trunnion, add(vector("axes", k), trunnion, -1), magnify)), axis = cast(own);
    const r = size.roller_radius * scale, half = Math.min(size.roller_width / 2, size.roller_radius) * scale;
    const face = Math.sqrt(Math.max(r * r - half * half, 0)), bore = (size.trunnion_radius + 2 * size.needle_radius + gap) * scale;
    outline(() => roller(g, middle, r, half, axis, scale), colour.line, 0.15 + 0.6 * solid);
    const groups = [[], []];  // needles behind the trunnion and before it, a path for each shade
    const wide = 0.92 * size.needle_radius * scale, long = size.needle_length / 2, n = pose.needle;
    for (let j = 0, o = k * needles * 5; j < needles; j++, o += 5) {
      const cosine = Math.cos(n[o]), sine = Math.sin(n[o]), skew = n[o + 2] * magnify, u = Math.cos(skew), v = Math.sin(skew);
      const d = [0, 1, 2].map((i) => u * t[i] + v * (sine * l[i] - cosine * c[i]));
      const away = size.ring_distance + n[o + 1] * magnify, outward = size.bearing_radius;
      const m = [0, 1].map((i) => spider[i] + away * t[i] + outward * (cosine * l[i] + sine * c[i]));
      const group = groups[cosine * l[2] + sine * c[2] > 0 ? 1 : 0], which = Number.isNaN(n[o + 3]) ? SHADES : shade(Math.sqrt(Math.max(n[o + 3], 0) / mostLoad));
      cylinder((group[which] ||= new Path2D()), [m[0] - long * d[0], m[1] - long * d[1]], [m[0] + long * d[0], m[1] + long * d[1]], wide, d, scale);
    }
    const paintNeedles = (group) => group.forEach((path, which) => { g.fillStyle = shades[which] || colour.faint; g.fill(path); });
    paintNeedles(groups[0]);
    const end = [0, 1, 2].map((i) => spider[i] + (size.ring_distance + reach) * t[i]), pin = size.trunnion_radius * scale;
    outline(() => cylinder(g, spider, end, pin, t, scale), colour.steel, 1);
    if (t[2] > 0) outline(() => circle(g, end, pin, t, scale), colour.steel, 1, colour.ink, 0.6);
    paintNeedles(groups[1]);
    outline(() => roller(g, middle, r, half, axis, scale), "", 0, colour.ink);
    outline(() => {
      for (const way of [-1, 1]) for (const ring of [face, bore]) circle(g, add(middle, axis, (way * half) / scale), ring, axis, scale);
    }, "", 0, colour.ink, 1, 0.5);
  }

  function paintContact(g, k, { see, cast, scale }) {
    const contact = vector("contacts", k), outward = [-side * contact[1], side * contact[0], 0];  // outward from the joint's axis
    const centre = see(vector("rollers", k)), [n, e, z] = [contact, outward, [0, 0, 1]].map(cast);
    const force = number("normal", k), peak = number("pressure", k), R = size.roller_radius, grown = enlarged() * Math.cbrt(Math.max(force, 0));
    for (let level = 0; level < 4; level++) {  // pressure of an ellipse by Hertz: its peak times the root of 1 - rho^2
      const rho = 1 - level / 4, points = [];
      for (let q = 0; q < 20; q++) {
        const around = (rho * grown * size.patch_across * Math.cos((Math.PI * q) / 10)) / R, aside = rho * grown * size.patch_along * Math.sin((Math.PI * q) / 10);
        const a = R * Math.cos(around), b = R * Math.sin(around);
        points.push([centre[0] + a * n[0] + b * e[0] + aside * z[0], centre[1] + a * n[1] + b * e[1] + aside * z[1]]);
      }
      g.beginPath();
      polygon(g, points);
      g.fillStyle = shades[shade((peak / mostPressure) * Math.sqrt(1 - (rho - 0.125) ** 2))];
      g.fill();
    }
    if (setting.arrows === "none") return;
    const touch = add(centre, n, R), direction = number("direction", k), away = add(scaled(z, Math.cos(direction)), e, Math.sin(direction));
    arrow(g, touch, add(touch, n, -ofForce(force)), colour.force);
    arrow(g, touch, add(touch, away, -ofForce(number("friction", k))), colour.slide, 2);
    arrow(g, touch, add(touch, away, ofSlip(number("slip", k))), colour.slip, 1.4);
  }

  function scaleBar(g, x, y, text) {
    for (let n = 0; n < SHADES; n++) { g.fillStyle = shades[n]; g.fillRect(x + 4 * n, y - 8, 4, 9); }
    g.fillStyle = colour.ink;
    g.fillText(text, x + 4 * SHADES + 6, y);
  }
  function legend(g, w, h, scale) {
    const { magnify } = setting, factor = enlarged();
    scaleBar(g, 10, 18, `pressure 0 to ${mostPressure.toPrecision(3)} MPa; patches ${factor === 1 ? "true to scale" : `\u00d7 ${factor}`}`);
    g.fillText(magnify === 1 ? "tilt, skew and clearances true to scale" : `tilt, skew, clearances and shift of needles \u00d7 ${magnify}`, 10, 34);
    if (setting.arrows === "none") return;
    const round = (x) => { const p = 10 ** Math.floor(Math.log10(x)); return [5, 2, 1].map((f) => f * p).find((v) => v <= x) || p; };
    const plain = (x) => Number(x.toPrecision(3));
    [
      [ofForce, round(mostForce), "N normal force", colour.force, 2.4], [ofForce, round(mostForce / 20), "N friction", colour.slide, 2],
      [ofForce, round(mostForce / 20), "N thrust on the housing", colour.hot, 2.4], [ofSlip, round(mostSlip), "mm/s slip", colour.slip, 1.4],
    ].filter(([, , text]) => !closeUp() || !text.endsWith("housing")).forEach(([length, value, text, tone, wide], n, { length: lines }) => {
      const y = h + 6 + 16 * (n - lines), to = 10 + length(value) * scale;
      arrow(g, [10, y - 4], [to, y - 4], tone, wide);
      g.fillStyle = colour.ink;
      g.fillText(`${plain(value)} ${text}`, to + 8, y);
    });
  }

  function paintRing() {
    const [g, w, h] = sized(canvases.ring, state.ratio, state.changed), { magnify } = setting, left = 34, right = w - 8, top = 26;
    const height = (h - top - 40) / 3, reach = (size.needle_length + magnify * size.needle_axial_clearance) / 2, high = reach * 1.12;
    const x = (angle) => left + ((angle + Math.PI) / (2 * Math.PI)) * (right - left), y = (k, place) => top + k * (height + 10) + height / 2 - (place / high) * (height / 2);
    still(canvases.ring, g, w, h, magnify, colour.paper, (pen) => paintStops(pen, w, h, x, y, reach));
    const n = pose.needle, half = size.needle_length / 2, groups = [];
    g.fillStyle = colour.slide;
    g.beginPath();
    for (let k = 0, o = 0; k < 3; k++) {
      for (let j = 0; j < needles; j++, o += 5) {
        const angle = n[o] - 2 * Math.PI * Math.round(n[o] / (2 * Math.PI)), skew = n[o + 2] * magnify, place = n[o + 1] * magnify, load = n[o + 3], stop = n[o + 4];
        const aside = (Math.sin(skew) * half) / size.bearing_radius, along = Math.cos(skew) * half;
        // outward is up; counterclockwise about the outward normal of the trunnion, seen from outside, is to the left
        lineTo((groups[Number.isNaN(load) ? SHADES : shade(Math.sqrt(Math.max(load, 0) / mostLoad))] ||= new Path2D()), [x(angle - aside), y(k, place + along)], [x(angle + aside), y(k, place - along)]);
        if (Math.abs(stop) > 0.02 * mostLoad) {
          const edge = y(k, Math.sign(stop) * reach);
          g.moveTo(x(angle) + 4, edge);
          g.arc(x(angle), edge, 4, 0, 2 * Math.PI);
        }
      }
    }
    g.lineWidth = Math.max(2, ((1.5 * size.needle_radius) / (2 * Math.PI * size.bearing_radius)) * (right - left));
    groups.forEach((path, which) => { g.strokeStyle = shades[which] || colour.faint; g.stroke(path); });
    g.fill();
  }
  function paintStops(g, w, h, x, y, reach) {
    g.fillStyle = colour.ink;
    if (Number.isNaN(arrays.needle[3])) g.fillText("needles unrolled; this model has no single needles", x(-Math.PI), 16);
    else scaleBar(g, x(-Math.PI), 16, `load of needles 0 to ${mostLoad.toPrecision(3)} N, root scale`);
    g.strokeStyle = colour.faint;
    for (let k = 0; k < 3; k++) {
      g.beginPath();
      for (const stop of [-reach, reach]) lineTo(g, [x(-Math.PI), y(k, stop)], [x(Math.PI), y(k, stop)]);
      g.stroke();
      g.beginPath();
      g.setLineDash([3, 3]);
      lineTo(g, [x(0), y(k, -reach)], [x(0), y(k, reach)]);
      g.stroke();
      g.setLineDash([]);
      g.fillStyle = colour.ink;
      g.fillText(String(k + 1), 12, y(k, 0) + 4);
    }
    g.fillText("-180", x(-Math.PI), h - 5);
    g.fillText("0: loaded side", x(0) - 36, h - 5);
    g.fillText("180 deg", x(Math.PI) - 44, h - 5);
  }

  const LEFT = 46, RIGHT = 10;  // of the curves
  function paintPlot() {
    const { plot, cursor } = canvases, [g, w, h] = sized(plot, devicePixelRatio || 1, state.changed), right = w - RIGHT;
    const key = [plot.width, plot.height, colour.ink, colour.paper].join();
    if (data.drawn !== key) still(plot, g, w, h, key, colour.paper, (pen) => paintCurves(pen, right, 22, h - 22, h));
    data.drawn = key;  // the curves stand still, the cursor is an element of its own
    cursor.style.transform = `translateX(${LEFT + (state.at / samples) * (right - LEFT)}px)`;
  }
  function paintCurves(g, right, top, bottom, h) {
    const count = data.parts.length, x = (share) => LEFT + share * (right - LEFT), y = (v) => (top + bottom) / 2 - (v / mostThrust) * 0.5 * (bottom - top);
    const curve = (length, read, tone, width) => {
      g.beginPath();
      for (let i = 0; i <= length; i++) g.lineTo(x(i / length), y(read(i % length)));
      g.strokeStyle = tone;
      g.lineWidth = width;
      g.stroke();
    };
    curve(1, () => 0, colour.line, 1);
    data.parts.forEach((_, n) => curve(data.count, (i) => arrays.part[i * count + n], tones[n % tones.length], 1));
    g.setLineDash([5, 4]);
    for (const other of points) if (other !== data) curve(other.count, (i) => other.arrays.thrust[i], colour.faint, 1.5);
    g.setLineDash([]);
    curve(data.count, (i) => arrays.thrust[i], colour.ink, 2.2);
    g.fillStyle = colour.ink;
    g.fillText(`${mostThrust.toPrecision(3)} N`, 2, top + 4);
    g.fillText("0", 32, y(0) + 4);
    let begin = LEFT;
    for (const [text, tone] of [["thrust", colour.ink], ...(points.length > 1 ? [["the other joint", colour.faint]] : []), ...data.parts.map((name, n) => [name.replace("_", " "), tones[n % tones.length]])]) {
      g.fillStyle = tone;
      if (begin + g.measureText(text).width < right) g.fillText(text, begin, 13);
      begin += g.measureText(text).width + 12;
    }
    g.fillStyle = colour.ink;
    for (let q = 0; q <= 4; q++) g.fillText(String(90 * q), x(q / 4) - (q === 4 ? 22 : 8), h - 6);
  }

  function paintOrders() {
    const [g, w, h] = sized(canvases.orders, state.ratio, state.changed), top = 22, bottom = h - 22, last = data.orders.length - 1;
    const x = (k) => 26 + ((k - 0.5) / last) * (w - 34), y = (v) => (top + bottom) / 2 - (Math.sign(v) * Math.sqrt(Math.abs(v) / mostOrder) * (bottom - top)) / 2;
    const wide = Math.max(3, (0.5 * (w - 34)) / last);
    still(canvases.orders, g, w, h, colour.ink, colour.paper, (pen) => {
      pen.fillStyle = colour.line;
      data.orders.forEach((a, k) => { if (k) pen.fillRect(x(k) - wide / 2, y(a), wide, y(-a) - y(a)); });
      pen.fillStyle = colour.ink;
      pen.fillText(`orders of the thrust, up to ${mostOrder.toPrecision(3)} N, root scale`, 4, 13);
      data.orders.forEach((_, k) => { if (k && (w > 260 || k % 3 === 0)) pen.fillText(String(k), x(k) - (k > 9 ? 7 : 3), h - 6); });
    });
    g.fillStyle = colour.hot;
    for (let k = 1; k <= last; k++) g.fillRect(x(k) - wide / 2 - 1, y(data.orders[k] * Math.cos(k * pose.phi[0] + data.phases[k])) - 1.5, wide + 2, 3);
  }

  function write() {
    const three = (name) => [0, 1, 2].map((k) => number(name, k).toFixed(0)).join(", ");
    canvases.numbers.textContent = `rotation ${((180 * pose.phi[0]) / Math.PI).toFixed(1)} deg; thrust ${pose.thrust[0].toFixed(2)} N; normal forces ${three("normal")} N; ` +
      `friction ${three("friction")} N; slip ${three("slip")} mm/s; pressures ${three("pressure")} MPa; orders 1 to 6: ${data.orders.slice(1, 7).map((a) => a.toPrecision(3)).join(", ")} N`;
  }
  function paint(now = performance.now()) {
    const begin = performance.now(), writes = !state.playing || now - state.written > 120;  // text is read no faster
    const screen = devicePixelRatio || 1;
    state.ratio = state.playing ? Math.min(screen, 1.25) : screen;  // what moves needs no finer pixels
    points.forEach((_, which) => {
      use(which);
      paintScene();
      paintPlot();
      if (!state.playing || (state.frames + which) % 2) {  // needles and orders move less: thirty times a second will do
        paintRing();
        paintOrders();
      }
      if (writes) write();
    });
    if (!writes) return;
    state.written = now;
    document.body.dataset.frames = state.frames;
    document.body.dataset.milliseconds = (performance.now() - begin).toFixed(2);
  }

  let asked = false;
  function ask() {
    if (!asked) { asked = true; requestAnimationFrame(tick); }
  }
  function tick(now) {
    asked = false;
    // a frame may have begun before the key that plays
    if (state.playing) state.at = (state.at + (Math.max(0, now - state.last) / 6000) * Number(setting.pace) * samples) % samples;
    state.last = now;
    state.frames += state.playing;
    paint(now);
    state.changed = false;
    if (state.playing) ask();
  }
  function change() { state.changed = true; ask(); }
  function step(by) {
    state.at = (((Math.round(state.at) + by) % samples) + samples) % samples;
    change();
  }
  function play() {
    state.playing = !state.playing;
    state.at = Math.round(state.at) % samples;
    state.last = performance.now();
    element("play").textContent = state.playing ? "Pause" : "Play";
    element("play").setAttribute("aria-pressed", String(state.playing));
    change();
  }
  const outside = [Math.PI / 2 - 0.3, 0.25];  // a trunnion from its outer end
  const views = { along: [0, 0], side: [Math.PI / 2, 0], oblique: [-0.6, 0.35], "trunnion 1": outside, "trunnion 2": outside, "trunnion 3": outside };
  function look(name) {
    [state.view, state.zoom, [state.yaw, state.pitch]] = [name, 1, views[name]];
    element("view").value = name;
    change();
  }
  function read() {
    for (const id of ["magnify", "arrows", "solid", "pace"]) setting[id] = element(id).value;
    [setting.magnify, setting.solid, setting.follow] = [Number(setting.magnify), Number(setting.solid), element("follow").checked];
    change();
  }
  element("play").addEventListener("click", play);
  element("back").addEventListener("click", () => step(-1));
  element("ahead").addEventListener("click", () => step(1));
  element("view").addEventListener("change", (event) => look(event.target.value));
  for (const id of ["follow", "magnify", "arrows", "solid", "pace"]) element(id).addEventListener("input", read);
  const keys = { " ": play, ArrowLeft: () => step(-1), ArrowRight: () => step(1), Home: () => step(-Math.round(state.at)) };
  for (const [key, factor] of [["ArrowUp", 1.1], ["+", 1.1], ["ArrowDown", 1 / 1.1], ["-", 1 / 1.1]]) keys[key] = () => { state.zoom *= factor; change(); };
  Object.keys(views).forEach((name, n) => { keys[n + 1] = () => look(name); });
  document.addEventListener("keydown", (event) => {
    const { tagName } = event.target, own = ["SELECT", "INPUT"].includes(tagName) || (["BUTTON", "SUMMARY"].includes(tagName) && event.key === " ");
    if (own || event.ctrlKey || event.metaKey || event.altKey || !keys[event.key]) return;
    keys[event.key]();
    event.preventDefault();
  });
  points.forEach((_, which) => {
    const scene = element(`scene-${which}`), plot = element(`plot-${which}`);
    scene.addEventListener("pointermove", (event) => {
      if (!event.buttons) return;
      state.yaw += 0.008 * event.movementX;
      state.pitch = Math.max(-1.5, Math.min(1.5, state.pitch + 0.008 * event.movementY));
      change();
    });
    scene.addEventListener("wheel", (event) => { state.zoom *= Math.exp(-0.001 * event.deltaY); event.preventDefault(); change(); }, { passive: false });
    const seek = (event) => {
      if (event.type === "pointermove" && !event.buttons) return;
      const share = (event.offsetX - LEFT) / (plot.clientWidth - LEFT - RIGHT);
      state.at = Math.max(0, Math.min(samples - 1, Math.round(share * samples)));
      change();
    };
    plot.addEventListener("pointerdown", seek);
    plot.addEventListener("pointermove", seek);
  });
  window.addEventListener("resize", change);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { readColours(); change(); });
  readColours();
  read();
})();
