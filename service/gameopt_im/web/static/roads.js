// The ground, from the intersection map. The map knows each movement's path across the conflict zone, and how long
// lanes and exits are, not how they bend: before their stop lines the lanes of an approach are drawn straight and side
// by side, along its straightest movement, and exits go straight on. Lane width is the distance to the next lane.

const EXIT_M = 150;
const DEFAULT_WIDTH_M = 3.2;

export class Roads {
  constructor(map) {
    this.map = map;
    const approaches = headings(map);
    this.movements = map.movements.map((movement) => {
      const lane = map.lanes[movement.lane];
      return stretched(movement, lane, approaches.get(lane.approach));
    });
    this.lanes = map.lanes.map((lane, k) => {
      const drawn = this.movements.find((_, m) => map.movements[m].lane === k);
      return drawn && { ...lane, line: drawn.line, back: drawn.back, start: drawn.points[0] };
    }).filter(Boolean);
    this.width = laneWidth(this.lanes.map((lane) => lane.line));
    this.areas = map.areas.map((area) => this.areaOf(area)).filter(Boolean);
    const lines = this.movements.flatMap((movement) => movement.core);
    const [xs, ys] = [lines.map(([x]) => x), lines.map(([, y]) => y)];
    this.plaza = hull(map.areas.flatMap(({ a, b }) => [a, b]).map((m) => middle(this.movements[m].core)));
    this.centre = [(Math.min(...xs) + Math.max(...xs)) / 2, (Math.min(...ys) + Math.max(...ys)) / 2];
    this.coreRadius = Math.max(...lines.map((point) => distance(point, this.centre)));
    this.radius = Math.max(...this.lanes.map((lane) => distance(lane.start, this.centre)));
  }

  // Where the point `distance_m` before the stop line is (negative past it), and its heading; null beyond what is drawn.
  place(movement, distance_m) {
    const { points, at, zone_m } = this.movements[movement];
    const s = zone_m - distance_m;
    if (s < -60 || s > at[at.length - 1]) return null;
    let k = 1;
    while (k < at.length - 1 && at[k] < s) k += 1;
    const [[x0, y0], [x1, y1]] = [points[k - 1], points[k]];
    const share = (s - at[k - 1]) / (at[k] - at[k - 1] || 1);
    return { x: x0 + share * (x1 - x0), y: y0 + share * (y1 - y0), heading: Math.atan2(y1 - y0, x1 - x0) };
  }

  // The way of a movement from `from_m` to `to_m` past the stop line, as points.
  stretch(movement, from_m, to_m) {
    const { points, at, zone_m } = this.movements[movement];
    const ends = [from_m, to_m].map((m) => this.place(movement, -m)).filter(Boolean).map(({ x, y }) => [x, y]);
    if (ends.length < 2) return [];
    const between = points.filter((_, k) => at[k] > zone_m + from_m && at[k] < zone_m + to_m);
    return [ends[0], ...between, ends[1]];
  }

  // The ground that two cars' bodies share: where the band of one movement lies on the other's.
  areaOf({ a, b, a_windows_m, b_windows_m }) {
    const [mine, its] = [a_windows_m[0][0], b_windows_m[0][0]];
    if (!mine || !its) return null;
    const bands = [[a, mine], [b, its]].map(([movement, [entry, exit]]) =>
      band(this.stretch(movement, entry, Math.max(exit, entry + 0.5)), this.width / 2 - 0.3));
    return bands.every((points) => points.length) ? { a, b, bands, a_windows_m, b_windows_m } : null;
  }
}

// The direction in which each approach leads away from the junction: that of its straightest movement.
function headings(map) {
  const straightest = new Map();
  for (const movement of map.movements) {
    const [first, last] = [tangent(movement.path), tangent([...movement.path].reverse())];
    const bend = Math.abs(Math.hypot(first[0] + last[0], first[1] + last[1]));
    const { approach } = map.lanes[movement.lane];
    if (bend < (straightest.get(approach)?.bend ?? Infinity)) straightest.set(approach, { bend, back: first });
  }
  return new Map([...straightest].map(([approach, { back }]) => [approach, back]));
}

// The direction in which a path would go on beyond its first point: its first two chords tell how it bends there.
function tangent([first, second, third]) {
  const chord = unit(second, first);
  if (!third) return chord;
  const next = unit(third, second);
  const turn = Math.atan2(next[0] * chord[1] - next[1] * chord[0], next[0] * chord[0] + next[1] * chord[1]) / 2;
  const [cos, sin] = [Math.cos(turn), Math.sin(turn)];
  return [cos * chord[0] - sin * chord[1], sin * chord[0] + cos * chord[1]];
}

function stretched(movement, { zone_m }, back) {
  const path = movement.path;
  const line = path[0];
  const last = path[path.length - 1];
  const on = tangent([...path].reverse());
  const exit_m = Math.min(EXIT_M, movement.exit_length_m);
  const start = [line[0] + zone_m * back[0], line[1] + zone_m * back[1]];
  const end = [last[0] + exit_m * on[0], last[1] + exit_m * on[1]];
  const points = [start, ...path, end];
  // The path's own length differs a little from the map's along curves: distances are scaled to the map's.
  const core = lengths(path);
  const scale = movement.length_m / (core[core.length - 1] || 1);
  const at = [0, ...core.map((m) => zone_m + m * scale), zone_m + movement.length_m + exit_m];
  return { points, at, zone_m, line, back, core: path, exit: [last, end] };
}

function middle(path) {
  const [first, last] = [path[0], path[path.length - 1]];
  return path.length > 2 ? path[Math.floor(path.length / 2)] : [(first[0] + last[0]) / 2, (first[1] + last[1]) / 2];
}

function lengths(points) {
  let sum = 0;
  return points.map((point, k) => (sum += k ? distance(point, points[k - 1]) : 0));
}

function laneWidth(lines) {
  const near = lines.map((line) => Math.min(...lines.map((other) => distance(line, other)).filter((m) => m > 1)));
  const least = Math.min(...near.filter((m) => m < 6));
  return Number.isFinite(least) ? Math.min(4, Math.max(2.6, least)) : DEFAULT_WIDTH_M;
}

// A polygon `half` metres to both sides of a line.
export function band(points, half) {
  if (points.length < 2) return [];
  const sides = points.map((point, k) => {
    const [dx, dy] = unit(points[Math.max(0, k - 1)], points[Math.min(points.length - 1, k + 1)]);
    return [[point[0] - half * dy, point[1] + half * dx], [point[0] + half * dy, point[1] - half * dx]];
  });
  return [...sides.map(([left]) => left), ...sides.map(([, right]) => right).reverse()];
}

// The convex hull of points, by Andrew's monotone chain.
export function hull(points) {
  const sorted = [...points].sort(([x0, y0], [x1, y1]) => x0 - x1 || y0 - y1);
  const chain = (half, point) => {
    while (half.length > 1) {
      const [[x0, y0], [x1, y1]] = half.slice(-2);
      if ((x1 - x0) * (point[1] - y0) - (y1 - y0) * (point[0] - x0) > 0) break;
      half.pop();
    }
    return [...half, point];
  };
  return [...sorted.reduce(chain, []), ...sorted.reverse().reduce(chain, []).slice(1, -1)];
}

export function distance([x0, y0], [x1, y1]) {
  return Math.hypot(x1 - x0, y1 - y0);
}

export function unit(from, to) {
  const far = distance(from, to) || 1;
  return [(to[0] - from[0]) / far, (to[1] - from[1]) / far];
}
