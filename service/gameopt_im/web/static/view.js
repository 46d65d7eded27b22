// The junction on a canvas: the ground once for every camera, the vehicles thirty times a second.

import { COLOURS, drawVehicle } from "./glyphs.js";
import { unit } from "./roads.js";

const FRAME_MS = 33;
const STILL = matchMedia("(prefers-reduced-motion: reduce)");
const LABEL_SCALE = 3;
const ALL_LABELS_SCALE = 8;
const FINGER = 22;

export class View {
  constructor(canvas, traffic, select) {
    this.canvas = canvas;
    this.ink = canvas.getContext("2d");
    this.traffic = traffic;
    this.select = select;
    this.selected = null;
    this.ground = document.createElement("canvas");
    this.drawnMs = 0;
    this.pointers = new Map();
    new ResizeObserver(() => this.resize()).observe(canvas);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.drawGround());
    this.listen();
    requestAnimationFrame((nowMs) => this.turn(nowMs));
  }

  show(roads) {
    this.roads = roads;
    this.fit();
  }

  resize() {
    const ratio = window.devicePixelRatio || 1;
    const { width, height } = this.canvas.getBoundingClientRect();
    if (!width || !height) return;
    [this.wide, this.high, this.ratio] = [width, height, ratio];
    for (const canvas of [this.canvas, this.ground]) {
      canvas.width = Math.round(width * ratio);
      canvas.height = Math.round(height * ratio);
    }
    if (this.untouched ?? true) this.fit();
    else this.drawGround();
  }

  // What matters is near the lines: as much of the lanes as leaves a vehicle recognisable.
  fit() {
    if (!this.roads || !this.wide) return;
    const reach = Math.min(this.roads.radius, 2.2 * this.roads.coreRadius + 36);
    this.camera = { x: this.roads.centre[0], y: this.roads.centre[1], scale: Math.min(this.wide, this.high) / 2 / reach };
    this.untouched = true;
    this.drawGround();
  }

  zoom(factor, [x, y] = [this.wide / 2, this.high / 2]) {
    if (!this.camera) return;
    const [east, north] = this.worldOf(x, y);
    const scale = Math.min(40, Math.max(0.5, this.camera.scale * factor));
    this.camera = { x: east - (x - this.wide / 2) / scale, y: north + (y - this.high / 2) / scale, scale };
    this.untouched = false;
    this.drawGround();
  }

  pan(dx, dy) {
    this.camera.x -= dx / this.camera.scale;
    this.camera.y += dy / this.camera.scale;
    this.untouched = false;
    this.drawGround();
  }

  screenOf([x, y]) {
    const { scale } = this.camera;
    return [this.wide / 2 + (x - this.camera.x) * scale, this.high / 2 - (y - this.camera.y) * scale];
  }

  worldOf(x, y) {
    const { scale } = this.camera;
    return [this.camera.x + (x - this.wide / 2) / scale, this.camera.y - (y - this.high / 2) / scale];
  }

  trace(ink, points) {
    ink.beginPath();
    points.forEach((point, k) => (k ? ink.lineTo(...this.screenOf(point)) : ink.moveTo(...this.screenOf(point))));
  }

  colour(name) {
    return getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
  }

  drawGround() {
    if (!this.roads || !this.camera) return;
    const ink = this.ground.getContext("2d");
    ink.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
    ink.fillStyle = this.colour("grass");
    ink.fillRect(0, 0, this.wide, this.high);
    this.palette = { area: this.colour("area"), text: this.colour("text"), halo: this.colour("halo") };
    this.drawRoads(ink);
    for (const area of this.roads.areas) this.drawArea(ink, area, 0.1);
    this.drawMarkings(ink);
  }

  drawRoads(ink) {
    const { scale } = this.camera;
    ink.lineJoin = "round";
    this.trace(ink, this.roads.plaza);
    ink.fillStyle = this.colour("road");
    ink.fill();
    ink.strokeStyle = this.colour("kerb");
    for (const extra of [1.2, 0]) {
      ink.lineWidth = (this.roads.width + extra) * scale;
      if (!extra) ink.strokeStyle = this.colour("road");
      for (const { points } of this.roads.movements) {
        this.trace(ink, points);
        ink.stroke();
      }
    }
  }

  drawMarkings(ink) {
    const half = this.roads.width / 2;
    const { scale } = this.camera;
    ink.strokeStyle = this.colour("marking");
    ink.lineWidth = Math.max(0.8, 0.12 * scale);
    const edges = [...this.roads.lanes.map(({ line, start }) => [line, start]), ...this.roads.movements.map((m) => m.exit)];
    ink.setLineDash([1.5 * scale, 2.5 * scale]);
    for (const [from, to] of edges) {
      const [dx, dy] = unit(from, to);
      for (const side of [half, -half]) {
        this.trace(ink, [from, to].map(([x, y]) => [x - side * dy, y + side * dx]));
        ink.stroke();
      }
    }
    ink.setLineDash([]);
    ink.strokeStyle = this.colour("stop");
    ink.lineWidth = Math.max(2, 0.55 * scale);
    for (const { line, back: [dx, dy] } of this.roads.lanes) {
      const at = [line[0] + 0.3 * dx, line[1] + 0.3 * dy];
      this.trace(ink, [1, -1].map((side) => [at[0] - side * (half - 0.15) * dy, at[1] + side * (half - 0.15) * dx]));
      ink.stroke();
    }
  }

  drawArea(ink, { bands }, strength) {
    ink.save();
    this.trace(ink, bands[0]);
    ink.clip();
    this.trace(ink, bands[1]);
    ink.globalAlpha = strength;
    ink.fillStyle = this.palette.area;
    ink.fill();
    ink.restore();
  }

  turn(nowMs) {
    requestAnimationFrame((laterMs) => this.turn(laterMs));
    if (nowMs - this.drawnMs < FRAME_MS - 4 || !this.camera) return;
    this.drawnMs = nowMs;
    this.draw(performance.now());
  }

  draw(nowMs) {
    const { ink } = this;
    ink.setTransform(1, 0, 0, 1, 0, 0);
    ink.drawImage(this.ground, 0, 0);
    ink.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
    if (!this.traffic.frame) return;
    this.placed = this.traffic.list.map((car) => this.placeOf(car, nowMs)).filter(Boolean);
    this.drawAreasInUse(ink);
    const picked = this.placed.find(({ car }) => car.vehicle === this.selected);
    if (picked) this.drawWay(ink, picked);
    for (const placed of this.placed) this.drawCar(ink, placed);
    this.drawLabels(ink);
    if (picked) this.drawRing(ink, picked);
  }

  placeOf(car, nowMs) {
    const distance_m = STILL.matches ? car.distance_m : this.traffic.distanceOf(car.vehicle, nowMs);
    const front = this.roads.place(car.movement, distance_m);
    const rear = this.roads.place(car.movement, distance_m + car.length_m);
    if (!front || !rear) return null;
    const [x, y] = this.screenOf([front.x, front.y]);
    if (x < -60 || y < -60 || x > this.wide + 60 || y > this.high + 60) return null;
    return { car, distance_m, x, y, heading: Math.atan2(front.y - rear.y, front.x - rear.x) };
  }

  drawCar(ink, { car, x, y, heading }) {
    const { scale } = this.camera;
    ink.save();
    ink.translate(x, y);
    ink.rotate(-heading);
    drawVehicle(ink, car, Math.max(9, car.length_m * scale), Math.max(4.5, car.width_m * scale));
    ink.restore();
  }

  drawAreasInUse(ink) {
    const crossing = this.placed.filter(({ car, distance_m }) => distance_m < 2 && car.status !== "leaving");
    for (const area of this.roads.areas) {
      const within = crossing.some(({ car, distance_m }) => {
        const windows = car.movement === area.a ? area.a_windows_m : car.movement === area.b ? area.b_windows_m : null;
        const window = windows?.[car.footprint]?.[0];
        return window && -distance_m > window[0] && -distance_m - car.length_m < window[1];
      });
      if (within) this.drawArea(ink, area, 0.42);
    }
  }

  drawWay(ink, { car, distance_m }) {
    const end_m = this.roads.map.movements[car.movement].length_m + 25;
    if (-distance_m > end_m) return;
    const way = this.roads.stretch(car.movement, -distance_m, end_m);
    this.trace(ink, way);
    ink.lineCap = "round";
    ink.strokeStyle = COLOURS[car.status];
    ink.lineWidth = Math.max(3, 0.7 * this.camera.scale);
    ink.globalAlpha = 0.75;
    ink.setLineDash(car.status === "cleared" ? [] : [8, 8]);
    ink.stroke();
    ink.setLineDash([]);
    ink.globalAlpha = 1;
    ink.lineCap = "butt";
  }

  // The middle of a vehicle's body and half its length, in pixels.
  middleOf({ x, y, car, heading }) {
    const half = 0.5 * car.length_m * this.camera.scale;
    return [x - half * Math.cos(heading), y + half * Math.sin(heading), half];
  }

  drawRing(ink, placed) {
    const [x, y, half] = this.middleOf(placed);
    ink.beginPath();
    ink.arc(x, y, half + 9, 0, 2 * Math.PI);
    ink.lineWidth = 5;
    ink.strokeStyle = this.palette.halo;
    ink.stroke();
    ink.lineWidth = 2.5;
    ink.strokeStyle = this.palette.text;
    ink.stroke();
  }

  // The turn of whoever is next in its lane, once there is room for it; of all when seen from near.
  drawLabels(ink) {
    const { scale } = this.camera;
    if (scale < LABEL_SCALE) return;
    const lanes = new Set();
    const open = this.placed.filter(({ car }) => car.rank >= 0 && (car.status === "waiting" || car.status === "offered"));
    open.sort((one, other) => one.distance_m - other.distance_m);
    ink.textAlign = "center";
    ink.textBaseline = "middle";
    ink.font = `700 ${Math.min(15, Math.max(9.5, 2.3 * scale))}px system-ui, sans-serif`;
    for (const { car, x, y, heading } of open) {
      const lane = this.roads.map.movements[car.movement].lane;
      if (lanes.has(lane) && scale < ALL_LABELS_SCALE) continue;
      lanes.add(lane);
      const ahead = Math.min(15, 2.6 * scale);
      const [left, top] = [x + ahead * Math.cos(heading), y - ahead * Math.sin(heading)];
      ink.lineWidth = 3.5;
      ink.strokeStyle = this.palette.halo;
      const words = scale < ALL_LABELS_SCALE || car.slot_s === null ? `${car.rank + 1}` : `${car.rank + 1} · ${car.slot_s.toFixed(1)} s`;
      ink.strokeText(words, left, top);
      ink.fillStyle = this.palette.text;
      ink.fillText(words, left, top);
    }
  }

  // The vehicle nearest to a point of the canvas, within a finger's width.
  at(x, y) {
    let best = null;
    for (const placed of this.placed ?? []) {
      const [left, top, half] = this.middleOf(placed);
      const far = Math.hypot(left - x, top - y);
      if (far < Math.max(FINGER, half) && far < (best?.far ?? Infinity)) best = { vehicle: placed.car.vehicle, far };
    }
    return best?.vehicle ?? null;
  }

  listen() {
    const point = (event) => {
      const { left, top } = this.canvas.getBoundingClientRect();
      return [event.clientX - left, event.clientY - top];
    };
    this.canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.zoom(Math.exp(-0.0015 * event.deltaY), point(event));
    }, { passive: false });
    this.canvas.addEventListener("pointerdown", (event) => {
      this.canvas.setPointerCapture(event.pointerId);
      this.pointers.set(event.pointerId, point(event));
      this.moved = this.pointers.size > 1 ? Infinity : 0;
      this.pressed = this.at(...point(event)); // it has driven on when the finger is lifted
    });
    this.canvas.addEventListener("pointermove", (event) => {
      const was = this.pointers.get(event.pointerId);
      if (!was || !this.camera) return;
      const now = point(event);
      const others = [...this.pointers].filter(([id]) => id !== event.pointerId).map(([, other]) => other);
      this.pointers.set(event.pointerId, now);
      if (others.length) return this.pinch(others[0], was, now);
      this.moved += Math.hypot(now[0] - was[0], now[1] - was[1]);
      if (this.moved > 6) this.pan(now[0] - was[0], now[1] - was[1]);
    });
    const lift = (event) => {
      const known = this.pointers.delete(event.pointerId);
      if (known && event.type === "pointerup" && this.moved <= 6) this.select(this.pressed);
    };
    this.canvas.addEventListener("pointerup", lift);
    this.canvas.addEventListener("pointercancel", lift);
  }

  pinch(other, was, now) {
    const spread = (point) => Math.hypot(point[0] - other[0], point[1] - other[1]) || 1;
    this.pan((now[0] - was[0]) / 2, (now[1] - was[1]) / 2);
    this.zoom(spread(now) / spread(was), [(now[0] + other[0]) / 2, (now[1] + other[1]) / 2]);
  }
}
