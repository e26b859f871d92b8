// Lines, circles and handles in the picture, as SVG in pixels of the picture.

const SVG = "http://www.w3.org/2000/svg";
const TRAIL = 40; // frames of a track before the one that is shown

export function element(name, attributes = {}, parent = null) {
  const made = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  parent?.append(made);
  return made;
}

/** A line with a dark edge through points, interrupted where one is null. */
export function path(parent, points, kind) {
  let pen = "M";
  const steps = points.map((point) => {
    if (!point) {
      pen = "M";
      return "";
    }
    const step = `${pen}${point[0]} ${point[1]}`;
    pen = "L";
    return step;
  });
  const d = steps.join("");
  if (!d) return;
  element("path", { d, class: "halo" }, parent);
  element("path", { d, class: `line ${kind}` }, parent);
}

export function circle(parent, [cx, cy], r, kind) {
  element("circle", { cx, cy, r, class: "halo" }, parent);
  element("circle", { cx, cy, r, class: `line ${kind}` }, parent);
}

/** What was measured: of a clip as it is in this frame. */
export function marks(parent, found, view, frame) {
  for (const mark of found) {
    if (mark.view !== view) continue;
    const kind = mark.kind || "other";
    if (!mark.frames.length) still(parent, mark, kind);
    else if (kind === "track" || kind === "twin") track(parent, mark, frame, kind);
    else path(parent, mark.points.filter((_, k) => mark.frames[k] === frame), kind);
  }
}

function still(parent, mark, kind) {
  if (mark.points.length > 1) path(parent, mark.points, kind);
  else if (mark.points.length && mark.points[0]) circle(parent, mark.points[0], mark.radius || 5, kind);
}

function track(parent, mark, frame, kind) {
  const inTrail = (k) => mark.frames[k] <= frame && mark.frames[k] >= frame - TRAIL;
  path(parent, mark.points.filter((_, k) => inTrail(k)), kind);
  const at = mark.frames.indexOf(frame);
  if (at >= 0 && mark.points[at]) circle(parent, mark.points[at], mark.radius, kind);
}

/** A short line for the legend. */
export function sample(kind) {
  const shown = element("svg", { viewBox: "0 0 26 8" });
  element("path", { d: "M0 4H26", class: `line ${kind}` }, shown);
  return shown;
}
