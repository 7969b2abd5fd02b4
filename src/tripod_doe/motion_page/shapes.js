"use strict";
// Vectors, and bodies in parallel projection: their outlines are exact arcs of ellipses, which cost less than polygons.
// A point or direction that is seen is [right, down, towards the viewer], in pixels; r is a radius in pixels.
const add = (a, b, s = 1) => [a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]];
const scaled = (a, s) => [s * a[0], s * a[1], s * a[2]];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const unit = (a) => { const l = Math.hypot(...a) || 1; return [a[0] / l, a[1] / l, a[2] / l]; };

function cameraOf(yaw, pitch, scale, turn, target, middle) {
  // yaw 0 and pitch 0 look along the input axis; what is seen is turned back by the angle `turn` about that axis
  const cy = Math.cos(yaw), sy = Math.sin(yaw), cp = Math.cos(pitch), sp = Math.sin(pitch), c = Math.cos(turn), s = Math.sin(turn);
  const right = [cy, 0, -sy], near = [sy * cp, -sp, cy * cp], up = cross(near, right);
  const [r, d, n] = [right, scaled(up, -1), near].map((v) => scaled([c * v[0] - s * v[1], s * v[0] + c * v[1], v[2]], scale));
  const cast = (v) => [dot(v, r), dot(v, d), dot(v, n)];
  const [x, y, z] = cast(target);
  const see = (p) => { const q = cast(p); return [middle[0] + q[0] - x, middle[1] + q[1] - y, q[2] - z]; };
  return { cast, see, scale };
}

function lineTo(pen, a, b) {
  pen.moveTo(a[0], a[1]);
  pen.lineTo(b[0], b[1]);
}
function polygon(pen, points) {
  points.forEach((p, i) => (i ? pen.lineTo(p[0], p[1]) : pen.moveTo(p[0], p[1])));
  pen.closePath();
}
function circle(pen, centre, r, axis, scale) {
  const rot = Math.atan2(axis[1], axis[0]);
  pen.moveTo(centre[0] + r * Math.abs(axis[2] / scale) * Math.cos(rot), centre[1] + r * Math.abs(axis[2] / scale) * Math.sin(rot));
  pen.ellipse(centre[0], centre[1], r * Math.abs(axis[2] / scale), r, rot, 0, 2 * Math.PI);
}
function cylinder(pen, from, to, r, axis, scale) {
  // `axis` is the unit vector from one end to the other as it is seen
  const length = Math.hypot(axis[0], axis[1]) || 1, flat = r * Math.abs(axis[2] / scale);
  const x = (-axis[1] / length) * r, y = (axis[0] / length) * r;
  pen.moveTo(to[0] - x, to[1] - y);
  if (flat < 0.4) {
    pen.lineTo(to[0] + x, to[1] + y);
    pen.lineTo(from[0] + x, from[1] + y);
    pen.lineTo(from[0] - x, from[1] - y);
  } else {
    const rot = Math.atan2(axis[1], axis[0]);
    pen.ellipse(to[0], to[1], flat, r, rot, -Math.PI / 2, Math.PI / 2);
    pen.ellipse(from[0], from[1], flat, r, rot, Math.PI / 2, 1.5 * Math.PI);
  }
  pen.closePath();
}
function roller(pen, centre, r, half, axis, scale) {
  // a sphere that is cut at `half` from its middle on both sides
  const seen = Math.hypot(axis[0], axis[1]) / scale, rot = Math.atan2(axis[1], axis[0]);
  if (r * seen <= half) {
    pen.moveTo(centre[0] + r, centre[1]);
    pen.arc(centre[0], centre[1], r, 0, 2 * Math.PI);
    return;
  }
  const face = Math.sqrt(Math.max(r * r - half * half, 0)), depth = Math.abs(axis[2] / scale);
  const t = Math.acos(half / (r * seen)), q = Math.acos(Math.min(1, (half * depth) / (seen * face || 1)));
  const x = half * (axis[0] / scale), y = half * (axis[1] / scale);
  pen.moveTo(centre[0] + r * Math.cos(rot - t), centre[1] + r * Math.sin(rot - t));
  pen.ellipse(centre[0] + x, centre[1] + y, face * depth, face, rot, -q, q);
  pen.arc(centre[0], centre[1], r, rot + t, rot + Math.PI - t);
  pen.ellipse(centre[0] - x, centre[1] - y, face * depth, face, rot, Math.PI - q, Math.PI + q);
  pen.arc(centre[0], centre[1], r, rot + Math.PI + t, rot + 2 * Math.PI - t);
  pen.closePath();
}
function arrow(g, from, to, colour, width = 2.4) {
  const dx = to[0] - from[0], dy = to[1] - from[1], length = Math.hypot(dx, dy);
  if (length < 1.5) return;
  const head = Math.min(3 + 2.5 * width, 0.45 * length), ux = (dx / length) * head, uy = (dy / length) * head;
  g.strokeStyle = g.fillStyle = colour;
  g.lineWidth = width;
  g.beginPath();
  lineTo(g, from, [to[0] - 0.8 * ux, to[1] - 0.8 * uy]);
  g.stroke();
  g.beginPath();
  polygon(g, [to, [to[0] - ux - 0.45 * uy, to[1] - uy + 0.45 * ux], [to[0] - ux + 0.45 * uy, to[1] - uy - 0.45 * ux]]);
  g.fill();
}
function sized(canvas, ratio, afresh) {
  // a pen in CSS pixels, on a canvas of as many pixels as the screen has; to ask for its size costs a layout
  if (afresh || !canvas.box) canvas.box = [canvas.clientWidth, canvas.clientHeight];
  const [w, h] = canvas.box, [across, down] = [Math.round(w * ratio), Math.round(h * ratio)];
  if (canvas.width !== across || canvas.height !== down) [canvas.width, canvas.height] = [across, down];
  const g = canvas.getContext("2d", { alpha: false });
  g.setTransform(ratio, 0, 0, ratio, 0, 0);
  return [g, w, h];
}
function still(canvas, g, w, h, key, paper, paint) {
  // what stands still is painted once for each key, and copied
  const ratio = canvas.width / w;
  const whole = [key, canvas.width, canvas.height, paper].join();
  if (canvas.still !== whole) {
    canvas.still = whole;
    canvas.image = document.createElement("canvas");
    [canvas.image.width, canvas.image.height] = [canvas.width, canvas.height];
    const pen = canvas.image.getContext("2d", { alpha: false });
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.font = "12px system-ui, sans-serif";
    pen.fillStyle = paper;
    pen.fillRect(0, 0, w, h);
    paint(pen);
  }
  g.drawImage(canvas.image, 0, 0, w, h);
}
