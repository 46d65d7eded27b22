// Running charts: lines over the last two minutes, with the newest value in words.

const SPAN_S = 120;
const LEAST_SPAN_S = 30;
const INK = ["--line-a", "--line-b"];

// `lines` are arrays of [x, y]; the second one is dashed. `marks` are [x, words] for dashed uprights.
export function drawLines(canvas, lines, { from, to, least = 0, most, marks = [] }) {
  const ratio = window.devicePixelRatio || 1;
  const { width, height } = canvas.getBoundingClientRect();
  if (!width) return;
  canvas.width = Math.round(width * ratio);
  canvas.height = Math.round(height * ratio);
  const ink = canvas.getContext("2d");
  const style = getComputedStyle(document.documentElement);
  ink.scale(ratio, ratio);
  const top = most ?? nice(Math.max(1, ...lines.flat().map(([, y]) => y)));
  const [left, right, up, down] = [30, width - 4, 8, height - 6];
  const xOf = (x) => left + ((x - from) / (to - from)) * (right - left);
  const yOf = (y) => down - ((Math.min(y, top) - least) / (top - least)) * (down - up);
  ink.font = "11px system-ui, sans-serif";
  ink.textAlign = "right";
  ink.textBaseline = "middle";
  ink.strokeStyle = style.getPropertyValue("--grid");
  ink.fillStyle = style.getPropertyValue("--muted");
  for (const y of [least, (least + top) / 2, top]) {
    ink.beginPath();
    ink.moveTo(left, yOf(y));
    ink.lineTo(right, yOf(y));
    ink.stroke();
    ink.fillText(String(+y.toPrecision(3)), left - 5, yOf(y));
  }
  ink.lineJoin = "round";
  lines.forEach((line, k) => {
    ink.beginPath();
    line.forEach(([x, y], n) => (n ? ink.lineTo(xOf(x), yOf(y)) : ink.moveTo(xOf(x), yOf(y))));
    ink.strokeStyle = style.getPropertyValue(INK[k]);
    ink.lineWidth = 2;
    ink.setLineDash(k ? [5, 4] : []);
    ink.stroke();
  });
  ink.textAlign = "left";
  for (const [x, words] of marks) {
    ink.beginPath();
    ink.moveTo(xOf(x), up - 4);
    ink.lineTo(xOf(x), down);
    ink.strokeStyle = style.getPropertyValue("--text");
    ink.lineWidth = 1;
    ink.setLineDash([2, 3]);
    ink.stroke();
    ink.fillStyle = style.getPropertyValue("--text");
    ink.fillText(words, xOf(x) + 4, up + 2);
  }
}

// The next of 1, 2, 5, 10, … above a value.
function nice(value) {
  const power = 10 ** Math.floor(Math.log10(value));
  return power * [1, 2, 5, 10].find((step) => step * power >= value);
}

const CHARTS = [
  {
    id: "elapsed", title: "Control cycle", unit: "ms",
    hint: "time to decide, every 100 ms",
    lines: (history) => [history.map((past) => [past.time_s, past.elapsed_ms])],
    value: (traffic) => median(traffic.history.slice(-50).map((past) => past.elapsed_ms))?.toFixed(1),
  },
  {
    id: "throughput", title: "Throughput", unit: "veh/min",
    hint: "past the conflict zone, mean of 20 s",
    lines: (history) => [over(history, (grown, span_s) => (60 * grown.crossed_total) / span_s)],
    value: (traffic) => rate(traffic)?.toFixed(0),
  },
  {
    id: "waiting", title: "Waiting", unit: "vehicles",
    hint: "not cleared yet; dashed: standing",
    lines: (history) => [
      history.map((past) => [past.time_s, past.waiting]),
      history.map((past) => [past.time_s, past.standing]),
    ],
    value: ({ history }) => history[history.length - 1]?.waiting,
  },
  {
    id: "zone", title: "Time in zone", unit: "s",
    hint: "from entry until past the conflict zone, mean of 20 s",
    lines: (history) => [over(history, (grown) => grown.in_zone_total_s / grown.crossed_total)],
    value: (traffic) => {
      const [count] = traffic.grown("crossed_total", 20);
      return count ? (traffic.grown("in_zone_total_s", 20)[0] / count).toFixed(1) : undefined;
    },
  },
];

function rate(traffic) {
  const [count, span_s] = traffic.grown("crossed_total", 20);
  return span_s >= 5 ? (60 * count) / span_s : undefined;
}

// A quotient of what totals have grown by over the last 20 s, along the history; from 5 s on.
function over(history, quotient) {
  const found = [];
  let first = 0;
  for (const past of history) {
    while (history[first].time_s < past.time_s - 20) first += 1;
    const span_s = past.time_s - history[first].time_s;
    const grown = {};
    for (const name of ["crossed_total", "in_zone_total_s"]) grown[name] = past[name] - history[first][name];
    const value = quotient(grown, span_s);
    if (span_s >= 5 && Number.isFinite(value)) found.push([past.time_s, value]);
  }
  return found;
}

function median(values) {
  return values.sort((a, b) => a - b)[Math.floor(values.length / 2)];
}

export class Charts {
  constructor(section) {
    this.tiles = CHARTS.map((chart) => {
      const tile = document.createElement("figure");
      tile.id = `chart-${chart.id}`;
      tile.innerHTML = `<figcaption><span>${chart.title}</span><b></b> <i>${chart.unit}</i></figcaption>
        <canvas aria-hidden="true"></canvas><p>${chart.hint}</p>`;
      section.append(tile);
      return { chart, value: tile.querySelector("b"), canvas: tile.querySelector("canvas") };
    });
  }

  draw(traffic) {
    const { history } = traffic;
    if (!history.length) return;
    const now_s = history[history.length - 1].time_s;
    const span_s = Math.min(SPAN_S, Math.max(LEAST_SPAN_S, now_s - history[0].time_s));
    for (const { chart, value, canvas } of this.tiles) {
      value.textContent = chart.value(traffic) ?? "–";
      drawLines(canvas, chart.lines(history), { from: now_s - span_s, to: now_s });
    }
  }
}
