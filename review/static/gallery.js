// Figures that earlier commands drew: all of them small, or one large.

import { resultAddress } from "./api.js";
import { node } from "./panel.js";

const $ = (id) => document.getElementById(id);

let pages = [];
let pictures = []; // of all pages
let large = -1; // number of the one that is shown alone

/** What there is to see now. */
export function showFigures(found) {
  $("figures-open").hidden = !found.length;
  if (JSON.stringify(found) === JSON.stringify(pages)) return;
  pages = found;
  pictures = pages.flatMap((page) => page.pictures);
  all();
}

export function open() {
  if (pictures.length) $("figures").showModal();
}

function all() {
  large = -1;
  $("figure").hidden = true;
  $("thumbs").hidden = false;
  $("thumbs").replaceChildren(...pages.flatMap((page) => [
    node("h2", {}, page.title),
    node("div", { class: "thumbs" }, ...page.pictures.map((picture) => node("button", {
      type: "button", title: picture.caption, onclick: () => one(pictures.indexOf(picture)),
    }, node("img", { src: resultAddress(picture.file), alt: picture.caption, loading: "lazy" })))),
  ]));
}

function one(number) {
  if (number < 0 || number >= pictures.length) return;
  large = number;
  const { file, caption } = pictures[number];
  $("thumbs").hidden = true;
  $("figure").hidden = false;
  $("figure-picture").src = resultAddress(file);
  $("figure-picture").alt = caption;
  $("figure-caption").textContent = caption;
  $("figure-file").href = resultAddress(file);
  $("figure-before").disabled = number === 0;
  $("figure-after").disabled = number === pictures.length - 1;
  $("figure-all").focus(); // the small picture that was clicked is hidden, and the keys would go nowhere
}

$("figures-open").addEventListener("click", open);
$("figure-before").addEventListener("click", () => one(large - 1));
$("figure-after").addEventListener("click", () => one(large + 1));
$("figure-all").addEventListener("click", all);
$("figures").addEventListener("close", all);
$("figures").addEventListener("keydown", (event) => {
  const act = { ArrowLeft: () => one(large - 1), ArrowRight: () => one(large + 1), Backspace: all }[event.key];
  if (!act || (large < 0 && event.key === "ArrowLeft")) return;
  event.preventDefault();
  act();
});
