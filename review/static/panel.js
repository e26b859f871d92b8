// The right side: numbers, what is stated, parts of the clip, the verdict.

import { sample } from "./drawing.js";
import { PLACES } from "./places.js";

const $ = (id) => document.getElementById(id);

export function node(name, attributes = {}, ...inner) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (key.startsWith("on")) made.addEventListener(key.slice(2), value);
    else if (value !== false && value !== null) made.setAttribute(key, value);
  }
  made.append(...inner.filter((each) => each !== null && each !== undefined));
  return made;
}

const WORDS = {
  track: "place in each frame", fit: "fitted path", outline: "outline", base: "base or floor",
  graphical: "graphical: line along the slope", geometric: "geometric: foot to apex", plate: "plate", slot: "slot",
  circle: "wall or rim", contact: "contact", twin: "twin", pivot: "pivot", stated: "stated in lab.toml",
};

// ------------------------------------------------------------------------------------------------------- numbers

const MEASURING = "measuring ...";
const nameOf = (quantity) => `${quantity.title}|${quantity.method}`;

/** `result` is what the server sent, `before` the one before the last change; null where there is none, with the reason. */
export function showResult(result, before = null, why = MEASURING) {
  $("refused").hidden = !result?.refused;
  $("refused").textContent = result?.refused ?? "";
  $("state").textContent = result ? `(in ${result.seconds.toFixed(1)} s)` : why;
  $("numbers").setAttribute("aria-busy", String(!result && why === MEASURING));
  if (!result) {
    delete document.documentElement.dataset.result;
    return;
  }
  document.documentElement.dataset.result = result.key;
  const old = new Map((before?.quantities ?? []).map((each) => [nameOf(each), each.text]));
  $("numbers").tBodies[0].replaceChildren(...(result.quantities ?? []).map((each) => row(each, old.get(nameOf(each)))));
  $("scale").textContent = result.scale ? `Scale: ${result.scale}` : "";
  const failed = (result.checks ?? []).filter((check) => !check.passed).map((check) => check.message);
  $("warnings").replaceChildren(...[...failed, ...(result.warnings ?? [])].map((each) => node("li", {}, each)));
}

function row(quantity, before) {
  const changed = before !== undefined && before !== quantity.text;
  return node(
    "tr",
    { "data-quantity": quantity.quantity, "data-method": quantity.method, "data-value": quantity.value },
    node("td", {}, quantity.title, node("small", {}, quantity.method),
      quantity.doubtful ? node("small", { class: "doubtful" }, `Doubtful: ${quantity.doubtful}`) : null),
    node("td", {}, quantity.text, changed ? node("s", { title: "before the last change" }, before) : null),
  );
}

export function showLegend(marks, stated) {
  const kinds = new Set(marks.map((mark) => mark.kind).filter((kind) => kind in WORDS));
  if (Object.keys(stated).some((key) => key in PLACES)) kinds.add("stated");
  $("legend").replaceChildren(...[...kinds].map((kind) => node("span", {}, sample(kind), WORDS[kind])));
}

// -------------------------------------------------------------------------------------------------- what is stated

/** One line for each key: button, what stands in lab.toml, and buttons that take it out. */
export function showTools(keys, view, actions) {
  const shown = Object.keys(PLACES).filter((key) => keys.includes(key));
  $("tools").replaceChildren(...shown.map((key, number) => tool(key, number, view, actions)));
}

function tool(key, number, view, actions) {
  const place = PLACES[key];
  const stated = view.stated[key];
  const values = stated === undefined ? [] : place.several ? stated : [stated];
  return node(
    "div",
    { class: "tool", "data-key": key },
    node("button", {
      type: "button", "aria-pressed": String(actions.tool === key), title: place.hint, onclick: () => actions.choose(key),
    }, number < 9 ? `${number + 1}  ${place.label}` : place.label),
    values.length ? node("code", {}, `${inWords(key, stated)}${view.own.includes(key) ? " (this file)" : ""}`) : null,
    ...values.map((_, index) => node("button", {
      type: "button", title: "Take it out of lab.toml", "aria-label": `Remove ${place.label} ${index + 1}`,
      onclick: () => actions.remove(key, index),
    }, "×")),
  );
}

function inWords(key, value) {
  const place = PLACES[key];
  const values = place.several ? value : [value];
  return values.map((each) => place.text(place.shape(each), each.frame, place.given?.(each))).join("; ");
}

// ------------------------------------------------------------------------------------------------ part of the clip

const moment = ({ value, unit }) => (unit === "frame" ? `frame ${value}` : `${value} s`);

/** The first frame at a moment or after it; behind the clip the last one. */
function frameOf({ value, unit }, times) {
  const frame = unit === "frame" ? Math.round(value) : times.findIndex((time) => time >= value - 1e-9);
  return frame < 0 ? times.length - 1 : Math.min(frame, times.length - 1);
}

/** The part of a clip that is left out, from a frame to the one behind it; both ends belong to it. */
function spanOf([a, b], times) {
  const first = a.unit === "frame" ? Math.ceil(a.value) : times.findIndex((time) => time >= a.value - 1e-9);
  const last = b.unit === "frame" ? Math.floor(b.value) : times.findLastIndex((time) => time <= b.value + 1e-9);
  return [first < 0 ? times.length : first, Math.min(last, times.length - 1) + 1];
}

export function showParts(view, times, actions) {
  const { start, end, exclude = [] } = view.stated;
  const entry = (words, remove) => node("li", {}, node("code", {}, words),
    node("button", { type: "button", title: "Take it out of lab.toml", "aria-label": `Remove: ${words}`, onclick: remove }, "×"));
  $("parts").replaceChildren(
    ...(start ? [entry(`begins at ${moment(start)}`, () => actions.set("start", null))] : []),
    ...(end ? [entry(`ends at ${moment(end)}`, () => actions.set("end", null))] : []),
    ...exclude.map(([a, b], index) => entry(`left out: ${moment(a)} to ${moment(b)}`, () => actions.include(index))),
  );
  const spans = exclude.map((each) => spanOf(each, times)).filter(([a, b]) => b > a);
  if (start) spans.push([0, frameOf(start, times)]);
  if (end) spans.push([frameOf(end, times) + 1, times.length]);
  $("spans").replaceChildren(...spans.map(([a, b]) => {
    const bar = node("i");
    bar.style.left = `${(100 * a) / times.length}%`;
    bar.style.width = `${(100 * Math.max(b - a, 0)) / times.length}%`;
    return bar;
  }));
}

// ------------------------------------------------------------------------------------------------- beside the twin

/** A repetition beside its twin that was run here, or what the last comparison found of the experiment. */
export function showTwin(compared, id, { canRun, beside }) {
  const rows = beside?.rows ?? compared.rows?.[id] ?? [];
  $("twin-part").hidden = !rows.length && !canRun;
  $("twin-run-row").hidden = !canRun || Boolean(beside && !beside.refused);
  $("twin-old").hidden = !compared.changed_since || !compared.rows?.[id] || Boolean(beside);
  $("twin-state").textContent = beside?.refused ?? (!rows.length || beside ? "" : "(last comparison)");
  $("twin").hidden = !rows.length;
  $("twin").tBodies[0].replaceChildren(...rows.map((row) => node("tr", { title: row.verdict },
    node("td", {}, row.title, node("small", { class: "faint" }, ` ${row.method}`)),
    node("td", {}, row.measured), node("td", {}, row.simulated), node("td", {}, row.deviation))));
}

// --------------------------------------------------------------------------------------------------------- verdict

export function showVerdict(view) {
  const rejected = Boolean(view.rejected);
  if (document.activeElement !== $("reason") || rejected) $("reason").value = view.rejected;
  $("reason").readOnly = rejected;
  $("reject").hidden = rejected;
  $("reject").textContent = view.kind === "photo" ? "Reject this photo" : "Reject this clip";
  $("accept").hidden = !rejected;
}
