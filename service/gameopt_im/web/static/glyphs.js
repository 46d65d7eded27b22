// How a vehicle is drawn, on the map and in the legend. Every status has a colour and a form of its own, so that
// none is told by colour alone; colours are those of Okabe and Ito.

export const COLOURS = {
  waiting: "#E69F00", offered: "#56B4E9", cleared: "#009E73", withdrawn: "#CC79A7", leaving: "#8b959e",
  intruding: "#D55E00",
};

export const STATUS_WORDS = {
  waiting: "waits for its turn", offered: "is offered a clearance", cleared: "cleared to cross",
  withdrawn: "clearance asked back", leaving: "has crossed", intruding: "in the zone without a clearance",
};

const INK = "#11161b";
const PAPER = "#ffffff";

export function isTrouble(car) {
  return car.silent || car.fallback || car.status === "intruding" || car.status === "withdrawn";
}

// The front at the origin, heading along +x; `scale` is in pixels a metre, `length` and `width` in pixels.
export function drawVehicle(ink, car, length, width) {
  const colour = COLOURS[car.status];
  const open = car.status === "waiting" || car.status === "offered";
  const nose = open ? 0 : Math.min(0.35 * length, 0.75 * width);
  ink.beginPath();
  ink.moveTo(-length, -width / 2);
  ink.lineTo(-nose, -width / 2);
  if (nose) ink.lineTo(0, 0);
  else ink.lineTo(0, width / 2);
  ink.lineTo(-nose, width / 2);
  ink.lineTo(-length, width / 2);
  ink.closePath();
  ink.lineJoin = "round";
  ink.setLineDash([]);
  ink.lineWidth = open ? Math.max(3.4, 0.46 * width) : 2;
  ink.strokeStyle = INK;
  ink.stroke();
  ink.fillStyle = open ? PAPER : colour;
  ink.fill();
  if (open) {
    ink.lineWidth = Math.max(1.8, 0.26 * width);
    ink.strokeStyle = colour;
    if (car.status === "offered") ink.setLineDash([ink.lineWidth * 1.6, ink.lineWidth]);
    ink.stroke();
    ink.setLineDash([]);
  }
  drawClass(ink, car, length, width, open ? INK : PAPER);
  if (isTrouble(car)) drawTrouble(ink, car, length, width);
}

// A bar behind the cab of a truck, three across a bus, a cross on an emergency vehicle.
function drawClass(ink, car, length, width, colour) {
  const kind = classOf(car.vehicle_class);
  ink.strokeStyle = colour;
  ink.lineWidth = Math.max(1.2, 0.16 * width);
  const bars = { truck: [0.32], bus: [0.25, 0.5, 0.75] }[kind] ?? [];
  ink.beginPath();
  for (const share of bars) {
    ink.moveTo(-share * length, -0.42 * width);
    ink.lineTo(-share * length, 0.42 * width);
  }
  if (kind === "emergency") {
    const [x, arm] = [-0.55 * length, 0.36 * width];
    ink.lineWidth = Math.max(1.6, 0.26 * width);
    ink.moveTo(x - arm, 0);
    ink.lineTo(x + arm, 0);
    ink.moveTo(x, -arm);
    ink.lineTo(x, arm);
  }
  ink.stroke();
}

// A dashed ring round a silent vehicle, a full one round one on its own; both in vermillion.
function drawTrouble(ink, car, length, width) {
  ink.beginPath();
  ink.ellipse(-length / 2, 0, 0.5 * length + 5, 0.5 * width + 6, 0, 0, 2 * Math.PI);
  ink.strokeStyle = COLOURS.intruding;
  ink.lineWidth = 2.4;
  ink.setLineDash(car.silent ? [5, 4] : []);
  ink.stroke();
  ink.setLineDash([]);
}

export function classOf(name) {
  if (/emergency|police|ambulance|fire/i.test(name)) return "emergency";
  if (/bus|coach/i.test(name)) return "bus";
  if (/truck|trailer|delivery/i.test(name)) return "truck";
  return "car";
}

const SAMPLES = [
  ["waits for its turn", { status: "waiting", vehicle_class: "passenger" }, 24, 10],
  ["is offered a clearance", { status: "offered", vehicle_class: "passenger" }, 24, 10],
  ["cleared to cross", { status: "cleared", vehicle_class: "passenger" }, 24, 10],
  ["has crossed", { status: "leaving", vehicle_class: "passenger" }, 24, 10],
  ["truck", { status: "cleared", vehicle_class: "truck" }, 30, 11],
  ["emergency", { status: "cleared", vehicle_class: "emergency" }, 28, 11],
  ["in the zone without clearance", { status: "intruding", vehicle_class: "passenger" }, 18, 8],
  ["silent", { status: "waiting", vehicle_class: "passenger", silent: true }, 18, 8],
  ["on its own fallback", { status: "waiting", vehicle_class: "passenger", fallback: true }, 18, 8],
];

export function glyph(car, length, width) {
  const canvas = document.createElement("canvas");
  const ratio = window.devicePixelRatio || 1;
  const [wide, high] = [length + 14, 24];
  canvas.width = wide * ratio;
  canvas.height = high * ratio;
  canvas.style.width = `${wide}px`;
  canvas.style.height = `${high}px`;
  canvas.setAttribute("aria-hidden", "true");
  const ink = canvas.getContext("2d");
  ink.scale(ratio, ratio);
  ink.translate(length + 7, high / 2);
  drawVehicle(ink, car, length, width);
  return canvas;
}

export function fillLegend(list) {
  for (const [words, car, length, width] of SAMPLES) {
    const item = document.createElement("li");
    item.append(glyph(car, length, width), words);
    list.append(item);
  }
  for (const [kind, words] of [["area", "conflict area, filled while in use"], ["line", "stop line"]]) {
    const item = document.createElement("li");
    const mark = document.createElement("span");
    mark.className = `mark ${kind}`;
    item.append(mark, words);
    list.append(item);
  }
}
