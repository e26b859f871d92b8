// What can be stated by drag, by its key in lab.toml: how it is drawn, and the text that is written.
//
// A shape is a list of points in pixels of the picture.  `shape` makes it of what is stated, `found` of what was
// measured, `text` the value of the key, `drag` the shape of a drag from one point to another.

const round = (value) => String(Math.round(value * 10) / 10);
const joined = (...values) => values.map(round).join(",");
const ends = (points) => joined(...points.flat());
const apart = ([a, b]) => Math.hypot(b[0] - a[0], b[1] - a[1]);
const corners = ([x, y, width, height]) => [[x, y], [x + width, y + height]];
const box = ([[a, b], [c, d]]) => joined(Math.min(a, c), Math.min(b, d), Math.abs(c - a), Math.abs(d - b));
const drawnLine = (a, b) => [a, b];

/** Both ends of a line that was found; of one that moves those of its first frame, in that frame. */
const ofKind = (kind) => (marks, frame) => {
  const mark = marks.find((each) => each.kind === kind && each.points.length > 1);
  if (!mark || (mark.frames.length && mark.frames[0] !== frame)) return null;
  return [mark.points[0], mark.points[mark.frames.length ? 1 : mark.points.length - 1]];
};

const line = (label, kind) => ({
  label, form: "line", shape: (value) => value, text: ends, drag: drawnLine, found: ofKind(kind),
});

export const PLACES = {
  base: { ...line("Base line", "base"), hint: "Drag from the left to the right end of the line that the heap stands on." },
  cylinder: { ...line("Cylinder walls", "base"), hint: "Drag from one inner wall to the other, at the floor." },
  floor: {
    label: "Floor", form: "level", hint: "Click at the height of the floor.",
    shape: (value) => [[0, value]], text: ([[, y]]) => round(y), drag: (a, b) => [[0, b[1]]], found: () => null,
  },
  circle: {
    label: "Inner rim", form: "circle", hint: "Drag from the axis of the drum to its inner rim.",
    shape: ([x, y, radius]) => [[x, y], [x + radius, y]],
    text: (points) => joined(...points[0], apart(points)), drag: drawnLine,
    found: (marks) => {
      const rim = marks.find((mark) => mark.kind === "circle" && mark.radius > 0);
      return rim ? [rim.points[0], [rim.points[0][0] + rim.radius, rim.points[0][1]]] : null;
    },
  },
  slot: { ...line("Slot", "slot"), hint: "Drag from one edge of the outlet to the other, where the beads leave it." },
  plate: { ...line("Plate", "plate"), hint: "Drag along the surface of the plate; of a tilt as it is in the first frame." },
  pivot: {
    label: "Pivot", form: "points", hint: "Click at the point that the thread hangs from; of two beads first A, then B.",
    shape: (value) => value, text: (points) => points.map((point) => joined(...point)), most: 2,
    found: (marks) => {
      const points = marks.filter((mark) => mark.kind === "pivot").map((mark) => mark.points[0]);
      return points.length ? points : null;
    },
  },
  bead_at: {
    label: "Bead", form: "points", hint: "Click at the centre of the bead in this frame.", framed: true, most: 1,
    shape: (value) => [value.at], text: ([point], frame) => `${frame}:${joined(...point)}`, found: () => null,
  },
  centre: {
    label: "Centre", form: "points", several: true, framed: true,
    hint: "Click at the centre of the bead in this frame, where it is located wrongly or not at all.",
    shape: (value) => [value.at], text: ([point], frame) => `${frame}:${joined(...point)}`, found: () => null,
  },
  known_length: {
    label: "Known length", form: "line", hint: "Drag along a length that you know, then write it.", asks: "Length",
    shape: (value) => [value.start, value.end], drag: drawnLine, found: () => null,
    text: (points, _frame, length) => `${length}:${ends(points)}`,
    given: (value) => `${Number((value.length * 1000).toPrecision(10))} mm`,
  },
  region: {
    label: "Region", form: "box", hint: "Drag around the part of the picture that is looked at.",
    shape: corners, text: box, drag: drawnLine, found: () => null,
  },
  ignore: {
    label: "Ignore", form: "box", several: true, hint: "Drag around what disturbs: a lamp, a hand, a reflection.",
    shape: corners, text: box, drag: drawnLine, found: () => null,
  },
};

/** Several shapes of one key, or the only one. */
export const shapesOf = (key, value) =>
  PLACES[key].several ? value.map(PLACES[key].shape) : [PLACES[key].shape(value)];

/** The points of a shape as they are drawn. */
export function outline(form, points, size) {
  if (form === "box" && points.length > 1) {
    const [[a, b], [c, d]] = points;
    return [[a, b], [c, b], [c, d], [a, d], [a, b]];
  }
  if (form === "level") return [[0, points[0][1]], [size.width, points[0][1]]];
  return points;
}

export const radius = apart;
