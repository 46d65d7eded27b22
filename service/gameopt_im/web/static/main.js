// The live page: messages in, the map and its panels out. Selecting a vehicle is all that is ever sent.

import { Charts } from "./charts.js";
import { fillLegend } from "./glyphs.js";
import { Link } from "./link.js";
import { Candidates, Order, Selected, troubles } from "./panels.js";
import { Roads } from "./roads.js";
import { Traffic } from "./traffic.js";
import { View } from "./view.js";

const PANELS_MS = 200;
const CHARTS_MS = 500;
const byId = (id) => document.getElementById(id);

const traffic = new Traffic();
let hello = null;
let selected = null;
let state = "connecting";

const view = new View(byId("junction"), traffic, select);
const order = new Order(byId("order"), byId("counts"), select);
const card = new Selected(byId("selected"), select);
const candidates = new Candidates(byId("candidates"));
const charts = new Charts(byId("charts"));
const link = new Link(told, changed);
fillLegend(byId("legend"));

function select(vehicle) {
  selected = vehicle;
  view.selected = vehicle;
  link.select(vehicle);
  drawPanels();
}

function told(message) {
  if (message.type === "hello") return greeted(message);
  traffic.take(message, performance.now());
  document.documentElement.dataset.cycle = message.cycle;
}

function greeted(message) {
  if (hello && hello.version !== message.version) return location.reload();
  if (hello?.term !== message.term) {
    traffic.forget();
    select(null);
  }
  hello = message;
  const name = hello.map.intersection;
  document.title = `${name} · gameopt`;
  byId("intersection").textContent = name;
  byId("run").textContent = `${hello.profile} profile, ${hello.geometry}, ${hello.clock === "wall" ? "wall clock" : "lock-step"}`;
  document.documentElement.dataset.term = hello.term;
  view.show(new Roads(hello.map));
  link.select(selected);
}

function changed(now) {
  state = now;
  byId("link").textContent = now === "live" ? "live" : "reconnecting";
  byId("link").className = now;
  drawBanner();
}

function drawBanner() {
  const found = troubles(traffic, state, performance.now(), hello?.clock);
  const banner = byId("banner");
  const words = found.join(" ");
  if (banner.textContent !== words) banner.textContent = words;
  banner.hidden = !found.length;
  const nobody = traffic.frame ? !traffic.list.length && "No vehicles in the control zone." : hello && "Waiting for the first control cycle.";
  byId("quiet").textContent = nobody || "";
  byId("quiet").hidden = !nobody || state === "lost";
}

function drawPanels() {
  drawBanner();
  if (!traffic.frame || !hello || document.hidden) return;
  byId("clock").textContent = `${hello.clock === "wall" ? new Date(1000 * traffic.frame.time_s).toLocaleTimeString() : `${traffic.frame.time_s.toFixed(1)} s`}`;
  order.draw(traffic, selected);
  card.draw(traffic, selected, hello);
  candidates.draw(traffic, hello);
}

byId("junction").addEventListener("keydown", (event) => {
  const zooms = { "+": 1.25, "=": 1.25, "-": 0.8 };
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  if (event.key in zooms) view.zoom(zooms[event.key]);
  else if (event.key === "0") view.fit();
  else order.key(event);
});

document.querySelector(".zoom").addEventListener("click", ({ target }) => {
  const kind = target.closest("button")?.dataset.zoom;
  if (kind === "fit") view.fit();
  else if (kind) view.zoom(kind === "in" ? 1.4 : 1 / 1.4);
});

setInterval(drawPanels, PANELS_MS);
setInterval(() => document.hidden || charts.draw(traffic), CHARTS_MS);

// For whoever looks at the page from outside, as its tests do: where on the canvas vehicles are.
window.gameopt = {
  places: () => (view.placed ?? []).map((placed) => {
    const [x, y] = view.middleOf(placed);
    return { vehicle: placed.car.vehicle, x, y, speed_mps: placed.car.speed_mps };
  }),
};
