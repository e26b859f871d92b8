// The page: which repetition is shown, its measurement, and changes of lab.toml.

import { get, post, resultAddress } from "./api.js";
import { open as openFigures, showFigures } from "./gallery.js";
import { node, showLegend, showParts, showResult, showTools, showTwin, showVerdict } from "./panel.js";
import { PLACES } from "./places.js";
import { Stage } from "./stage.js";

const $ = (id) => document.getElementById(id);
const SLOWEST = 4; // frames per second of a clip that is played, and the fastest a screen needs
const FASTEST = 30;
const PASSING = 250; // [ms]
const AGAIN = 1000; // [ms], between two attempts to read lab.toml: soon for a person who comes back from an editor

const shown = { experiment: -1, repetition: -1, view: -1 };
const results = new Map(); // experiment/repetition -> last result
const twins = new Map(); // experiment/repetition -> its twin, with the key of the result that it belongs to
let lab = null;
let tool = null;
let from = null; // first frame of a part that is about to be left out
let waiting = null; // aborts the request for a result that is not wanted any more
let playing = null;
let looking = false; // whether lab.toml is read again and again until it can be
let changes = 0; // answered ones, of lab.toml

const stage = new Stage({ onPlace: placed, onRemove: remove, onFrame: frameShown, onProblem: problem });

const experiment = () => lab.experiments[shown.experiment];
const views = () => experiment().repetitions[shown.repetition];
const view = () => views()[shown.view];
const place = () => `${shown.experiment}/${shown.repetition}`;

function problem(error) {
  $("problem").hidden = !error;
  $("problem").textContent = error?.message ?? "";
  if (error && !error.ended) untilReadable();
}

/** Where lab.toml cannot be read, an edit in another program say, go on as soon as it can. */
async function untilReadable() {
  if (looking || !lab) return;
  looking = true;
  let broken = false;
  try {
    for (;;) {
      try {
        const found = await get("/api/lab");
        if (!broken) return; // the refusal was of something else
        lab = found;
        break;
      } catch (error) {
        broken = true;
        $("problem").hidden = false;
        $("problem").textContent = error.message;
        if (error.ended) return;
      }
      await new Promise((go) => setTimeout(go, AGAIN));
    }
  } finally {
    looking = false;
  }
  problem(null);
  await select(shown);
}

// ------------------------------------------------------------------------------------------------------- lab.toml

async function changed(address, body) {
  try {
    lab = await post(address, body);
    problem(null);
  } catch (error) {
    problem(error);
  }
  showAll();
  changes += 1;
  document.documentElement.dataset.changes = changes;
  await select(shown);
}

/** Write one key; for this file or for all repetitions, as the person chose. */
function set(key, value, forFile = scope(key) === "file") {
  return changed("/api/set", { experiment: shown.experiment, key, value, file: forFile ? view().name : null });
}

const undo = () => changed("/api/undo", {});

/** What an entry is for: where it stands already, it stays. */
function scope(key) {
  if (view().own.includes(key)) return "file";
  return document.querySelector("[name=scope]:checked").value;
}

function placed(key, points, index) {
  const kind = PLACES[key];
  const before = view().stated[key];
  let value;
  const moved = before !== undefined && !tool; // by one of its handles: frame and length stay
  if (kind.asks && !moved) {
    askLength(key, points, before === undefined ? "100 mm" : kind.given(before));
    return;
  }
  const frame = kind.framed && moved && !kind.several ? before.frame : stage.index;
  const text = kind.text(points, frame, moved ? kind.given?.(before) : undefined);
  if (kind.several) {
    value = (before ?? []).map((each) => kind.text(kind.shape(each), each.frame));
    value.splice(index < 0 ? value.length : index, 1, text);
  } else {
    value = text;
  }
  choose(null);
  set(key, value);
}

/** A known length is dragged, then its length is written. */
function askLength(key, points, given) {
  const input = node("input", { id: "length", size: 8, "aria-label": "Length with its unit", value: given });
  const form = node("form", {
    onsubmit: (event) => {
      event.preventDefault();
      choose(null);
      set(key, PLACES[key].text(points, 0, input.value.trim()));
    },
  }, "This length is ", input, node("button", {}, "Write"));
  $("hint").replaceChildren(form);
  input.focus();
  input.select();
}

function remove(key, index) {
  const kind = PLACES[key];
  const left = kind.several ? view().stated[key].filter((_, k) => k !== index).map((each) => kind.text(kind.shape(each), each.frame)) : [];
  set(key, left.length ? left : null, view().own.includes(key));
}

const span = ([a, b]) => [a, b].map(({ value, unit }) => (unit === "frame" ? `${value}f` : `${value} s`)).join("..");

function include(index) {
  const left = view().stated.exclude.filter((_, k) => k !== index).map(span);
  set("exclude", left.length ? left : null, view().own.includes("exclude"));
}

/** Leave out the frames from one to the one that is shown. */
function leaveOut(first) {
  if (first === null) return;
  const [a, b] = [Math.min(first, stage.index), Math.max(first, stage.index)];
  from = null;
  set("exclude", [...(view().stated.exclude ?? []).map(span), `${a}f..${b}f`]);
}

function leaveOutFrom() {
  from = stage.index;
  $("span-to").disabled = false;
  $("hint").textContent = `Left out from frame ${from}: go to the last frame that is left out, then press "to here".`;
}

// --------------------------------------------------------------------------------------------------------- showing

async function select({ experiment: e, repetition: r, view: v }) {
  const other = `${e}/${r}/${v}` !== `${place()}/${shown.view}`;
  Object.assign(shown, { experiment: e, repetition: r, view: v });
  if (other) {
    waiting?.abort();
    showResult(null);
    stop();
    choose(null, false);
    from = null;
  }
  location.hash = `${e}/${r}/${v}`;
  showAll();
  // of a medium that is not shown yet the picture comes first: measuring takes all of the processor
  const measured = other ? null : showMeasured();
  try {
    if (["photo", "clip"].includes(view().kind)) await stage.open(`${place()}/${v}`, v, middle());
    else stage.close(`${view().name} is a ${view().kind}: there is no picture.`);
  } catch (error) {
    stage.close(error.message);
  }
  showFilm();
  await (measured ?? showMeasured(true));
}

/** Of the marks of a clip the frame in the middle, where most is seen; the first one else. */
function middle() {
  const frames = (results.get(place())?.marks ?? []).flatMap((mark) => mark.frames);
  return frames.length ? frames[Math.floor(frames.length / 2)] : 0;
}

function showAll() {
  $("title").textContent = lab.title;
  $("path").textContent = lab.path;
  $("undo").disabled = !lab.can_undo;
  showList();
  const many = experiment().repetitions.flat().length > 1;
  document.querySelector("[name=scope][value=file]").disabled = !many;
  if (!document.querySelector("[name=scope]:checked") || !many) {
    document.querySelector(`[name=scope][value=${many ? "file" : "all"}]`).checked = true;
  }
  $("scope-file").textContent = view().kind === "photo" ? "this photo" : "this clip";
  $("views").replaceChildren(...(views().length > 1 ? views().map((each, v) => node("button", {
    type: "button", "aria-pressed": String(v === shown.view), onclick: () => select({ ...shown, view: v }),
  }, each.name.split("/").pop())) : []));
  $("film").hidden = view().kind !== "clip"; // before the picture comes, which must not move then
  showVerdict(view());
  showTwinPart();
  stage.stated = view().stated;
  stage.keys = experiment().keys;
  showTools(experiment().keys, view(), { tool, choose, remove });
  showLegend(stage.marks.filter((mark) => mark.view === shown.view), view().stated);
  $("results").replaceChildren(...lab.results.filter((name) => name.endsWith(".html")).map((name) =>
    node("a", { href: resultAddress(name), target: "_blank", rel: "noopener" }, name.split("/").pop().replace(".html", ""))));
  showFigures(lab.figures);
  stage.draw();
}

function showList() {
  $("list").replaceChildren(...lab.experiments.flatMap((one, e) => [
    node("h2", {}, one.id, " ", node("small", {}, [one.rig, one.variant].filter(Boolean).join(", "))),
    node("ul", {}, ...one.repetitions.map((each, r) => {
      const current = e === shown.experiment && r === shown.repetition;
      const rejected = each.every((file) => file.rejected);
      const found = results.get(`${e}/${r}`);
      const doubtful = found?.quantities?.some((quantity) => quantity.doubtful);
      const mark = rejected ? "rejected" : found?.refused ? "not measured" : doubtful ? "doubtful" : "";
      const label = each.length > 1 ? `${each[0].name} and ${each.length - 1} more` : each[0].name;
      return node("li", {}, node("button", {
        type: "button", "aria-current": String(current), class: rejected ? "rejected" : "",
        title: rejected ? `Rejected: ${each[0].rejected}` : "", onclick: () => select({ experiment: e, repetition: r, view: 0 }),
      }, label, mark ? node("small", { class: "mark" }, mark) : null));
    })),
  ]));
}

/** The twin of this very clip, where it was run for the settings that are shown. */
const beside = () => {
  const known = twins.get(place());
  return known && known.key === results.get(place())?.key ? known : null;
};

function showTwinPart() {
  const canRun = experiment().twin_in_step && view().kind === "clip";
  showTwin(lab.compared, experiment().id, { canRun, beside: canRun ? beside() : null });
}

/** Run the twin of this clip; it is drawn in each frame beside what was measured. */
async function runTwin() {
  const [key, result] = [place(), results.get(place())];
  if (!result || result.refused || $("twin-run-row").hidden) return;
  $("twin-state").textContent = "(the twin runs ...)";
  try {
    const found = await get(`/api/twin/${key}`);
    twins.set(key, { ...found, key: result.key });
  } catch (error) {
    problem(error);
  }
  if (key !== place()) return;
  showTwinPart();
  showMarks();
}

/** The lines of what was measured, and of the twin where there is one. */
function showMarks() {
  stage.marks = [...(results.get(place())?.marks ?? []), ...(beside()?.marks ?? [])];
  showLegend(stage.marks.filter((mark) => mark.view === shown.view), view().stated);
  stage.draw();
}

/** Ask for the measurement; the server answers as soon as it is there. */
async function showMeasured(passing = false) {
  waiting?.abort();
  waiting = new AbortController();
  const key = place();
  const before = results.get(key);
  showResult(null);
  let result;
  try {
    if (passing) await rested(waiting.signal);
    result = await get(`/api/result/${key}`, waiting.signal);
  } catch (error) {
    if (error.name === "AbortError") return;
    showResult(null, null, "not measured");
    problem(error);
    return;
  }
  if (key !== place()) return;
  results.set(key, result);
  showResult(result, before?.key === result.key ? before.before : before);
  result.before = before?.key === result.key ? before.before : before;
  showList();
  showTwinPart();
  showMarks();
  if (stage.film && result.frame) stage.show(result.frame);
}

/** A moment, in which a person who only passes by has gone on. */
const rested = (signal) => new Promise((go, stopped) => {
  const timer = setTimeout(go, PASSING);
  signal.addEventListener("abort", () => { clearTimeout(timer); stopped(signal.reason); });
});

function showFilm() {
  $("film-part").hidden = !stage.film;
  if (!stage.film) {
    $("film").hidden = true; // a clip that cannot be decoded
    return;
  }
  $("slider").max = stage.media.times.length - 1;
  $("span-to").disabled = from === null;
  showParts(view(), stage.media.times, { set: (key, value) => set(key, value, view().own.includes(key)), include });
  frameShown(stage.index);
}

function frameShown(index) {
  if (!stage.film || index < 0) return;
  if (index === stage.wanted) $("slider").value = index; // not while it is dragged and frames near it are shown
  $("when").textContent = `frame ${index} of ${stage.media.times.length - 1}   ${stage.media.times[index].toFixed(4)} s`;
}

function choose(key, redraw = true) {
  tool = key === tool ? null : key;
  stage.tool = tool;
  $("overlay").classList.toggle("stating", Boolean(tool));
  $("hint").textContent = tool ? PLACES[tool].hint : "";
  if (redraw) showTools(experiment().keys, view(), { tool, choose, remove });
}

// ------------------------------------------------------------------------------------------------ keyboard and more

function stop() {
  clearInterval(playing);
  playing = null;
  $("play").textContent = "Play";
}

function play() {
  if (playing) {
    stop();
    return;
  }
  const rate = Math.min(Math.max(stage.media.playback_rate, SLOWEST), FASTEST);
  $("play").textContent = "Stop";
  playing = setInterval(() => {
    if (stage.wanted >= stage.media.times.length - 1) stop();
    else if (!stage.showing) stage.show(stage.wanted + 1);
  }, 1000 / rate);
}

/** The photo or clip before or after the one that is shown. */
function step(by) {
  const all = lab.experiments.flatMap((one, e) => one.repetitions.flatMap((each, r) => each.map((_, v) => ({ experiment: e, repetition: r, view: v }))));
  const at = all.findIndex((each) => each.experiment === shown.experiment && each.repetition === shown.repetition && each.view === shown.view);
  if (all[at + by]) select(all[at + by]);
}

const KEYS = {
  n: () => step(1),
  p: () => step(-1),
  m: () => { stage.marksShown = !stage.marksShown; stage.draw(); },
  f: openFigures,
  r: () => $("reason").focus(),
  t: runTwin,
  "?": () => $("help").showModal(),
  "+": () => stage.zoomBy(1.25),
  "-": () => stage.zoomBy(0.8),
  0: () => stage.zoomBy(0),
  Escape: () => { choose(null); from = null; },
};
const FILM_KEYS = {
  ArrowLeft: (event) => stage.show(stage.wanted - (event.shiftKey ? 10 : 1)),
  ArrowRight: (event) => stage.show(stage.wanted + (event.shiftKey ? 10 : 1)),
  Home: () => stage.show(0),
  End: () => stage.show(stage.media.times.length - 1),
  " ": play,
  "[": leaveOutFrom,
  "]": () => leaveOut(from),
  x: () => leaveOut(stage.index),
};

document.addEventListener("keydown", (event) => {
  if ($("help").open || $("figures").open || !lab) return;
  if (event.key.toLowerCase() === "z" && (event.ctrlKey || event.metaKey) && event.target.tagName !== "INPUT") {
    event.preventDefault();
    if (lab.can_undo) undo();
    return;
  }
  const writes = event.target.tagName === "INPUT" && event.target.type === "text";
  if (event.ctrlKey || event.metaKey || event.altKey || (writes && event.key !== "Escape")) return;
  if (event.target.tagName === "BUTTON" && event.key === " ") return; // presses it
  const act = KEYS[event.key] ?? (stage.film ? FILM_KEYS[event.key] : undefined);
  if (act) {
    event.preventDefault();
    act(event);
  } else if (/^[1-9]$/.test(event.key)) {
    document.querySelectorAll("#tools .tool > button:first-child")[Number(event.key) - 1]?.click();
  }
});

$("undo").addEventListener("click", undo);
$("help-open").addEventListener("click", () => $("help").showModal());
$("play").addEventListener("click", play);
$("twin-run").addEventListener("click", runTwin);
$("slider").addEventListener("input", () => stage.show(Number($("slider").value)));
$("set-start").addEventListener("click", () => set("start", `${stage.index}f`));
$("set-end").addEventListener("click", () => set("end", `${stage.index}f`));
$("span-from").addEventListener("click", leaveOutFrom);
$("span-to").addEventListener("click", () => leaveOut(from));
$("span-one").addEventListener("click", () => leaveOut(stage.index));
$("verdict").addEventListener("submit", (event) => {
  event.preventDefault();
  if (!view().rejected) set("rejected", $("reason").value, true);
});
$("accept").addEventListener("click", () => set("rejected", null, true));

/** What was changed elsewhere meanwhile, in an editor say, is seen when the person comes back. */
window.addEventListener("focus", async () => {
  if (!lab) return;
  try {
    lab = await get("/api/lab");
    problem(null);
    await select(shown);
  } catch (error) {
    problem(error);
  }
});

async function start() {
  lab = await get("/api/lab");
  const [e, r, v] = location.hash.slice(1).split("/").map(Number);
  const there = lab.experiments[e]?.repetitions[r]?.[v];
  const first = lab.experiments.findIndex((one) => one.repetitions.length);
  if (first < 0) throw new Error("this lab has no repetitions; name clips or photos in lab.toml.");
  await select(there ? { experiment: e, repetition: r, view: v } : { experiment: first, repetition: 0, view: 0 });
}

start().catch(problem);
