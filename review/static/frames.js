// Frames of one clip: fetched before they are needed, in the direction in which the person scrubs.

const AHEAD = 10; // frames
const SLOWLY = 3; // frames from one to the next that is shown: the ones ahead will be shown too
const AT_ONCE = 3; // requests; a browser opens six connections to a server
const KEPT = 240; // encoded frames

export class Frames {
  constructor(address, count, version) {
    this.address = address;
    this.count = count;
    this.version = version;
    this.blobs = new Map(); // frame -> promise of its blob
    this.under = 0;
    this.at = 0;
    this.direction = 1;
  }

  /**
   * The decoded picture of a frame and its number; the ones after it are fetched meanwhile.  Of one that is far from the
   * last one and not there yet a frame near it comes first.
   */
  async picture(index) {
    const step = index - this.at;
    this.direction = step < 0 ? -1 : 1;
    if (Math.abs(step) > SLOWLY && !this.blobs.has(index)) {
      const { blob, shown } = await this.fetched(index, "&near");
      this.at = shown;
      return { bitmap: await createImageBitmap(blob), shown };
    }
    this.at = index;
    const blob = await this.blob(index);
    this.lookAhead();
    return { bitmap: await createImageBitmap(blob), shown: index };
  }

  blob(index) {
    let blob = this.blobs.get(index);
    if (!blob) {
      blob = this.fetched(index).then((found) => found.blob);
      blob.catch(() => this.blobs.delete(index));
    }
    this.blobs.delete(index); // to the end of the map: used last
    this.blobs.set(index, blob);
    for (const oldest of this.blobs.keys()) {
      if (this.blobs.size <= KEPT) break;
      this.blobs.delete(oldest);
    }
    return blob;
  }

  async fetched(index, how = "") {
    this.under += 1;
    try {
      const response = await fetch(`${this.address}/${index}?v=${this.version}${how}`);
      if (!response.ok) throw new Error((await response.json()).error);
      return { blob: await response.blob(), shown: Number(response.headers.get("x-frame")) };
    } finally {
      this.under -= 1;
    }
  }

  lookAhead() {
    for (let step = 1; step <= AHEAD && this.under < AT_ONCE; step += 1) {
      const next = this.at + step * this.direction;
      if (next < 0 || next >= this.count) return;
      if (!this.blobs.has(next)) this.blob(next).then(() => this.lookAhead(), () => {});
    }
  }
}
