// The picture: frames on a canvas, lines and handles over it, zoom, and drags in pixels of the picture.

import { get } from "./api.js";
import * as drawing from "./drawing.js";
import { Frames } from "./frames.js";
import { PLACES, outline, radius, shapesOf } from "./places.js";

const $ = (id) => document.getElementById(id);
const HANDLE = 7; // [px of the screen], radius
const SHORTEST = 4; // [px of the picture], of a drag; a shorter one was a click

export class Stage {
  /**
   * `onPlace(key, points, index)` is called when a place is stated, `onRemove(key, index)` when it is taken out,
   * `onFrame(index)` when a frame is shown.
   */
  constructor({ onPlace, onRemove, onFrame, onProblem }) {
    Object.assign(this, { onPlace, onRemove, onFrame, onProblem });
    this.svg = $("overlay");
    this.canvas = $("canvas");
    this.zoom = 1;
    this.shift = [0, 0];
    this.marks = [];
    this.marksShown = true;
    this.stated = {};
    this.keys = [];
    this.tool = null;
    this.wanted = 0;
    this.index = 0;
    this.svg.addEventListener("pointerdown", (event) => this.pressed(event));
    $("frame").addEventListener("wheel", (event) => this.wheeled(event), { passive: false });
    new ResizeObserver(() => this.fit()).observe($("frame"));
  }

  get film() {
    return this.media?.times.length > 0;
  }

  /** Show a photo or a clip; `place` is experiment/repetition/view.  Of one that is shown only what has changed. */
  async open(place, view, frame = 0) {
    const same = this.place === place && Boolean(this.media);
    if (!same) {
      this.place = place;
      this.view = view;
      this.media = null;
      this.marks = [];
      delete document.documentElement.dataset.frame;
    }
    const media = await get(`/api/media/${place}`);
    if (this.place !== place) return;
    if (same) {
      if (JSON.stringify(media) === JSON.stringify(this.media)) return;
      if (media.version === this.media.version) { // the same pictures at other times
        this.media = media;
        return;
      }
      frame = this.index;
    }
    this.media = media;
    $("no-picture").hidden = true;
    $("picture").hidden = false;
    this.frames = new Frames(`/frame/${place}`, Math.max(media.times.length, 1), media.version);
    this.svg.setAttribute("viewBox", `-0.5 -0.5 ${media.width} ${media.height}`);
    if (!same) {
      this.zoom = 1;
      this.shift = [0, 0];
    }
    this.fit();
    this.index = -1;
    await this.show(this.film ? frame : 0);
  }

  /** Nothing to show, and why. */
  close(why) {
    this.place = null;
    this.media = null;
    this.marks = [];
    delete document.documentElement.dataset.frame;
    $("picture").hidden = true;
    $("no-picture").hidden = false;
    $("no-picture").textContent = why;
  }

  /** Show a frame; of frames asked for while one is on its way only the last is shown. */
  async show(index) {
    if (!this.media) return;
    this.wanted = Math.min(Math.max(index, 0), Math.max(this.media.times.length - 1, 0));
    if (this.showing) return;
    this.showing = true;
    try {
      while (this.index !== this.wanted) {
        const [place, frames, next] = [this.place, this.frames, this.wanted];
        const { bitmap, shown } = await frames.picture(next);
        if (this.place !== place || this.frames !== frames) continue;
        this.canvas.width = bitmap.width;
        this.canvas.height = bitmap.height;
        this.canvas.getContext("2d").drawImage(bitmap, 0, 0);
        bitmap.close();
        if (shown === this.index) continue;
        this.index = shown;
        document.documentElement.dataset.frame = shown;
        this.draw();
        this.onFrame(shown);
      }
    } catch (error) {
      this.index = this.wanted;
      this.onProblem(error);
    } finally {
      this.showing = false;
    }
  }

  // ------------------------------------------------------------------------------------------------------ lines

  draw() {
    if (!this.media || this.dragging) return;
    const focused = document.activeElement?.dataset?.handle;
    this.svg.replaceChildren();
    if (this.marksShown) drawing.marks(this.svg, this.marks, this.view, this.index);
    for (const key of this.keys.filter((each) => each in PLACES)) this.drawPlace(key);
    if (focused) this.svg.querySelector(`[data-handle="${focused}"]`)?.focus();
  }

  drawPlace(key) {
    const place = PLACES[key];
    const value = this.stated[key];
    if (value !== undefined) {
      const frames = place.several ? value.map((each) => each.frame) : [value.frame];
      shapesOf(key, value).forEach((points, index) => {
        if (!place.framed || frames[index] === this.index) this.drawShape(key, points, index, "stated");
      });
      return;
    }
    const own = this.marks.filter((mark) => mark.view === this.view);
    const points = this.marksShown ? place.found(own, this.index) : null;
    if (points) this.drawHandles(key, points, 0, "found");
  }

  drawShape(key, points, index, kind) {
    const { form } = PLACES[key];
    const group = drawing.element("g", {}, this.svg);
    this.drawForm(group, form, points, kind);
    this.drawHandles(key, points, index, kind);
  }

  drawForm(group, form, points, kind) {
    if (form === "circle") drawing.circle(group, points[0], radius(points), kind);
    else if (form === "points") points.forEach((point) => drawing.circle(group, point, 5, kind));
    else drawing.path(group, outline(form, points, this.media), kind);
  }

  drawHandles(key, points, index, kind) {
    points.forEach((point, number) => {
      const [cx, cy] = PLACES[key].form === "level" ? [this.media.width / 2, point[1]] : point;
      const handle = drawing.element("circle", {
        cx, cy, r: HANDLE / this.scale, class: `handle ${kind}`, tabindex: 0, role: "button",
        "data-handle": `${key} ${index} ${number}`, "aria-label": `${PLACES[key].label}, handle ${number + 1}`,
      }, this.svg);
      handle.addEventListener("pointerdown", (event) => {
        event.stopPropagation();
        handle.focus();
        // its other points may have been changed meanwhile
        const shape = (to) => moved(PLACES[key].form, this.current(key, index) ?? points, number, to);
        this.drag(event, shape, (last) => this.onPlace(key, last, index), key);
      });
      handle.addEventListener("keydown", (event) => this.nudge(event, key, points, number, index));
    });
  }

  /** The points of a place as they are stated now. */
  current(key, index) {
    return this.stated[key] === undefined ? null : shapesOf(key, this.stated[key])[index];
  }

  /** Move a focused handle with the arrow keys; it is written with Enter, or when the keys rest. */
  nudge(event, key, points, number, index) {
    const steps = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
    const written = () => {
      clearTimeout(this.resting);
      if (!this.nudged) return;
      this.nudged = false;
      this.onPlace(key, points, index);
    };
    if (event.key === "Enter") {
      event.stopPropagation();
      written();
    } else if (event.key === "Delete" && this.stated[key] !== undefined) {
      this.onRemove(key, index);
    } else if (steps) {
      event.preventDefault();
      event.stopPropagation();
      const by = event.shiftKey ? 10 : 1;
      const from = points[number];
      const to = [from[0] + by * steps[0], from[1] + by * steps[1]];
      moved(PLACES[key].form, points, number, to).forEach((point, k) => { points[k] = point; });
      this.nudged = true;
      event.target.setAttribute("cx", PLACES[key].form === "level" ? this.media.width / 2 : to[0]);
      event.target.setAttribute("cy", to[1]);
      clearTimeout(this.resting);
      this.resting = setTimeout(written, 800);
    }
  }

  // ------------------------------------------------------------------------------------------------------ drags

  /** Where the pointer is [px of the picture]. */
  at(event) {
    const box = this.svg.getBoundingClientRect();
    return [
      ((event.clientX - box.left) / box.width) * this.media.width - 0.5,
      ((event.clientY - box.top) / box.height) * this.media.height - 0.5,
    ];
  }

  pressed(event) {
    if (!this.media || event.button !== 0) return;
    if (!this.tool) {
      this.pan(event);
      return;
    }
    event.preventDefault();
    const [key, place, from] = [this.tool, PLACES[this.tool], this.at(event)];
    if (place.form === "points") {
      const written = (point) => (place.several ? this.onPlace(key, [point], -1) : this.onPlace(key, this.added(key, point), 0));
      this.drag(event, (to) => [to], ([point]) => written(point), key);
      return;
    }
    const shortest = place.form === "level" ? 0 : SHORTEST;
    this.drag(event, (to) => place.drag(from, to), (shape, to) => {
      if (Math.hypot(to[0] - from[0], to[1] - from[1]) >= shortest) this.onPlace(key, shape, -1);
    }, key);
  }

  /** A further point of a key with several, a new one instead where there are as many as there can be. */
  added(key, point) {
    const there = this.stated[key] === undefined ? [] : PLACES[key].shape(this.stated[key]);
    return there.length < PLACES[key].most ? [...there, point] : [point];
  }

  /** Follow the pointer until it is released; `shapeAt` makes the shape, `done` is called with the last one. */
  drag(event, shapeAt, done, key) {
    const group = drawing.element("g", {}, this.svg);
    const inside = ([x, y]) => [
      Math.min(Math.max(x, -0.5), this.media.width - 0.5), Math.min(Math.max(y, -0.5), this.media.height - 0.5),
    ];
    this.dragging = true;
    let to = inside(this.at(event));
    let touched = false;
    const move = (next) => {
      touched = true;
      to = inside(this.at(next));
      group.replaceChildren();
      this.drawForm(group, PLACES[key].form, shapeAt(to), "draft");
    };
    const end = (last) => {
      window.removeEventListener("pointermove", move);
      window.removeEventListener("pointerup", end);
      window.removeEventListener("pointercancel", end);
      this.dragging = false;
      group.remove();
      if (last.type === "pointerup" && touched) to = inside(this.at(last));
      const point = PLACES[key].form === "points" || PLACES[key].form === "level";
      if (last.type === "pointerup" && (touched || (point && this.tool))) done(shapeAt(to), to);
      else this.draw();
    };
    window.addEventListener("pointermove", move);
    window.addEventListener("pointerup", end);
    window.addEventListener("pointercancel", end);
  }

  // ------------------------------------------------------------------------------------------------------- zoom

  /** Pixels of the screen in one pixel of the picture. */
  get scale() {
    return this.fitted * this.zoom;
  }

  fit() {
    if (!this.media) return;
    const { clientWidth, clientHeight } = $("frame");
    this.fitted = Math.min(clientWidth / this.media.width, clientHeight / this.media.height);
    this.settle();
  }

  settle() {
    const { clientWidth, clientHeight } = $("frame");
    const [width, height] = [this.media.width * this.scale, this.media.height * this.scale];
    const within = (shift, room, size) => Math.max(Math.min(shift, Math.max(0, (size - room) / 2)), -Math.max(0, (size - room) / 2));
    this.shift = [within(this.shift[0], clientWidth, width), within(this.shift[1], clientHeight, height)];
    const style = $("picture").style;
    style.width = `${width}px`;
    style.height = `${height}px`;
    style.transform = `translate(${(clientWidth - width) / 2 + this.shift[0]}px, ${(clientHeight - height) / 2 + this.shift[1]}px)`;
    this.draw();
  }

  /** Enlarge by a factor about a point of the screen, by default the middle of the frame. */
  zoomBy(factor, clientX, clientY) {
    if (!this.media) return;
    const box = $("frame").getBoundingClientRect();
    const about = [(clientX ?? box.left + box.width / 2) - box.left - box.width / 2,
      (clientY ?? box.top + box.height / 2) - box.top - box.height / 2];
    const zoom = factor === 0 ? 1 : Math.min(Math.max(this.zoom * factor, 1), 20);
    const by = zoom / this.zoom;
    this.zoom = zoom;
    this.shift = this.shift.map((shift, k) => about[k] + (shift - about[k]) * by);
    this.settle();
  }

  wheeled(event) {
    event.preventDefault();
    this.zoomBy(event.deltaY < 0 ? 1.25 : 0.8, event.clientX, event.clientY);
  }

  pan(event) {
    const [from, shift] = [[event.clientX, event.clientY], this.shift];
    const move = (next) => {
      this.shift = [shift[0] + next.clientX - from[0], shift[1] + next.clientY - from[1]];
      this.settle();
    };
    const end = () => {
      window.removeEventListener("pointermove", move);
      window.removeEventListener("pointerup", end);
    };
    window.addEventListener("pointermove", move);
    window.addEventListener("pointerup", end);
  }
}

/** The shape with one of its points elsewhere; a circle moves with its centre. */
function moved(form, points, number, to) {
  const by = [to[0] - points[number][0], to[1] - points[number][1]];
  const along = (k) => k === number || (form === "circle" && number === 0);
  return points.map((point, k) => (along(k) ? [point[0] + by[0], point[1] + by[1]] : point));
}
